"""Runs groups as tasks of a Ray cluster and reports them as a local run does.

A task does what `v3studio work` does. Lost workers and nodes that cannot do a task are the executor's business, not
Ray's: so it can say what happened, and choose where a group runs next.
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipelines.events import Metrics, Preview, Progress, Warned, parse_event
from pipelines.runs.cluster.lanes import Lanes
from pipelines.runs.cluster.mailbox import Mailbox
from pipelines.runs.cluster.nodes import Nodes, Wanted
from pipelines.runs.cluster.task import NODE_CODES, NOT_VISIBLE, VISIBLE_SECONDS, GroupTask, run_task, versions
from pipelines.runs.work import cpus_of_group
from pipelines.stages.base import Context, GroupStage, StageReporter
from pipelines.stages.group_scheduler import groups_at_once, memory_of_group
from pipelines.takes.groups import Group
from pipelines.takes.stored_take import stored_take
from studio.errors import Message, StudioError

_WAIT = 0.3
"""Seconds between two looks at the cluster, and before a cancelled run notices it."""

_AHEAD = 8
"""Tasks queued in Ray beyond those that fit, so that nodes never wait and a growing cluster sees the demand."""

_NO_NODE_SECONDS = 30.0
"""How long a task may wait without a node that is large enough before people are told: one may be starting."""

_DELIVERY_SECONDS = 30.0
"""How long a task waits until its last events have arrived. Those of a task that has ended are dropped."""

_PROGRAM_BYTES = 1 << 30
"""Memory of a worker process without images."""


@dataclass
class _Job:
    """A group on its way.

    Attributes:
        group: the group.
        key: its `GroupStage.group_key`.
        cpus: that it takes.
        attempt: 1 at first.
        lost: how often its worker was lost.
        node: id of the node that it runs on; "" while it waits for one, as far as is known.
        wanted: what was asked for it.
    """

    group: Group
    key: str
    cpus: int
    attempt: int = 1
    lost: int = 0
    node: str = ""
    wanted: Wanted | None = None


@dataclass
class RayExecutor:
    """See `pipelines.stages.base.Executor`.

    Attributes:
        ray: the package, connected.
        nodes: of the cluster.
        memory_floor: bytes that each task asks for at least, raised when a node ran out of memory.
    """

    ray: Any
    nodes: Nodes = field(init=False)
    memory_floor: float = 0.0
    _mailbox: Any = None

    def __post_init__(self) -> None:
        self.nodes = Nodes(self.ray)

    @property
    def mailbox(self) -> Any:
        """The actor `Mailbox`, started on first access and after `lose_mailbox`; Ray ends it with the connection."""
        if self._mailbox is None:
            here = self.nodes.on(self.ray.get_runtime_context().get_node_id())
            mailbox = self.ray.remote(Mailbox).options(num_cpus=0, scheduling_strategy=here).remote()
            self.ray.get(mailbox.delivered.remote())  # if memory runs out, Ray first ends what was started last
            self._mailbox = mailbox
        return self._mailbox

    def lose_mailbox(self) -> None:
        """Its process is gone: tasks that are submitted from now on get a new one."""
        self._mailbox = None

    def run(
        self,
        stage: GroupStage,
        context: Context,
        groups: Sequence[Group],
        reporter: StageReporter,
        finished: Callable[[Group], None] = lambda group: None,
    ) -> None:
        """See `pipelines.stages.base.Executor.run`."""
        _Run(self, stage, context, reporter, finished).go(groups)


class _Run:
    """One stage on the cluster."""

    def __init__(
        self,
        executor: RayExecutor,
        stage: GroupStage,
        context: Context,
        reporter: StageReporter,
        finished: Callable[[Group], None],
    ) -> None:
        self._executor, self._ray, self._nodes = executor, executor.ray, executor.nodes
        self._stage, self._context, self._reporter, self._finished = stage, context, reporter, finished
        self._queue: deque[_Job] = deque()
        self._running: dict[Any, _Job] = {}
        self._warned: set[str] = set()
        self._lanes = Lanes(stage.name, context.emit)
        self._figures: dict[str, Any] = {}
        self._unfit_since: float | None = None
        self._stored = stored_take(context.take.root)

    def go(self, groups: Sequence[Group]) -> None:
        """Run the groups; see `RayExecutor.run`.

        Raises:
            StudioError: also if the connection to the cluster is lost (`cluster.lost`).
        """
        from ray.exceptions import RayError

        try:
            self._go(groups)
        except BrokenPipeError:  # whoever reads the events is gone, not the cluster
            raise
        except (RayError, ConnectionError) as error:
            raise StudioError(
                "cluster.lost",
                f"the connection to the cluster was lost ({_last_line(error)})",
                fix="Check that its head node is running, and run again; finished work is kept.",
                stage=self._stage.name,
            ) from error

    def _go(self, groups: Sequence[Group]) -> None:
        ray = self._ray
        if self._stored is not None:
            self._stored.push()
        for group in groups:
            cpus = cpus_of_group(self._stage.name, self._context, group.index)
            self._queue.append(_Job(group, self._stage.group_key(self._context, group), cpus))
            self._lanes.queued(group)
        self._task = ray.remote(_task)
        try:
            while self._queue or self._running:
                self._context.cancellation.check()
                self._submit()
                self._look_for_nodes()
                done, _ = ray.wait(list(self._running), timeout=_WAIT, fetch_local=False)
                self._read_mail()
                for reference in done:
                    if (job := self._running.pop(reference, None)) is not None:
                        self._end(job, reference)
                self._tell()
            self._read_mail()
        finally:
            self._cancel_all()

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
                take=str(self._context.take.root) if self._stored is None else self._stored.address,
                footage=str(self._context.config.capture.root),
                paths=tuple(self._context.config.run.paths.items()),
                stage=self._stage.name,
                group=job.group.index,
                attempt=job.attempt,
                key=job.key,
                settings=self._settings(),
                version=versions()[0],
                python=versions()[1],
            )
            self._running[self._task.options(**options).remote(task, self._executor.mailbox)] = job

    def _look_for_nodes(self) -> None:
        """Warn of groups that no node can run: Ray lets them wait, as a larger node may join."""
        unfit = next(
            (
                job
                for job in self._running.values()
                if not job.node and job.wanted is not None and self._nodes.fitting(job.wanted) == 0
            ),
            None,
        )
        if unfit is None or unfit.wanted is None:
            self._unfit_since = None
            return
        now = time.monotonic()
        if self._unfit_since is None:
            self._unfit_since = now
        if now - self._unfit_since >= _NO_NODE_SECONDS:
            self._warn(
                Message(
                    "cluster.no_node",
                    f"group {unfit.group.index} is waiting for a node with {unfit.wanted}; the cluster has "
                    f"{self._nodes.sizes()}",
                    fix="Add a larger node, or lower run.gpus_per_group or run.memory_per_group.",
                    fields={"group": unfit.group.index},
                )
            )

    def _settings(self) -> tuple[tuple[str, Any], ...]:
        """What a node must not choose itself: the bytes of training depend on the number of threads."""
        context = self._context
        device = context.config.run.device
        return (
            ("run.threads", context.threads),
            ("run.groups_at_once", groups_at_once(context)),
            ("run.device", "cuda" if device.startswith("cuda") else device),  # Ray says which one
            ("run.preview_seconds", context.config.run.preview_seconds),
        )

    def _wanted(self, job: _Job) -> Wanted:
        settings = self._context.config.run
        memory = (settings.memory_per_group or 0.0) * 1e9
        if not memory:
            memory = _PROGRAM_BYTES
            if self._stage.name == "train" and settings.device in ("auto", "cpu"):
                memory += memory_of_group(self._context)
        gpus = settings.gpus_per_group
        if gpus is None:
            gpus = 1.0 if settings.device != "cpu" and self._nodes.most("GPU") > 0 else 0.0
        return Wanted(
            cpus=min(job.cpus, max(1, int(self._nodes.most("CPU")))),
            gpus=0.0 if self._stage.name == "initialize" else gpus,
            memory=int(min(max(memory, self._executor.memory_floor), self._nodes.most("memory") or memory)),
        )

    def _read_mail(self) -> None:
        from ray.exceptions import OutOfMemoryError, RayActorError

        try:
            letters = self._ray.get(self._executor.mailbox.take.remote())
        except (RayActorError, OutOfMemoryError):  # groups that run now go on without figures
            self._executor.lose_mailbox()
            return
        jobs = {(self._stage.name, job.group.index, job.attempt): job for job in self._running.values()}
        for kind, about, content in letters:
            job = jobs.get(about)
            if job is None:  # of an attempt that was given up, or of an earlier stage
                continue
            if kind == "started":
                self._started(job, *content)
            else:
                self._forward(job, parse_event(content[0]))

    def _started(self, job: _Job, node: str, gpu: str = "") -> None:
        job.node = node
        self._lanes.running(job.group, self._nodes.name(node), gpu, job.attempt)

    def _forward(self, job: _Job, event: Any) -> None:
        if isinstance(event, Progress):
            self._lanes.progress(job.group, event)
            self._figures = dict(event.figures)
        elif isinstance(event, Metrics):
            self._lanes.metrics(job.group, event)
            self._context.emit(event)
        elif isinstance(event, Preview) and Path(event.path).is_file():  # not in a folder of that node only
            self._context.emit(event)
        elif isinstance(event, Warned) and event.message not in self._warned:
            self._warned.add(event.message)  # every group says what a local run says once
            self._context.emit(event)

    def _tell(self) -> None:
        self._reporter.progress(self._lanes.fraction, self._lanes.label, **self._figures)

    def _end(self, job: _Job, reference: Any) -> None:
        from ray.exceptions import OutOfMemoryError, RayError, RayTaskError

        try:
            node, problem = self._ray.get(reference)
        except RayTaskError as error:
            raise StudioError(
                "cluster.task_failed",
                f"group {job.group.index} failed on {self._nodes.name(job.node)}: {_last_line(error)}",
                fix="Check that all nodes have the same version of V3 Studio.",
                group=job.group.index,
                node=self._nodes.name(job.node),
            ) from None
        except OutOfMemoryError:
            self._out_of_memory(job)
        except RayError as error:
            self._lost(job, type(error).__name__)
        else:
            if job.node != node:  # its letter is late
                self._started(job, node)
            if problem is None:
                self._arrived(job)
            else:
                self._refused(job, problem)

    def _arrived(self, job: _Job) -> None:
        until = time.monotonic() + VISIBLE_SECONDS
        while not self._is_here(job.group):
            self._context.cancellation.check()
            if time.monotonic() > until:
                raise StudioError(
                    "cluster.result_missing",
                    f"group {job.group.index} was finished on {self._nodes.name(job.node)}, but its files are not "
                    "here, or the take has changed meanwhile",
                    file=self._context.take.root,
                    fix="Use a folder that all nodes share, and do not change settings or footage during a run.",
                    group=job.group.index,
                )
            time.sleep(0.2)
        self._lanes.done(job.group)
        self._finished(job.group)

    def _is_here(self, group: Group) -> bool:
        if self._stored is not None:
            self._stored.pull(group.index)
        return self._stage.group_done(self._context, group)

    def _refused(self, job: _Job, message: Message) -> None:
        if message.code in (NOT_VISIBLE, *NODE_CODES):
            self._nodes.excluded.add(job.node)
            if self._nodes.usable():
                self._warn(message)
                self._again(job, message.problem)
                return
        self._lanes.failed(job.group, str(message))
        where, problem = self._nodes.name(job.node), message.problem
        if "node" not in message.fields:
            problem += f" (group {job.group.index} on {where})"
        fields = {"group": job.group.index, "node": where, **message.fields}
        raise StudioError(message.code, problem, file=message.file, value=message.value, fix=message.fix, **fields)

    def _lost(self, job: _Job, reason: str) -> None:
        job.lost += 1
        name = self._nodes.name(job.node)
        where = f" on {name}" if job.node else ""
        told = f"group {job.group.index}: its worker{where} was lost ({reason})"
        if job.lost > self._context.config.run.retries:
            if job.lost > 1:
                told = f"group {job.group.index} lost {job.lost} workers, the last{where} ({reason})"
            self._lanes.failed(job.group, told)
            raise StudioError(
                "cluster.worker_lost",
                told,
                fix="See the logs of Ray on that node; run.retries allows more attempts.",
                group=job.group.index,
                setting="run.retries",
            )
        self._warn(Message("cluster.worker_lost", f"{told}; it is started again", fields={"group": job.group.index}))
        self._again(job, f"its worker was lost ({reason})")

    def _out_of_memory(self, job: _Job) -> None:
        if job.wanted is not None and job.wanted.memory < self._wanted(job).memory:  # before this was known
            self._again(job, f"{self._nodes.name(job.node)} ran out of memory")
            return
        beside = sum(one.node == job.node for one in self._running.values()) + 1
        share = self._nodes.memory(job.node) / max(1, beside // 2)
        self._executor.memory_floor = max(2 * self._wanted(job).memory, share)
        if beside == 1:
            self._lost(job, "out of memory")
            return
        name = self._nodes.name(job.node)
        self._warn(
            Message(
                "cluster.out_of_memory",
                f"{name} ran out of memory with {beside} groups; fewer run at once on a node from now on",
                fix="Set run.memory_per_group to what a group takes.",
                fields={"group": job.group.index, "setting": "run.memory_per_group"},
            )
        )
        self._ask_anew()
        self._again(job, f"{name} ran out of memory")

    def _ask_anew(self) -> None:
        """Take back tasks that wait in Ray, which would start with less memory than is known now to be needed."""
        waiting = [reference for reference, job in self._running.items() if not job.node]
        for reference in reversed(waiting):
            self._ray.cancel(reference, force=True)
            self._queue.appendleft(self._running.pop(reference))

    def _again(self, job: _Job, reason: str) -> None:
        job.attempt += 1
        job.node = ""
        self._queue.appendleft(job)
        self._lanes.retried(job.group, job.attempt, reason)

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


def _task(task: GroupTask, mailbox: Any) -> tuple[str, Message | None]:
    """The node's id, and what `run_task` returns."""
    import ray

    node = ray.get_runtime_context().get_node_id()
    problem = run_task(task, mailbox, node)
    with contextlib.suppress(ray.exceptions.RayError):  # figures that are lost must not lose the group
        ray.get(mailbox.delivered.remote(), timeout=_DELIVERY_SECONDS)
    return node, problem


def _last_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return (lines or [type(error).__name__])[-1][:300]
