import ast
from collections import Counter
from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.reports.page import rendered
from v3studio.pipelines.reports.terminal import console, escaped, say, table_of
from v3studio.studio.errors import StudioError

PIPELINES = Path(__file__).parents[3] / "pipelines"
TURNED, SHOWN = "take_\u202egnp.exe\x1b[2J", "take_?gnp.exe?[2J"
"""A name that terminals and browsers show as "take_exe.png", and that clears a terminal."""


def test_names_are_printed_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    say(f"Serving {TURNED}\n")
    say(TURNED, error=True)
    screen = console()
    screen.print(TURNED, markup=False)
    table = table_of("take")
    table.add_row(escaped(TURNED))
    screen.print(table)
    out, err = capsys.readouterr()
    assert (out.count(SHOWN), err) == (3, f"{SHOWN}\n")
    assert "\u202e" not in out
    with refuses("take.not_found") as refused:
        raise StudioError("take.not_found", f"no folder {TURNED}", file=TURNED)
    assert str(refused.value).count(SHOWN) == 2


def test_reports_show_names_as_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jinja2.PackageLoader", lambda *of: __import__("jinja2").DictLoader({"page": "<p>{{ name }}"}))
    assert rendered("page", name=TURNED) == f"<p>{SHOWN}"


def test_everything_is_printed_by_one_function() -> None:
    """Exceptions: the function, a file of settings, and a QR code, which has colors."""
    exact = {"reports/terminal.py": 1, "commands/config.py": 1, "commands/models.py": 1, "commands/serve.py": 1}
    prints = Counter(
        path.relative_to(PIPELINES).as_posix()
        for path in PIPELINES.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
    )
    assert prints == exact
