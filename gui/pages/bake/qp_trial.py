"""Size and quality at other QPs, measured on a whole group of a take."""

from __future__ import annotations

import math
import tempfile
import threading
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gui.models.stages import (
    Inputs,
    Part,
    RenderedError,
    edited_group,
    planned_parts,
    rendered_contribution,
    stream_cameras,
)
from gui.models.take.workspace import Workspace
from studio.comparison.metrics import HIGHEST_PSNR
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.stream.settings import BakeSettings

TRIED_QPS = (14, 18, 20, 22, 26, 30, 36)
MEASURED_FRAMES = 3
"""Frames of the group whose error is measured: the keyframe, one in the middle, the last."""


@dataclass(frozen=True)
class Trial:
    """What a QP gives.

    Attributes:
        bytes_per_frame: bytes of the group divided by its frames.
        psnr: dB, of the decoded splats' images against those of the trained ones, measured as for
            a target PSNR; mean over the measured frames.
    """

    bytes_per_frame: float
    psnr: float


class QpTrial:
    """Bakes the longest group of the take at several QPs on a thread, exactly as the stage `bake` does. A few frames
    alone would give too much weight to the keyframe.

    Attributes:
        results: by QP.
        words: description, or the error.
        fps: frame rate of the take.
        changes: incremented with each result.
    """

    def __init__(self) -> None:
        self.results: dict[int, Trial] = {}
        self.words = ""
        self.fps = 30.0
        self.changes = 0
        self._of: Hashable = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def running(self) -> bool:
        """Whether it is running."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, workspace: Workspace) -> None:
        """Start, unless these frames and settings have already been tried.

        Raises:
            StudioError: `take.not_trained`.
        """
        take, context = workspace.take, workspace.context
        assert take is not None
        assert context is not None
        files, _ = take.trained_files()
        trained = [part for part in planned_parts(context) if part.indices[-1] < len(files)]
        if not trained:
            raise StudioError("take.not_trained", "no trained group to bake yet", fix="Run Train.")
        part = max(trained, key=lambda part: len(part.indices))
        of = (
            tuple(files),
            files[part.indices[-1]].stat().st_mtime_ns,
            context.config.bake.model_copy(update={"quality": 0}).model_dump_json(),
            context.edits.model_dump_json(),
        )
        if of == self._of:
            return
        self.stop()
        self._of, self.results = of, {}
        self.fps = float(context.footage.raw.fps)
        count = len(part.indices)
        frames = f"frames {part.indices[0]} to {part.indices[-1]}" if count > 1 else f"frame {part.indices[0]}"
        self.words = f"Group {part.index} ({frames}) baked at other QPs. PSNR: decoded against trained."
        self._stop = threading.Event()
        self._thread = threading.Thread(
            target=self._run,
            args=(Inputs(take, context.config), part, self.results, self._stop),
            name="v3studio trial",
            daemon=True,
        )
        self._thread.start()

    def stop(self) -> None:
        """Stop before the next QP."""
        self._stop.set()

    def _run(self, context: Inputs, part: Part, results: dict[int, Trial], stop: threading.Event) -> None:
        try:
            qps = sorted({*TRIED_QPS, context.config.bake.qp})
            # the extremes and the current one first: a curve is there early
            qps.sort(key=lambda qp: (qp != context.config.bake.qp, qp not in (TRIED_QPS[0], TRIED_QPS[-1]), qp))
            for qp in qps:
                if stop.is_set():
                    return
                settings = context.config.bake.replace(quality=qp, ladder=())
                results[qp] = measure(context, part, settings)
                self.changes += 1
        except StudioError as error:
            self.words = str(error)
        self.changes += 1


def measure(context: Inputs, part: Part, settings: BakeSettings) -> Trial:
    """Bake a group into a temporary folder and compare some of its decoded frames with the trained ones.

    Args:
        context: of the take; its footage gives the cameras that frames are compared from.
        part: the group.
        settings: with the QP to try, without targets.
    """
    from pipelines.takes.edited import EditedFrames
    from studio.stream import StreamReader, bake_group, write_manifest

    frames = EditedFrames(edited_group(context, part), part.indices)
    cameras, background = stream_cameras(context), context.config.capture.background
    error = RenderedError(frames, cameras, background, context.device)
    fps = float(context.footage.raw.fps)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "stream"
        entry = bake_group(
            frames,
            folder,
            0,
            0,
            settings,
            threads=1,
            fps=fps,
            contribution=lambda: rendered_contribution(frames, cameras, context.device, lambda: None),
        )
        write_manifest(folder, [entry], fps, settings, {})
        last = len(part.indices) - 1
        measured = sorted({round(last * step / (MEASURED_FRAMES - 1)) for step in range(MEASURED_FRAMES)})
        with StreamReader.open(folder) as reader:
            errors = [error(index, reader.gaussians(index)) for index in measured]
    mean = sum(errors) / len(errors)
    psnr = min(-10 * math.log10(mean), HIGHEST_PSNR) if mean > 0 else HIGHEST_PSNR
    return Trial(entry.best.bytes / entry.frame_count, psnr)
