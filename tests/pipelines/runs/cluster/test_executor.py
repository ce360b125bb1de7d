"""The executor when workers are lost, nodes are unfit or a run is cancelled, on a Ray that does as told."""

import itertools
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.config import Config
from v3studio.pipelines.events import GroupStarted, Progress, Warned
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.runs.cluster import executor as module
from v3studio.pipelines.runs.cluster import task as task_module
from v3studio.pipelines.runs.cluster.executor import RayExecutor
from v3studio.pipelines.runs.cluster.task import NOT_VISIBLE, GroupTask, run_task, versions
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.frames.groups import cut_into_groups
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import Cancelled, Message, StudioError

GB = 1 << 30
Outcome = Message | Exception | None
Behavior = Callable[[GroupTask, str], Outcome]


class Reference:
    def __init__(self, task: GroupTask, node: str) -> None:
        self.task, self.node = task, node


class FakeRay:
    """One task at a time: `behave` says what becomes of it."""

    def __init__(self, behave: Behavior, nodes: int = 2, cpus: int = 1) -> None:
        self.behave = behave
        self.ids = [f"{number + 1}" * 56 for number in range(nodes)]  # as long as those of Ray
        self._cpus = cpus
        self.asked: list[dict[str, Any]] = []
        self.cancelled: list[Any] = []
        self.silent = False  # nodes cannot write to the take
        self.events = Path()  # of the take

    def nodes(self) -> list[dict[str, Any]]:
        resources = {"CPU": self._cpus, "memory": 8.0 * GB}
        about = {"Alive": True, "Resources": resources}
        return [{"NodeID": key, "NodeManagerHostname": f"node{key[0]}", **about} for key in self.ids]

    def get_runtime_context(self) -> Any:
        return SimpleNamespace(get_node_id=lambda: self.ids[0])

    def remote(self, what: Any) -> Any:
        def options(**given: Any) -> Any:
            def submit(task: GroupTask) -> Any:
                self.asked.append(given)
                excluded = given.get("label_selector", {}).get("ray.io/node-id", "")
                node = next(key for key in self.ids if key not in excluded)
                if not self.silent:
                    event = GroupStarted(stage=task.stage, group=task.group, node=node, attempt=task.attempt)
                    self.events.mkdir(exist_ok=True)
                    (self.events / task.events).write_text(event.to_json() + "\n")
                return Reference(task, node)

            return SimpleNamespace(remote=submit)

        return SimpleNamespace(options=options)

    def wait(self, references: list[Any], timeout: float, fetch_local: bool) -> tuple[list[Any], list[Any]]:
        return references[:1], references[1:]

    def get(self, reference: Any) -> Any:
        outcome = self.behave(reference.task, reference.node)
        if isinstance(outcome, Exception):
            raise outcome
        return reference.node, outcome

    def cancel(self, reference: Any, force: bool) -> None:
        assert force
        self.cancelled.append(reference.task.group)


class Bake:
    """A stage whose groups are not done at first, and as soon as their task has returned."""

    name, renders = "bake", True

    def __init__(self) -> None:
        self.there, self.asked = True, set()

    @property
    def group_code(self) -> Any:
        return self

    def group_key(self, inputs: Any, group: Any) -> str:
        return f"key {group.index}"

    def group_done(self, inputs: Any, group: Any) -> bool:
        first, self.asked = group.index not in self.asked, self.asked | {group.index}
        return self.there and not first


@pytest.fixture(autouse=True)
def exceptions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Ray's exceptions, whose import would take a second of each process that collects tests."""
    monkeypatch.setattr(Run, "take", Take(tmp_path), raising=False)
    monkeypatch.setattr(module, "RETRIES", 1)
    return pytest.importorskip("ray.exceptions", reason="Ray is not installed (extra cluster)")


class Run:
    """A run of three groups; see `go`."""

    take: Take

    def __init__(self, behave: Behavior, nodes: int = 2, cpus: int = 1, **settings: Any) -> None:
        self.ray, self.settings = FakeRay(behave, nodes, cpus), {"groups_at_once": 1, **settings}
        self.events: list[Any] = []
        self.stage, self.cancellation = Bake(), Cancellation()
        self.finished: list[int] = []

    def go(self) -> None:
        self.ray.events = self.take.group_events
        self.take.private.mkdir(exist_ok=True)
        groups = cut_into_groups(tuple(range(6)), 2)
        config = Config.model_validate({"capture": {"root": "/footage"}, "run": self.settings})
        inputs: Any = SimpleNamespace(take=self.take, config=config, threads=1, groups=groups, since={})
        reporter = StageReporter("bake", self.events.append, self.cancellation, itertools.count().__next__)
        executor = RayExecutor(self.ray)
        stage: Any = self.stage
        executor.run(stage, inputs, groups, reporter, lambda group: self.finished.append(group.index))

    def warnings(self) -> list[str]:
        return [event.code for event in self.events if isinstance(event, Warned)]

    def attempts(self, group: int) -> list[int]:
        return [event.attempt for event in self.events if isinstance(event, GroupStarted) and event.group == group]


def test_groups_are_queued_run_and_done() -> None:
    run = Run(lambda task, node: None)
    run.go()
    assert run.finished == [0, 1, 2]
    assert [run.attempts(group) for group in range(3)] == [[1]] * 3
    assert [event.fraction for event in run.events if isinstance(event, Progress)][-1] == 1.0
    assert {given["num_cpus"] for given in run.ray.asked} == {1}
    assert run.warnings() == []
    run.go()  # nothing is left to do
    assert (run.finished, len(run.ray.asked)) == ([0, 1, 2] * 2, 3)


def test_a_lost_worker_is_replaced(exceptions: Any) -> None:
    lost = []

    def behave(task: GroupTask, node: str) -> Outcome:
        if task.group == 1 and task.attempt == 1:
            lost.append(node)
            return exceptions.WorkerCrashedError()
        return None

    run = Run(behave)
    run.go()
    assert lost
    assert sorted(run.finished) == [0, 1, 2]
    assert run.attempts(1) == [1, 2]
    assert run.warnings() == ["cluster.worker_lost"]


def test_a_group_that_loses_every_worker_ends_the_run(exceptions: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(lambda task, node: exceptions.WorkerCrashedError() if task.group == 0 else None)
    with refuses("cluster.worker_lost", group=0) as caught:
        run.go()
    assert "2 workers, the last on node1 (WorkerCrashedError)" in str(caught.value)
    assert run.attempts(0) == [1, 2]
    monkeypatch.setattr(module, "RETRIES", 0)
    run = Run(run.ray.behave)
    with refuses("cluster.worker_lost", group=0):
        run.go()
    assert run.ray.cancelled == [1, 2], "the others do not go on"


def test_a_node_that_does_not_see_the_footage_gets_nothing_more() -> None:
    def behave(task: GroupTask, node: str) -> Outcome:
        return Message(NOT_VISIBLE, "node1 cannot see the footage", "/footage") if node[0] == "1" else None

    run = Run(behave)
    run.go()
    assert sorted(run.finished) == [0, 1, 2]
    assert run.warnings() == [NOT_VISIBLE]
    assert run.ray.asked[-1]["label_selector"] == {"ray.io/node-id": f"!in({run.ray.ids[0]})"}
    with refuses(NOT_VISIBLE, file="/footage"):
        Run(behave, nodes=1).go()


@pytest.mark.parametrize("of_ray", [True, False])
def test_a_lost_cluster_is_one_sentence(exceptions: Any, monkeypatch: pytest.MonkeyPatch, of_ray: bool) -> None:
    def wait(*_: Any, **__: Any) -> Any:
        raise exceptions.RaySystemError("raylet is gone") if of_ray else ConnectionError("shutting down")

    run = Run(lambda task, node: None)
    monkeypatch.setattr(run.ray, "wait", wait)
    with refuses("cluster.lost"):
        run.go()


def test_groups_that_wait_for_what_others_hold_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BUSY_SECONDS", 0.0)
    asked = []

    def holders(self: Any, wanted: Any) -> str:
        asked.append(wanted)
        return "node1 has 0 of 1 CPU free, held by the actor Busy"

    monkeypatch.setattr(module.Nodes, "holders", holders)
    run = Run(lambda task, node: None)
    run.ray.silent = True  # no task begins, as far as is known
    run.go()
    told = [event for event in run.events if isinstance(event, Warned)]
    assert {event.code for event in told} == {"cluster.busy"}
    assert "node1 has 0 of 1 CPU free, held by the actor Busy" in told[0].message
    run = Run(run.ray.behave)
    run.go()
    assert len(told) == 3
    assert len(asked) == 4, "once the groups of this run are running, they will free their nodes"


def test_groups_that_fit_no_node_are_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "NO_NODE_SECONDS", 0.0)
    run = Run(lambda task, node: None, gpus_per_group=2)
    run.go()
    told = [event for event in run.events if isinstance(event, Warned)]
    assert [event.code for event in told] == ["cluster.no_node"]
    assert "1 CPU, 2 GPUs and 1.1 GB" in told[0].message
    monkeypatch.setattr(module, "NO_NODE_SECONDS", 30.0)
    run = Run(run.ray.behave, gpus_per_group=2)
    run.go()
    assert run.warnings() == [], "a larger node may be starting"


def test_out_of_memory_means_fewer_groups_on_a_node(exceptions: Any) -> None:
    def behave(task: GroupTask, node: str) -> Outcome:
        return exceptions.OutOfMemoryError("full") if (task.group, task.attempt) == (0, 1) else None

    run = Run(behave, nodes=1, cpus=4)
    run.go()
    assert sorted(run.finished) == [0, 1, 2]
    assert run.warnings() == ["cluster.out_of_memory"]
    assert [given["memory"] for given in run.ray.asked] == [GB, GB, GB, 8 * GB]


def test_what_a_task_refuses_names_its_group_and_node() -> None:
    problem = Message("disk.full", "the disk is full", "/disk")
    run = Run(lambda task, node: problem if task.group == 1 else None)
    with refuses("disk.full", group=1, node="node1") as caught:
        run.go()
    assert str(caught.value).startswith("/disk: the disk is full (group 1 on node1).")


def test_files_that_do_not_arrive_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "VISIBLE_SECONDS", 0.0)
    run = Run(lambda task, node: None)
    run.stage.there = False
    with refuses("cluster.result_missing", group=0):
        run.go()


def test_cancelling_cancels_every_task() -> None:
    def behave(task: GroupTask, node: str) -> Outcome:
        run.cancellation.cancel()
        return None

    run = Run(behave)
    with pytest.raises(Cancelled):
        run.go()
    assert run.ray.cancelled == [1, 2]


def sent(**changes: Any) -> GroupTask:
    values: dict[str, Any] = {
        "take": "/no/take", "footage": "/no/footage", "stage": "train", "group": 0, "attempt": 1, "key": "",
        "settings": (), "versions": versions(),
    }  # fmt: skip
    return GroupTask(**values | changes)


def refusal(**changes: Any) -> Message:
    """The answer of a node that lacks something to a task."""
    return run_task(sent(**changes), "")


def test_a_node_says_what_it_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task_module, "VISIBLE_SECONDS", 0.0)
    monkeypatch.setattr(task_module, "LOOK_AGAIN", 0.0)
    other = refusal(versions=("0.0.1", versions()[1]))
    assert other.code == "cluster.version"
    assert "but the run was started with 0.0.1" in other.problem
    other = refusal(versions=(versions()[0], "2.7"))
    assert other.problem.endswith(f"but the run was started with {versions()[0]} on Python 2.7")
    blind = refusal()
    assert (blind.code, blind.file) == (NOT_VISIBLE, "/no/take/take.json")
    (tmp_path / "take.json").write_text('{"format": 2}')
    blind = refusal(take=str(tmp_path))
    assert (blind.code, blind.file) == (NOT_VISIBLE, "/no/footage")
    (tmp_path / "empty").mkdir()
    blind = refusal(take=str(tmp_path), footage=str(tmp_path / "empty"))
    assert (blind.code, blind.file) == (NOT_VISIBLE, str(tmp_path / "empty")), "a folder where nothing is mounted"
    blind = refusal(paths=(("/no", (str(tmp_path), "/net")),))
    assert blind.code == NOT_VISIBLE
    assert f"nor under {tmp_path}/take/take.json, /net/take/take.json" in blind.problem
    (tmp_path / "take").mkdir()
    (tmp_path / "take.json").rename(tmp_path / "take" / "take.json")
    blind = refusal(paths=(("/no", (str(tmp_path),)),))
    assert blind.file == "/no/footage", "the take is found where this node has it"


def test_footage_that_is_there_only_in_part_is_not_seen(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task_module, "VISIBLE_SECONDS", 0.0)
    monkeypatch.setattr(task_module, "LOOK_AGAIN", 0.0)
    take = Take.create(project / "take")
    footage = project / "capture"
    take.config.write_text((project / "ball.yaml").read_text().replace("root: capture", f"root: {footage}"))
    shutil.rmtree(footage / "images")
    (footage / "images").mkdir()  # where another share is mounted on other nodes
    task = sent(take=str(take.root), footage=str(footage), stage="initialize")
    blind = run_task(task, "")
    assert (blind.code, blind.file) == (NOT_VISIBLE, str(footage))
    assert "no image or video matches the pattern" in blind.problem


@pytest.mark.parametrize("code", [NOT_VISIBLE, "stage.dependency", "work.take_changed"])
def test_a_node_waits_for_what_another_one_wrote(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    looks = []

    def do(task: GroupTask, node: str) -> None:
        looks.append(task)
        if len(looks) < 3:
            raise StudioError(code, "not yet")

    monkeypatch.setattr(task_module, "do_task", do)
    monkeypatch.setattr(task_module, "LOOK_AGAIN", 0.0)
    assert run_task(sent(), "") is None
    assert len(looks) == 3


def test_a_cluster_that_cannot_be_reached_is_one_sentence(
    project: Path, here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("RAY_AUTH_MODE", "RAY_USAGE_STATS_ENABLED", "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"):
        monkeypatch.setenv(name, "0")
    arguments = ("run", project / "ball.yaml", "--take", project / "take", "--run.executor", "ray")
    here(*arguments, "--run.address", "127.0.0.1:9").fails("127.0.0.1:9 (Connection refused)")
    here(*arguments, "--run.address", "somewhere").fails("'somewhere' is not")
    monkeypatch.setitem(sys.modules, "ray", None)
    here(*arguments).fails("pip install 'ray[client]==")
