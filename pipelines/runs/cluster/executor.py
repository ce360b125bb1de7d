"""Runs groups as tasks of a Ray cluster and reports them as a local run does.

A task is one stage of one group. It writes its events to a file in the take, which this process follows. The executor,
not Ray, handles lost workers and nodes that cannot run a task: it can report what happened, and choose where
a group runs next.
"""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from v3studio.pipelines.events import GroupStarted, Metrics, Preview, Progress, Warned
from v3studio.pipelines.events.event_log import LogFollower
from v3studio.pipelines.runs.cluster.nodes import Nodes, Wanted
from v3studio.pipelines.runs.cluster.task import NODE_CODES, NOT_VISIBLE, VISIBLE_SECONDS, GroupTask, run_task, versions
from v3studio.pipelines.stages import Stage
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.group_scheduler import groups_at_once, memory_of_group, threads_of_groups
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.studio.atomic_files import remove
from v3studio.studio.counts import counted
from v3studio.studio.errors import Message, StudioError

_WAIT = 0.3  # seconds between two looks at the cluster, and before a cancelled run notices it
RETRIES = 3  # how often a group is started again after its worker was lost
_AHEAD = 8  # tasks queued in Ray beyond those that fit, so that nodes never wait and a growing cluster sees the demand

NO_NODE_SECONDS = 30.0
"""The time that a task waits without a node that is large enough before a warning: one may be starting."""

BUSY_SECONDS = 60.0  # how long all groups may wait for nodes that others hold before a warning
_PROGRAM_BYTES = 1 << 30  # memory of a worker process without images


@dataclass
class _Job:
    """A group on its way. `node`: id of the node that it runs on; "" while it waits for one, as far as is known."""

    group: Group
    key: str
    cpus: int
    attempt: int = 1
    lost: int = 0
    node: str = ""
    wanted: Wanted | None = None
    log: LogFollower | None = None


@dataclass
class RayExecutor:
    """An `Executor` on a Ray cluster. `memory_floor`: bytes of each task, raised after one ran out."""

    ray: Any
    nodes: Nodes = field(init=False)
    memory_floor: float = 0.0

    def __post_init__(self) -> None:
        self.nodes = Nodes(self.ray)

    def run(
        self,
        stage: Stage,
        inputs: Inputs,
        groups: Sequence[Group],
        reporter: StageReporter,
        finished: Callable[[Group], None] = lambda group: None,
    ) -> None:
        from ray.exceptions import RayError

        try:
            _Run(self, stage, inputs, reporter, finished).go(groups)
        except BrokenPipeError:  # anyone who reads the events is gone, not the cluster
            raise
        except (RayError, ConnectionError) as error:
            problem = f"the connection to the cluster was lost ({_last_line(error)})"
            fix = "Check that its head node is running, and run again; finished work is kept."
            raise StudioError("cluster.lost", problem, fix=fix, stage=stage.name) from error


@dataclass(eq=False)
class _Run:
    """One stage on the cluster."""

    _executor: RayExecutor
    _stage: Stage
    _inputs: Inputs
    _reporter: StageReporter
    _finished: Callable[[Group], None]

    def __post_init__(self) -> None:
        self._ray, self._nodes = self._executor.ray, self._executor.nodes
        self._queue: deque[_Job] = deque()
        self._running: dict[Any, _Job] = {}
        self._warned: set[str] = set()
        self._groups: list[Group] = []  # that were not finished before
        self._fractions: dict[int, float] = {}  # progress of each of them, by index
        self._figures: dict[str, Any] = {}
        self._waiting: dict[str, float] = {}

    def go(self, groups: Sequence[Group]) -> None:
        ray = self._ray
        remove(self._inputs.take.group_events)
        for group in groups:
            if self._stage.group_code.group_done(self._inputs, group):
                self._finished(group)
                continue
            # as many threads as in a local run, which the bytes of training depend on
            cpus = threads_of_groups(self._inputs)[group.index] if self._stage.name == "train" else self._inputs.threads
            self._queue.append(_Job(group, self._stage.group_code.group_key(self._inputs, group), cpus))
            self._groups.append(group)
            self._fractions[group.index] = 0.0
        self._task = ray.remote(_task)
        try:
            while self._queue or self._running:
                self._reporter.check()
                self._submit()
                self._check_waiting()
                done, _ = ray.wait(list(self._running), timeout=_WAIT, fetch_local=False)
                self._read_events()  # also the last ones of those that are done
                for reference in done:
                    if (job := self._running.pop(reference, None)) is not None:
                        self._end(job, reference)
                self._report_progress()
        finally:
            self._cancel_all()

    def _report_progress(self) -> None:
        """Report the progress of all groups, weighted by their frames, and how many run where."""
        done = sum(len(group.frames) * self._fractions[group.index] for group in self._groups)
        finished = len(self._groups) - len(self._queue) - len(self._running)
        nodes = [job.node for job in self._running.values() if job.node]
        where = f"{len(nodes)} running on {counted(len(set(nodes)), 'node')}" if nodes else "waiting for a node"
        label = f"{finished} of {counted(len(self._groups), 'group')}, {where}"
        self._reporter.progress(done / sum(len(group.frames) for group in self._groups), label, **self._figures)

    def _submit(self) -> None:
        while self._queue:
            job = self._queue[0]
            wanted = self._wanted(job)
            if len(self._running) >= self._nodes.fitting(wanted) + _AHEAD:
                return
            options: dict[str, Any] = {
                "num_cpus": wanted.cpus,
                "num_gpus": wanted.gpus,
                "memory": wanted.memory,
                "max_retries": 0,
            }
            if self._nodes.excluded:
                options["label_selector"] = {"ray.io/node-id": f"!in({','.join(sorted(self._nodes.excluded))})"}
            self._queue.popleft()
            job.wanted = wanted
            task = GroupTask(
                take=str(self._inputs.take.root),
                footage=str(self._inputs.config.capture.root),
                paths=tuple(self._inputs.config.run.paths.items()),
                stage=self._stage.name,
                group=job.group.index,
                attempt=job.attempt,
                key=job.key,
                settings=self._settings(),
                versions=versions(),
                since=self._inputs.since.get(self._stage.name, 0),
            )
            job.log = LogFollower(self._inputs.take.group_events / task.events)
            self._running[self._task.options(**options).remote(task)] = job

    def _check_waiting(self) -> None:
        """Warn of a group that no node can run, since Ray lets it wait for a larger node; and of groups that wait for
        nodes that others hold."""
        waiting = [(job, job.wanted) for job in self._running.values() if not job.node and job.wanted is not None]
        unfit = next(((job, wanted) for job, wanted in waiting if self._nodes.fitting(wanted) == 0), None)
        if self._waited("unfit", unfit is not None) >= NO_NODE_SECONDS and unfit is not None:
            job, wanted = unfit
            problem = (
                f"group {job.group.index} is waiting for a node with {wanted}; the cluster has {self._nodes.sizes()}"
            )
            fix = "Add a larger node, or lower run.gpus_per_group or run.memory_per_group."
            self._warn(Message("cluster.no_node", problem, fix=fix, fields={"group": job.group.index}))
        # if a group of this run is running, it will free its node
        stuck = unfit is None and bool(waiting) and len(waiting) == len(self._running)
        if (seconds := self._waited("busy", stuck)) >= BUSY_SECONDS and stuck:
            del self._waiting["busy"]
            job, wanted = waiting[0]
            holders = self._nodes.holders(wanted)
            if holders:
                problem = f"group {job.group.index} has been waiting for {wanted} for {seconds:.0f} s: {holders}"
                fix = "Wait for what holds the nodes, stop it, or add a node."
                self._warn(Message("cluster.busy", problem, fix=fix, fields={"group": job.group.index}))

    def _waited(self, name: str, condition: bool) -> float:
        """Seconds for which a condition has held at every check."""
        if not condition:
            self._waiting.pop(name, None)
            return 0.0
        now = time.monotonic()
        return now - self._waiting.setdefault(name, now)

    def _settings(self) -> tuple[tuple[str, Any], ...]:
        """Settings that a node must not choose itself: the bytes of training depend on the number of threads."""
        inputs = self._inputs
        device = inputs.config.run.device
        return (
            ("run.threads", inputs.threads),
            ("run.groups_at_once", groups_at_once(inputs)),
            ("run.device", "cuda" if device.startswith("cuda") else device),  # Ray says which one
            ("run.preview_seconds", inputs.config.run.preview_seconds),
        )

    def _wanted(self, job: _Job) -> Wanted:
        settings = self._inputs.config.run
        memory = (settings.memory_per_group or 0.0) * 1e9
        if not memory:
            memory = _PROGRAM_BYTES
            if self._stage.name == "train" and settings.device in ("auto", "cpu"):
                memory += memory_of_group(self._inputs)
        gpus = settings.gpus_per_group
        if gpus is None:
            gpus = 1.0 if settings.device != "cpu" and self._nodes.most("GPU") > 0 else 0.0
        return Wanted(
            cpus=min(job.cpus, max(1, int(self._nodes.most("CPU")))),
            gpus=gpus if self._stage.renders else 0.0,
            memory=int(min(max(memory, self._executor.memory_floor), self._nodes.most("memory") or memory)),
        )

    def _read_events(self) -> None:
        for job in self._running.values():
            for event in job.log.poll()[1] if job.log is not None else ():
                if isinstance(event, GroupStarted):
                    self._started(job, event.node, event.gpu)
                else:
                    self._forward(job, event)

    def _started(self, job: _Job, node: str, gpu: str = "") -> None:
        job.node = node
        name, stage = self._nodes.name(node), self._stage.name
        self._reporter.emit(GroupStarted(stage=stage, group=job.group.index, node=name, gpu=gpu, attempt=job.attempt))

    def _forward(self, job: _Job, event: Any) -> None:
        if isinstance(event, Progress):
            index = job.group.index
            self._fractions[index] = max(self._fractions[index], event.fraction)
            self._figures = dict(event.figures)
        elif isinstance(event, Metrics) or (isinstance(event, Preview) and Path(event.path).is_file()):
            self._reporter.emit(event)  # not images in a folder of that node only
        elif isinstance(event, Warned) and event.message not in self._warned:
            self._warned.add(event.message)  # every group says what a local run says once
            self._reporter.emit(event)

    def _end(self, job: _Job, reference: Any) -> None:
        from ray.exceptions import OutOfMemoryError, RayError, RayTaskError

        try:
            node, problem = self._ray.get(reference)
        except RayTaskError as error:
            problem = f"group {job.group.index} failed on {self._nodes.name(job.node)}: {_last_line(error)}"
            fix = "Check that all nodes have the same version of V3 Studio."
            raise StudioError(
                "cluster.task_failed", problem, fix=fix, group=job.group.index, node=self._nodes.name(job.node)
            ) from None
        except OutOfMemoryError:
            self._out_of_memory(job)
        except RayError as error:
            self._lost(job, type(error).__name__)
        else:
            if job.node != node:  # it could not write to the take
                self._started(job, node)
            if problem is None:
                self._arrived(job)
            else:
                self._refused(job, problem)

    def _arrived(self, job: _Job) -> None:
        until = time.monotonic() + VISIBLE_SECONDS
        while not self._stage.group_code.group_done(self._inputs, job.group):
            self._reporter.check()
            if time.monotonic() > until:
                raise StudioError(
                    "cluster.result_missing",
                    f"group {job.group.index} was finished on {self._nodes.name(job.node)}, but its files are not "
                    "here, or the take has changed meanwhile",
                    file=self._inputs.take.root,
                    fix="Use a folder that all nodes share, and do not change settings or footage during a run.",
                    group=job.group.index,
                )
            time.sleep(0.2)
        self._fractions[job.group.index] = 1.0
        self._finished(job.group)

    def _refused(self, job: _Job, message: Message) -> None:
        if message.code in (NOT_VISIBLE, *NODE_CODES):
            self._nodes.excluded.add(job.node)
            if self._nodes.usable():
                self._warn(message)
                self._again(job)
                return
        where, problem = self._nodes.name(job.node), message.problem
        if "node" not in message.fields:
            problem += f" (group {job.group.index} on {where})"
        fields = {"group": job.group.index, "node": where, **message.fields}
        raise StudioError.of(replace(message, problem=problem, fields=fields))

    def _lost(self, job: _Job, reason: str) -> None:
        job.lost += 1
        name = self._nodes.name(job.node)
        where = f" on {name}" if job.node else ""
        told = f"group {job.group.index}: its worker{where} was lost ({reason})"
        if job.lost > RETRIES:
            if job.lost > 1:
                told = f"group {job.group.index} lost {job.lost} workers, the last{where} ({reason})"
            fix = "See the logs of Ray on that node."
            raise StudioError("cluster.worker_lost", told, fix=fix, group=job.group.index)
        self._warn(Message("cluster.worker_lost", f"{told}; it is started again", fields={"group": job.group.index}))
        self._again(job)

    def _out_of_memory(self, job: _Job) -> None:
        if job.wanted is not None and job.wanted.memory < self._wanted(job).memory:  # before this was known
            self._again(job)
            return
        beside = sum(other.node == job.node for other in self._running.values()) + 1
        share = self._nodes.memory(job.node) / max(1, beside // 2)
        self._executor.memory_floor = max(2 * self._wanted(job).memory, share)
        if beside == 1:
            self._lost(job, "out of memory")
            return
        name = self._nodes.name(job.node)
        problem = f"{name} ran out of memory with {beside} groups; fewer run at once on a node from now on"
        fix = "Set run.memory_per_group to what a group takes."
        fields = {"group": job.group.index, "setting": "run.memory_per_group"}
        self._warn(Message("cluster.out_of_memory", problem, fix=fix, fields=fields))
        # tasks that wait in Ray would start with less memory than is known now to be needed
        waiting = [reference for reference, job in self._running.items() if not job.node]
        for reference in reversed(waiting):
            self._ray.cancel(reference, force=True)
            self._queue.appendleft(self._running.pop(reference))
        self._again(job)

    def _again(self, job: _Job) -> None:
        job.attempt += 1
        job.node = ""
        self._queue.appendleft(job)

    def _warn(self, message: Message) -> None:
        if str(message) not in self._warned:
            self._warned.add(str(message))
            self._reporter.warn(message)

    def _cancel_all(self) -> None:
        from ray.exceptions import RayError

        for reference in self._running:
            try:
                self._ray.cancel(reference, force=True)
            except (RayError, ConnectionError, RuntimeError):
                continue


def _task(task: GroupTask) -> tuple[str, Message | None]:
    """The node's id, and what `run_task` returns."""
    import ray

    node = ray.get_runtime_context().get_node_id()
    return node, run_task(task, node)


def _last_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return (lines or [type(error).__name__])[-1][:300]
