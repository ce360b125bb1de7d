"""Libraries that change this process; programs that start in a stranger's folder execute nothing of it."""

import contextlib
import ctypes
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.hostile_streams import executed, plant
from v3studio.studio.process import NativeLines, forget_working_folder, logged, python_command, start

BARE = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}


def test_the_command_line_sets_it_but_not_over_the_users() -> None:
    code = (
        "import os, sys\nfrom v3studio.pipelines import cli\nsys.argv = ['v3studio', '--version']\n"
        "try:\n    cli.main()\nexcept SystemExit:\n    pass\n"
        "print(os.environ['OMP_WAIT_POLICY'], file=sys.stderr)"
    )
    for environment in ({}, {"OMP_WAIT_POLICY": "active"}):
        done = run_script(code, env=environment)
        assert done.stderr.decode().strip() == environment.get("OMP_WAIT_POLICY", "passive")


ROOT = Path(__file__).parents[2]


def test_a_call_that_hangs_is_the_last_line_of_the_log(caplog: pytest.LogCaptureFixture) -> None:
    log = logging.getLogger("v3studio.test")
    caplog.set_level(logging.DEBUG, log.name)
    with logged(log, "PyMeshLab"):
        assert caplog.messages == ["PyMeshLab: begins"]
    assert len(caplog.messages) == 2
    with contextlib.suppress(KeyboardInterrupt), logged(log, "COLMAP"):
        raise KeyboardInterrupt
    assert ["KeyboardInterrupt" in message for message in caplog.messages] == [False, False, False, True]


NOISY = """
import atexit, ctypes, os, subprocess, sys
from v3studio.studio.process import claim_stdout
claim_stdout()
os.write(1, b"raw\\n")
ctypes.CDLL(None).printf(b"buffered until exit\\n")
subprocess.run([sys.executable, "-c", "print('a child')"], check=True)
print("ours: prise \\u00e9 \\u5f71")
"""


def run_script(code: str, **options: object) -> subprocess.CompletedProcess[bytes]:
    environment = {**BARE, "PYTHONPATH": str(ROOT), **options.pop("env", {})}  # type: ignore[dict-item]
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, env=environment, timeout=280, check=False, **options
    )  # type: ignore[call-overload,no-any-return]


@pytest.mark.parametrize("locale", ["C", "C.UTF-8"])
def test_native_output_goes_to_standard_error_and_names_are_utf8_in_every_locale(
    locale: str,
) -> None:
    done = run_script(NOISY, env={"LC_ALL": locale, "LANG": locale})
    assert (done.returncode, done.stdout.decode()) == (0, "ours: prise é 影\n")
    assert sorted(done.stderr.decode().splitlines()) == ["a child", "buffered until exit", "raw"]


def test_an_encoding_without_the_letters_gets_escapes_and_json_utf8() -> None:
    code = (
        "import sys\nfrom v3studio.studio.process import as_utf8, claim_stdout\nclaim_stdout()\n"
        "print('\\u5f71', flush=True)\nas_utf8(sys.stdout)\nprint('\\u5f71 \\udce9')"
    )
    done = run_script(code, env={"PYTHONIOENCODING": "ascii"})
    assert done.stdout == "\\u5f71\n影 \\udce9\n".encode(), done.stderr


def test_native_lines_are_collected_and_the_descriptor_is_given_back(capfd: pytest.CaptureFixture[str]) -> None:
    lines = NativeLines()
    try:
        os.write(1, b"one\ntw")
        assert lines.take() == ["one"]
        os.write(1, b"o\xff\n")
        assert lines.take() == ["two\ufffd"]
        assert lines.take() == []
        ctypes.CDLL(None).printf(b"buffered")
    finally:
        rest = lines.close()
    assert rest == ["buffered"]
    assert lines.close() == lines.take() == []
    os.write(1, b"back\n")
    assert capfd.readouterr().out == "back\n"


CLI = python_command("v3studio.pipelines.cli", "config", "bake")


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """File that names what was executed; the working folder is a stranger's."""
    (tmp_path / "hostile" / "masks").mkdir(parents=True)
    for folder in (tmp_path / "hostile", tmp_path / "hostile" / "masks"):
        plant(folder, tmp_path / "told")
    monkeypatch.chdir(tmp_path / "hostile")
    return tmp_path / "told"


@pytest.mark.parametrize("path", [None, "", ".", os.pathsep, "masks", f"masks{os.pathsep}./."])
def test_a_child_executes_nothing_of_its_folder(path: str | None, told: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTHONPATH", raising=False)
    if path is not None:
        monkeypatch.setenv("PYTHONPATH", path)
    with start(CLI, stdout=subprocess.PIPE) as child:
        assert b"quality" in child.stdout.read()
    assert (child.returncode, executed(told)) == (0, "")


@pytest.mark.parametrize("program", ["v3studio", "v3studio-gui"])
def test_the_installed_programs_execute_nothing_of_their_folder(program: str, told: Path) -> None:
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [Path(sys.executable).with_name(program), "--help"]
    done = subprocess.run(command, env={**variables, "PYTHONPATH": ""}, capture_output=True, check=False)
    assert (done.returncode, executed(told)) == (0, ""), done.stderr


def test_packages_of_the_user_with_our_names_break_nothing(tmp_path: Path) -> None:
    for name in ("pipelines", "studio", "gui"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise AssertionError('imported')")
    with start(CLI, {"PYTHONPATH": str(tmp_path)}, stdout=subprocess.PIPE) as child:
        assert b"quality" in child.stdout.read()
    assert child.returncode == 0


def test_folders_that_the_user_names_stay_what_they_were(told: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = Path.cwd()
    monkeypatch.setenv("PYTHONSAFEPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(("masks", "", "/other", ".")))
    monkeypatch.setattr(sys, "path", [str(here / "masks"), str(here), "/other", "/usr/lib"])
    forget_working_folder()
    assert os.environ["PYTHONPATH"] == os.pathsep.join((str(here / "masks"), "/other"))
    assert os.environ["PYTHONSAFEPATH"] == "1", "for programs that libraries start"
    assert sys.path == [str(here / "masks"), "/other", "/usr/lib"]
