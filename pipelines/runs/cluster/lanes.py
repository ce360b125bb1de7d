"""Progress of groups that run on several machines, together and one by one."""

from dataclasses import replace

from pipelines.events import Emit, GroupState, Metrics, Progress
from pipelines.takes.groups import Group
from studio.counts import counted


class Lanes:
    """Collects what the groups report and emits `GroupState` events. `stage`: the stage that they are in."""

    def __init__(self, stage: str, emit: Emit) -> None:
        self._stage, self._emit = stage, emit
        self._states: dict[int, GroupState] = {}
        self._fractions: dict[int, float] = {}
        self._seconds: dict[int, list[float]] = {}

    def queued(self, group: Group) -> None:
        """A group waits for a node."""
        self._fractions[group.index] = 0.0
        self._change(GroupState(stage=self._stage, group=group.index, state="queued", frames=len(group.frames)))

    def running(self, group: Group, node: str, gpu: str, attempt: int) -> None:
        """A group runs on a node."""
        self._seconds[group.index] = []
        self._change(self._now(group, state="running", node=node, gpu=gpu, attempt=attempt, message=""))

    def progress(self, group: Group, event: Progress) -> None:
        """A group reports progress; emitted with the next frame."""
        self._fractions[group.index] = max(self._fractions[group.index], event.fraction)
        psnr = event.figures.get("psnr")
        if isinstance(psnr, int | float):
            self._states[group.index] = self._now(group, psnr=round(float(psnr), 2))

    def metrics(self, group: Group, event: Metrics) -> None:
        """A group reports the figures of a frame."""
        if event.frame is None or event.frame not in group.frames:
            return
        seconds = event.values.get("seconds")
        if isinstance(seconds, int | float):
            self._seconds.setdefault(group.index, []).append(float(seconds))
        taken = self._seconds.get(group.index)
        mean = round(sum(taken) / len(taken), 2) if taken else None
        done = group.frames.index(event.frame) + 1
        self._change(self._now(group, frames_done=done, seconds_per_frame=mean))

    def retried(self, group: Group, attempt: int, reason: str) -> None:
        """A group is queued again."""
        self._change(self._now(group, state="retried", attempt=attempt, message=reason))

    def done(self, group: Group) -> None:
        """A group's results are in the take."""
        self._fractions[group.index] = 1.0
        self._change(self._now(group, state="done", frames_done=len(group.frames)))

    def failed(self, group: Group, reason: str) -> None:
        """A group failed for good."""
        self._change(self._now(group, state="failed", message=reason))

    @property
    def fraction(self) -> float:
        """Progress of all groups, weighted by their frames, 0 to 1."""
        frames = {index: max(1, state.frames) for index, state in self._states.items()}
        return sum(self._fractions[index] * count for index, count in frames.items()) / max(1, sum(frames.values()))

    @property
    def label(self) -> str:
        """For a progress bar: "3 of 17 groups, 4 running on 2 nodes"."""
        states = list(self._states.values())
        running = [state for state in states if state.state == "running"]
        done = sum(state.state == "done" for state in states)
        nodes = len({state.node for state in running})
        where = (
            f"{len(running)} running on {nodes} {'node' if nodes == 1 else 'nodes'}"
            if running
            else "waiting for a node"
        )
        return f"{done} of {counted(len(states), 'group')}, {where}"

    def _now(self, group: Group, **changes: object) -> GroupState:
        return replace(self._states[group.index], **changes)  # type: ignore[arg-type]

    def _change(self, state: GroupState) -> None:
        import time

        self._states[state.group] = state
        self._emit(replace(state, time=time.time()))
