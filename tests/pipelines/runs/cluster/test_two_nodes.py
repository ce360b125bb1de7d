"""A run on a Ray cluster of two nodes, one of which is killed: the take of a local run."""

from pathlib import Path
from typing import Any

import pytest

from tests.support.tiny_capture import environment, results, v3studio
from tests.support.two_nodes import SETTINGS, two_nodes
from tests.support.warm_python import warm_python
from v3studio.pipelines.events import GroupStarted, Metrics, StageFinished, Warned
from v3studio.pipelines.stages import STAGE_NAMES
from v3studio.pipelines.takes.take import Take

pytestmark = pytest.mark.long

HELD = """
import sys, ray
from v3studio.pipelines.runs.cluster.nodes import Nodes, Wanted
ray.init(address=sys.argv[1], log_to_driver=False, configure_logging=False)
nodes = Nodes(ray)
print(nodes.holders(Wanted(cpus=1, gpus=0.0, memory=1)))
nodes.excluded = {node["NodeID"] for node in ray.nodes() if node["NodeID"].startswith(sys.argv[2])}
print(nodes.holders(Wanted(cpus=1, gpus=0.0, memory=1)))
"""


def assert_names_what_holds_a_node(cluster: Any) -> None:
    """An actor holds the CPU of the first node, and that of the second is free."""
    command = ("-c", HELD, cluster.address, cluster.second)
    done = warm_python().run(command, text=True, env=environment() | SETTINGS)
    assert done.returncode == 0, done.stderr
    room, held = done.stdout.splitlines()
    assert room == "", "the second node has room"
    assert "has 0 of 1 CPU free, held by the actor Busy; other programs that use the cluster: `" in held


SLOW = ("--train.finetune_iterations", 300)
"""Seconds a frame: nodes are noticed and killed while their groups train, also where the machine is fast."""


def run_and_kill(project: Path, take: Take) -> tuple[list[Any], set[str]]:
    """The events of a run whose second node is killed when it has trained a frame, and the nodes that trained."""
    with two_nodes() as cluster:
        assert_names_what_holds_a_node(cluster)
        command = ("-m", "v3studio.pipelines.cli", "run", project / "ball.yaml", "--take", take, "--json", *SLOW)
        command += ("--run.executor", "ray", "--run.address", cluster.address)
        process = warm_python().popen(command, text=True, env=environment() | SETTINGS)
        events = list(cluster.events_while_second_is_killed(process.stdout))
        _, errors = process.communicate()
        assert process.returncode == 0, errors
    return events, {event.node for event in events if isinstance(event, GroupStarted)}


@pytest.mark.timeout(1200)
def test_a_node_is_killed_and_the_take_is_that_of_a_local_run(project: Path) -> None:
    pytest.importorskip("ray", reason="Ray is not installed (extra cluster)")
    for attempt in range(3):
        take = project / f"take{attempt}"
        events, nodes = run_and_kill(project, take)
        if any(isinstance(event, Warned) for event in events):
            break  # on a busy machine the group may end before the kill is there
    assert len(nodes) == 2
    lost = [event for event in events if isinstance(event, Warned)]
    assert [event.code for event in lost] == ["cluster.worker_lost"]
    retried = [e for e in events if isinstance(e, GroupStarted) and e.attempt == 2]
    assert [event.group for event in retried] == [lost[0].fields["group"]]
    other = 1 - lost[0].fields["group"]
    told = [e.frame for e in events if isinstance(e, Metrics) and (e.stage, e.group) == ("train", other)]
    wanted = {0: {0, 1, 2}, 1: {3, 4}}[other]
    assert {frame for frame in told if frame is not None} == wanted, "the figures of the last frame arrive, too"
    assert [e.stage for e in events if isinstance(e, StageFinished)] == list(STAGE_NAMES)
    v3studio("run", project / "ball.yaml", "--take", project / "local", *SLOW).ok()
    assert results(take) == results(project / "local")
