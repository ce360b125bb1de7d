"""The bitrate at other QPs, measured on the first frames of a take."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Hashable
from pathlib import Path

from gui.presenters.run.workspace import Workspace
from pipelines.takes.frame_files import read_frame
from studio.errors import StudioError
from studio.stream.settings import BakeSettings

TRIED_QPS = (14, 18, 20, 22, 26, 30, 36)
TRIED_FRAMES = 5

NO_TARGET: dict[str, None] = {"target_kb_per_frame": None, "target_psnr": None}
"""Overrides that disable targets, which would choose the QP."""


class QpTrial:
    """Encodes the first frames of the take at several QPs on a thread.

    Attributes:
        results: QP to bytes per frame.
        words: description, or the error.
        fps: frame rate of the take.
        changes: incremented with each result.
    """

    def __init__(self) -> None:
        self.results: dict[int, float] = {}
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
        files, starts = take.trained_files()
        if not files:
            raise StudioError("take.not_trained", "no trained frames to bake yet", fix="Run Train.")
        end = starts[1] if len(starts) > 1 else len(files)
        files = files[: min(end, TRIED_FRAMES)]
        of = (
            tuple(files),
            files[-1].stat().st_mtime_ns,
            context.config.bake.model_copy(update={"qp": 0}).model_dump_json(),
        )
        if of == self._of:
            return
        self.stop()
        self._of, self.results = of, {}
        self.fps = float(context.footage.raw.fps)
        self.words = f"The first {len(files)} frames, encoded at other QPs:"
        self._stop = threading.Event()
        section = context.config.bake
        self._thread = threading.Thread(
            target=self._run, args=(files, section, self._stop), name="v3studio trial", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """Stop before the next QP."""
        self._stop.set()

    def _run(self, files: list[Path], section: BakeSettings, stop: threading.Event) -> None:
        from studio.stream import bake_group

        try:
            frames = [read_frame(path) for path in files]
            for qp in TRIED_QPS:
                if stop.is_set():
                    return
                with tempfile.TemporaryDirectory() as folder:
                    settings = section.replace(qp=qp, ladder=(), **NO_TARGET)
                    # with bake.splats, how many are left out decides the size, hardly which
                    share = frames[0].opacities.numpy
                    entry = bake_group(frames, Path(folder), 0, 0, settings, threads=1, contribution=share)
                self.results[qp] = entry.bytes / entry.frame_count
                self.changes += 1
        except StudioError as error:
            self.words = str(error)
        self.changes += 1
