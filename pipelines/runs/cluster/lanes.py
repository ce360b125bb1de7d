"""Progress of groups that run on several machines, together and one by one."""

import time
from dataclasses import replace

from v3studio.pipelines.events import Emit, GroupState, Metrics, Progress
from v3studio.pipelines.takes.groups import Group
from v3studio.studio.counts import counted


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
        queued = GroupState(stage=self._stage, group=group.index, state="queued", frames=len(group.frames))
        self._states[group.index] = queued
        self.change(group)

    def running(self, group: Group, node: str, gpu: str, attempt: int) -> None:
        """A group runs on a node."""
        self._seconds[group.index] = []
        self.change(group, state="running", node=node, gpu=gpu, attempt=attempt, message="")

    def progress(self, group: Group, event: Progress) -> None:
        """A group reports progress; emitted with the next frame."""
        self._fractions[group.index] = max(self._fractions[group.index], event.fraction)
        psnr = event.figures.get("psnr")
        if isinstance(psnr, int | float):
            self._states[group.index] = replace(self._states[group.index], psnr=round(float(psnr), 2))

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
        self.change(group, frames_done=done, seconds_per_frame=mean)

    def done(self, group: Group) -> None:
        """A group's results are in the take."""
        self._fractions[group.index] = 1.0
        self.change(group, state="done", frames_done=len(group.frames))

    def change(self, group: Group, **changes: object) -> None:
        """Emit the state of a group with other attributes of `GroupState`."""
        changed = replace(self._states[group.index], **changes, time=time.time())  # type: ignore[arg-type]
        self._states[group.index] = changed
        self._emit(changed)

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
        where = f"{len(running)} running on {counted(nodes, 'node')}" if running else "waiting for a node"
        return f"{done} of {counted(len(states), 'group')}, {where}"
