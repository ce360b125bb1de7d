import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.shared import made_once
from tests.support.tiny_capture import SETTINGS, Done, Here, environment, write_capture, write_project
from tests.support.warm_python import WarmProcess, warm_python
from v3studio.pipelines.takes.take import Take


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with `capture/` and `ball.yaml`."""
    write_project(tmp_path)
    return tmp_path


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    """A copy of `finished`: with `capture/`, `ball.yaml` and the finished take `take/`."""
    return Path(shutil.copytree(finished, tmp_path / "project"))


@pytest.fixture
def take(copied: Path) -> Take:
    """The finished take in that copy."""
    return Take.open(copied / "take")


@pytest.fixture(scope="session")
def long_footage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Settings of footage that is long enough to estimate time offsets."""

    def make(folder: Path) -> None:
        write_capture(folder / "capture", frames=12)
        (folder / "ball.yaml").write_text(SETTINGS)

    return made_once(tmp_path_factory, "long_footage", make) / "ball.yaml"


@pytest.fixture
def start() -> Iterator[Callable[..., WarmProcess]]:
    """Start the command line without waiting for it."""
    started: list[WarmProcess] = []

    def go(*arguments: object) -> WarmProcess:
        process = warm_python().popen(("-m", "v3studio.pipelines.cli", *arguments), text=True, env=environment())
        started.append(process)
        return process

    yield go
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture
def here(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Here:
    """Run the command line in this process; a new process per command would cost seconds of imports."""
    from v3studio.pipelines.cli import execute

    monkeypatch.setenv("COLUMNS", "200")  # pytest-xdist sets 80, which breaks the rows of tables

    def run(*arguments: object) -> Done:
        capsys.readouterr()
        try:
            code = execute([str(argument) for argument in arguments])
        except SystemExit as stop:
            code = int(stop.code or 0)
        return Done(code, *capsys.readouterr())

    return run
