"""Commands of the documentation run, in the order of their page, on the tiny capture and its finished take."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = {
    "README.md": "## Your own footage",
    "docs/guides/bake.md": "## Keep several bakes",
    "docs/guides/edit.md": "# Edit",
}
"""Page, and the heading above its block of commands."""

ELSEWHERE = {"open", "serve", "ablate", "sync"}
"""A window; runs until it is stopped; trains for minutes; needs longer footage. Other tests run them."""


def commands_of(page: str, heading: str) -> list[list[str]]:
    """The words of each `v3studio` command in the first shell block below a heading."""
    text = (ROOT / page).read_text(encoding="utf-8")
    below = text[text.index(heading) :]
    found = re.search(r"```(?:sh|bash)\n(.*?)```", below, re.DOTALL)
    assert found is not None
    lines = [line for line in found[1].splitlines() if line.startswith("v3studio ")]
    return [shlex.split(line, comments=True)[1:] for line in lines]


@pytest.mark.parametrize("page", PAGES)
def test_commands_run_in_the_order_of_their_page(
    page: str, here: Callable, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("my-take", "takes/first", "takes/a", "takes/b"):
        shutil.copytree(finished / "take", tmp_path / name)
    shutil.copytree(finished / "capture", tmp_path / "footage")
    monkeypatch.chdir(tmp_path)
    assert here("export", "my-take", "--format", "ply", "--of", "trained", "--out", "plys").returncode == 0
    commands = [words for words in commands_of(page, PAGES[page]) if words[0] not in ELSEWHERE]
    assert len(commands) >= 5
    for words in commands:
        if words[:2] == ["edit", "trim"]:
            words[3] = "1:4"  # the take has five frames
        if "turntable" in words:
            words += ["--size", "64x48", "--seconds", "0.2"]
        done = here(*words)
        assert done.returncode == 0, f"{' '.join(words)}: {done.stderr}"
