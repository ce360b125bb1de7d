"""Bakes and publishes groups while later ones are trained (`run.live`)."""

from __future__ import annotations

import threading
from collections.abc import Set
from contextlib import suppress
from typing import TYPE_CHECKING

from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages import CHAIN, stage_named
from v3studio.pipelines.stages.baking.encode import encode_once
from v3studio.pipelines.stages.baking.plan import BakePlan
from v3studio.pipelines.stages.baking.publish import publish
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.results.stage_files import BakedGroupNote
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import Cancelled, Message, StudioError
from v3studio.studio.json_types import JsonData

if TYPE_CHECKING:
    from v3studio.studio.stream import GroupEntry


class LiveBake:
    """A thread that bakes each group of the stream as soon as its frames are trained; groups are published in order.

    The manifest never shrinks while it is the same stream: after an interruption, what was published stays until as
    many groups are valid again. A stream that was made from something else is replaced with the first group.

    Use it as a context manager around training. At its normal end, the remaining groups are baked and the manifest says
    that the stream is complete; after an exception, baking is stopped and what is published stays. A group that cannot
    be baked is reported as a warning, and the stage `bake`, which uses the same files, will try again: training is not
    lost to it.
    """

    def __init__(self, inputs: Inputs, reporter: StageReporter, finished: Set[int]) -> None:
        self._inputs, self._reporter = inputs, reporter
        self._finished = set(finished)
        self._stop = Cancellation()
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="live-bake", daemon=True)

    def written(self, group: int) -> None:
        """All frames of a group are trained and written."""
        with self._changed:
            self._finished.add(group)
            self._changed.notify_all()

    def __enter__(self) -> LiveBake:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is not None:
            self._end()
        try:
            while self._thread.is_alive():
                self._thread.join(0.2)
                self._reporter.check()
        finally:
            self._end()
            self._thread.join()

    def _end(self) -> None:
        self._stop.cancel()
        with self._changed:
            self._changed.notify_all()

    def _work(self) -> None:
        import torch

        torch.get_num_threads()  # as in run_groups
        torch.set_num_threads(self._inputs.threads)
        try:
            self._bake_all()
        except Cancelled:
            pass
        except Exception as error:
            reason = error.message.problem if isinstance(error, StudioError) else f"{type(error).__name__}: {error}"
            problem = f"groups are no longer published while they are trained ({reason})"
            fix = "The stage bake will try again after training."
            self._reporter.warn(Message("bake.live_failed", problem, fix=fix))

    def _bake_all(self) -> None:
        from v3studio.studio.stream import GroupEntry

        plan = BakePlan(self._inputs)
        old = _published(self._inputs.take)
        background = _BackgroundReporter(self._reporter, self._stop)
        notes: list[BakedGroupNote] = []
        for part in plan.parts:
            self._wait_for(part.trained.index)
            for stage in CHAIN[CHAIN.index("train") + 1 : CHAIN.index("bake")]:
                stage_named(stage).make_group(self._inputs, part.trained, background)
            notes.append(encode_once(plan, part, background, 0.0, 1.0))
            live = len(notes) < len(plan.parts)
            baked = [GroupEntry.from_dict(note.entry) for note in notes]
            if live and len(baked) <= len(old) and baked == old[: len(baked)]:
                continue  # the same stream, of which more is published
            old = []
            publish(plan, notes, live, self._reporter)
            self._reporter.log(f"group {part.index} of the stream is published")

    def _wait_for(self, group: int) -> None:
        with self._changed:
            while group not in self._finished:
                self._stop.check()
                self._changed.wait()
        self._stop.check()


def _published(take: Take) -> list[GroupEntry]:
    """Groups of the take's stream; none if there is no valid one."""
    from v3studio.studio.stream import StreamReader

    with suppress(StudioError), StreamReader.open(take.stream) as reader:
        return [reader.index.group(number) for number in range(len(reader.index))]
    return []


class _BackgroundReporter(StageReporter):
    """Progress of the background work only checks for cancellation; that of training is shown."""

    def __init__(self, training: StageReporter, stop: Cancellation) -> None:
        super().__init__(training.stage, training.emit, training.cancellation, training.clock)
        self._stop = stop

    def check(self) -> None:
        """Raise Cancelled if the run was cancelled, or training has ended."""
        self._stop.check()
        super().check()

    def progress(self, fraction: float, label: str = "", **figures: JsonData) -> None:
        """Check, and show nothing: progress of training is shown. Raises Cancelled."""
        self.check()
