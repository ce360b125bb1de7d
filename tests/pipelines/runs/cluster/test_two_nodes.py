"""A run on a Ray cluster of two nodes, one of which is killed: the take of a local run."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from pipelines.events import GroupState, Metrics, StageFinished, Warned, read_line
from tests.support.tiny_capture import environment, v3studio
from tests.support.two_nodes import SETTINGS, two_nodes

pytest.importorskip("ray", reason="Ray is not installed (extra cluster)")


def results(take) -> dict[str, bytes]:
    files = [
        path
        for folder in ("initialize", "train", "stream")
        for path in (take / folder).rglob("*")
        if path.is_file() and path.name != "group.json"  # which tells how long it took
    ]
    return {path.relative_to(take).as_posix(): path.read_bytes() for path in (*files, take / "evaluation.json")}


SLOW = ("--train.finetune_iterations", 1000)
"""Seconds a frame: nodes are noticed and killed while their groups train, also where the machine is fast."""


def run_and_kill(project, take):
    """The events of a run whose second node is killed when it has trained a frame, and the nodes that trained."""
    with two_nodes() as cluster:
        command = [sys.executable, "-m", "pipelines.cli", "run", project / "ball.yaml", "--take", take, "--json", *SLOW]
        command += ["--run.executor", "ray", "--run.address", cluster.address]
        with (project / "errors").open("w") as errors:
            process = subprocess.Popen(
                list(map(str, command)),
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env={**os.environ, **environment(), **SETTINGS},
            )
        events, nodes = [], set()
        assert process.stdout is not None
        for line in process.stdout:
            event, _ = read_line(line)
            events.append(event)
            if isinstance(event, GroupState) and (event.stage, event.state) == ("train", "running"):
                if not nodes:
                    cluster.free_first()
                nodes.add(event.node)
                if event.node.endswith(cluster.second) and 0 < event.frames_done < event.frames:
                    cluster.kill_second()
                    break
        events += [event for event, _ in map(read_line, process.stdout) if event is not None]
        assert process.wait() == 0, (project / "errors").read_text()
    nodes |= {event.node for event in events if isinstance(event, GroupState) and event.state == "running"}
    return events, nodes


@pytest.mark.timeout(1200)
def test_a_node_is_killed_and_the_take_is_that_of_a_local_run(project):
    for attempt in range(3):
        take = project / f"take{attempt}"
        events, nodes = run_and_kill(project, take)
        if any(isinstance(event, Warned) for event in events):
            break  # on a busy machine the group may end before the kill is there
    assert len(nodes) == 2
    lost = [event for event in events if isinstance(event, Warned)]
    assert [event.code for event in lost] == ["cluster.worker_lost"]
    retried = [e for e in events if isinstance(e, GroupState) and e.state == "retried"]
    assert [event.group for event in retried] == [lost[0].fields["group"]]
    other = 1 - lost[0].fields["group"]
    told = [e.frame for e in events if isinstance(e, Metrics) and (e.stage, e.group) == ("train", other)]
    wanted = {0: [0, 1, 2], 1: [3, 4]}[other]
    assert [frame for frame in told if frame is not None] == wanted, "the figures of the last frame arrive, too"
    assert [e.stage for e in events if isinstance(e, StageFinished)] == [
        "calibrate", "initialize", "train", "bake", "evaluate"
    ]  # fmt: skip
    local = v3studio("run", project / "ball.yaml", "--take", project / "local", *SLOW)
    assert local.returncode == 0, local.stderr
    assert results(take) == results(project / "local")
