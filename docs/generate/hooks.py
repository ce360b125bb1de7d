"""MkDocs hooks: pages that are made from the source when the site is built.

MkDocs imports this file by its path, hence the line that makes the files beside it importable.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "docs"), str(ROOT)]

from generate.api import MODULES, api_pages  # noqa: E402
from generate.camera_files import with_camera_formats  # noqa: E402
from generate.commands import commands_page  # noqa: E402
from generate.errors import errors_page  # noqa: E402
from generate.events import events_page  # noqa: E402
from generate.names import unknown_names  # noqa: E402
from generate.settings import setting_names, settings_page  # noqa: E402

from v3studio.pipelines.share.page import PageText  # noqa: E402
from v3studio.pipelines.share.sharing import share  # noqa: E402

log = get_plugin_logger("docs")

PACKAGES = ("studio", "pipelines", "gui", "v3studio")
"""The folders in which error codes are looked for."""

SAMPLE = "docs/assets/sample.v3s"
"""The stream of `make demo`, which the first page plays."""

NAMES_OTHERS = ("changelog.md", "glossary.md")
"""Pages that name files and settings of the past."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the generated API pages under the entry "Python API" of the navigation."""
    pages = [f"reference/api/{name}" for name in api_pages(ROOT)]
    entries = [{_title(page): page} if not page.endswith("index.md") else page for page in pages]
    for section in config.nav or []:
        for title, children in section.items():
            if title == "Reference":
                place = next(i for i, child in enumerate(children) if "Python API" in child)
                children[place] = {"Python API": entries}
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    pages = {
        "reference/settings.md": settings_page(),
        "reference/commands.md": commands_page(),
        "reference/errors.md": errors_page(ROOT, PACKAGES),
        "reference/events.md": events_page(),
        "contributing.md": _root_page("CONTRIBUTING.md"),
        "changelog.md": _root_page("CHANGELOG.md"),
        **{f"reference/api/{name}": text for name, text in api_pages(ROOT).items()},
    }
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    files.append(File.generated(config, "assets/sample.html", content=_player_page()))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Add tables that are made from the source. Warn, which fails a strict build, where a written page names a file or
    setting that does not exist."""
    if page.file.generated_by is None and page.file.src_uri not in NAMES_OTHERS:
        for problem in unknown_names(markdown, ROOT, setting_names()):
            log.warning("%s: %s", page.file.src_uri, problem)
    return with_camera_formats(markdown)


def _root_page(name: str) -> str:
    """A page of the repository's root, its links into docs/ made relative to docs/."""
    return (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")


def _player_page() -> bytes:
    """The browser player with the sample's stream in one HTML file, which also opens from the disk."""
    text = PageText(title="The sample capture", credits="V3 Studio", license="CC0", view="50,8")
    with TemporaryDirectory() as folder:
        page = Path(folder) / "sample.html"
        share(ROOT / SAMPLE, page, text)
        return page.read_bytes()


def _title(page: str) -> str:
    name = Path(page).stem
    return MODULES.get(name, name)
