"""Do the pages name files and settings that exist? A page that was not kept up to date fails the build."""

import re
from collections.abc import Iterator, Set
from pathlib import Path

_SPAN = re.compile(r"`([^`\n]+)`")
_FILE = re.compile(r"(?:studio|pipelines|gui|tests|docs|scripts|benchmarks|sample_configs)/[\w./-]*")


def unknown_names(markdown: str, root: Path, settings: Set[str]) -> Iterator[str]:
    """Code spans of a page that look like a file of the repository or a setting, and are none.

    Args:
        markdown: the page.
        root: the repository.
        settings: all dotted names of settings; a span counts as a setting if it starts with a section's name.
    """
    sections = {name.partition(".")[0] for name in settings}
    prose = re.sub(r"^```.*?^```", "", markdown, flags=re.MULTILINE | re.DOTALL)
    for span in _SPAN.findall(prose):
        if _FILE.fullmatch(span):
            if not (root / span).exists():
                yield f"{span}: no such file"
        elif (setting := re.fullmatch(r"([a-z_]+)((?:\.[a-z_0-9]+)+)(?::.*)?", span)) and setting[1] in sections:
            name = setting[1] + setting[2]
            if name not in settings:
                yield f"{name}: no such setting"
