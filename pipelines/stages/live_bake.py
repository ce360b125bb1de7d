"""Bakes and publishes groups while later ones are trained (`bake.live`)."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from pipelines.events.cancellation import Cancellation
from pipelines.stages.bake import BakeStage
from pipelines.stages.base import Context, StageReporter
from studio.errors import Cancelled, Message, StudioError
from studio.json_types import JsonData

if TYPE_CHECKING:
    from studio.stream import BakedGroup, GroupLadder


class LiveBake:
    """A thread that bakes each group of the stream as soon as its frames are trained; groups are published in order.

    The manifest never shrinks while it is the same stream: after an interruption, what was published stays until as
    many groups are valid again. A stream that was made from something else is replaced with the first group.

    Use it as a context manager around training. At its normal end, the remaining groups are baked and the manifest says
    that the stream is complete; after an exception, baking is stopped and what is published stays. A group that cannot
    be baked is reported as a warning, and the stage `bake`, which uses the same files, will try again: training is not
    lost to it.

    Args:
        context: of the stage `train`.
        reporter: of the stage `train`.
        finished: number of trained frames by group.
    """

    def __init__(self, context: Context, reporter: StageReporter, finished: Mapping[int, int]) -> None:
        self._context, self._reporter = context, reporter
        self._finished = dict(finished)
        self._stage = BakeStage()
        self._stop = Cancellation()
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="live-bake", daemon=True)

    def written(self, group: int, frames: int) -> None:
        """The first `frames` frames of a group are trained and written."""
        with self._changed:
            self._finished[group] = frames
            self._changed.notify_all()

    def __enter__(self) -> LiveBake:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._end()
        try:
            while self._thread.is_alive():
                self._thread.join(0.2)
                self._context.cancellation.check()
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
        torch.set_num_threads(self._context.threads)
        try:
            self._bake_all()
        except Cancelled:
            pass
        except Exception as error:
            problem = error.message.problem if isinstance(error, StudioError) else f"{type(error).__name__}: {error}"
            self._reporter.warn(
                Message(
                    "bake.live_failed",
                    f"groups are no longer published while they are trained ({problem})",
                    fix="The stage bake will try again after training.",
                )
            )

    def _bake_all(self) -> None:
        parts = self._stage.parts(self._context)
        old = self._published()
        reporter = _Silent(self._reporter.stage, self._context, stop=self._stop)
        entries: list[BakedGroup] = []
        for part in parts:
            self._wait_for(part.trained.index, self._stage.frames_needed(self._context, part))
            entries.append(self._stage.bake_part(self._context, part, reporter))
            live = len(entries) < len(parts)
            if live and len(entries) <= len(old) and entries == list(old[: len(entries)]):
                continue  # the same stream, of which more is published
            old = ()
            self._stage.publish(self._context, entries, live, self._reporter)
            self._reporter.log(f"group {part.index} of the stream is published")

    def _published(self) -> Sequence[GroupLadder]:
        """Groups of the take's stream; none if there is no valid one of version 3."""
        from studio.stream import StreamReader

        try:
            with StreamReader.open(self._context.take.stream) as reader:
                index = reader.index
                return () if index is None else tuple(index.ladder(number) for number in range(len(index)))
        except StudioError:
            return ()

    def _wait_for(self, group: int, frames: int) -> None:
        with self._changed:
            while self._finished[group] < frames:
                self._stop.check()
                self._changed.wait()
        self._stop.check()


class _Silent(StageReporter):
    """Progress of the background work only checks for cancellation; that of training is shown."""

    def __init__(self, stage: str, context: Context, stop: Cancellation) -> None:
        super().__init__(stage, context)
        self._stop = stop

    def progress(self, fraction: float, label: str = "", **figures: JsonData) -> None:
        """See `StageReporter.progress`. Raises Cancelled."""
        self._stop.check()
        self.context.cancellation.check()
