"""Starting a run on the head node, without a cluster: the actor's method is called in this process."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from v3studio.pipelines.config import load_config
from v3studio.pipelines.runs.background import start_background
from v3studio.pipelines.runs.cluster import detached
from v3studio.pipelines.runs.cluster.connection import ADDRESS_VARIABLE
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError

BEGINS = """
import os, sys, time
from pathlib import Path
from v3studio.pipelines.events import RunStarted
event = RunStarted(take="t", stages=(), done=(), pid=os.getpid(), version="1")
Path(sys.argv[1]).write_text(event.to_json() + "\\n")
time.sleep(600)
"""
FAILS = "import sys; sys.exit('error: the footage is missing')"


@pytest.fixture
def take(tmp_path: Path) -> Take:
    return Take.create(tmp_path / "take")


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch, take: Take) -> Iterator[SimpleNamespace]:
    """The program that was launched: `words`, `variables`, `process`; set `script` before."""
    launched = SimpleNamespace(script=FAILS, words=[], variables={}, process=None)

    def launch(words: Any, errors: Path, variables: Any = None) -> subprocess.Popen[bytes]:
        launched.words, launched.variables = list(words), dict(variables or {})
        with errors.open("wb") as file:
            command = [sys.executable, "-c", launched.script, str(take.log)]
            launched.process = subprocess.Popen(command, stderr=file)
        return launched.process

    class Actor:
        def __init__(self) -> None:
            self.start = SimpleNamespace(remote=detached.Starter().start)

    ray: Any = SimpleNamespace(
        exceptions=SimpleNamespace(RayError=LookupError),
        get_runtime_context=lambda: SimpleNamespace(gcs_address="127.0.0.1:6379"),
        remote=lambda _: SimpleNamespace(options=lambda **_: SimpleNamespace(remote=Actor)),
        get=lambda answer: answer,
        kill=lambda _: None,
    )

    @contextmanager
    def connected(address: str, cpus: int) -> Iterator[Any]:
        yield ray

    monkeypatch.setitem(sys.modules, "ray", ray)
    monkeypatch.setattr(detached, "connected", connected)
    monkeypatch.setattr(detached, "launch", launch)
    monkeypatch.setattr(detached, "threading", SimpleNamespace(Thread=lambda **_: SimpleNamespace(start=bool)))
    yield launched
    if launched.process is not None:
        launched.process.kill()
        launched.process.wait()


def settings() -> Any:
    return load_config(None, [("run.executor", "ray"), ("run.address", "ray://head:10001")])


def test_the_run_gets_the_address_on_the_head_node_not_as_a_setting(take: Take, cluster: Any) -> None:
    cluster.script = BEGINS
    run = start_background(take, settings(), ("run",))
    assert (run.pid, run.code) == (cluster.process.pid, None)
    assert "--run.address" not in cluster.words
    assert cluster.variables == {ADDRESS_VARIABLE: "127.0.0.1:6379"}
    assert load_config(take.config).run.address == "ray://head:10001"


def test_a_run_that_cannot_begin_on_the_head_node_says_why(take: Take, cluster: Any) -> None:
    with pytest.raises(StudioError, match=r"^the footage is missing"):
        start_background(take, settings(), ("run",))
