"""Capture: all cameras at the current frame with mattes, and problems in the footage."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Sequence
from pathlib import Path

import numpy as np

from gui.presenters.drawing.canvas import Canvas, line_height, wrapped
from gui.presenters.drawing.palette import ACCENT, BAD, DIM, GROUND, RAISED, TEXT
from gui.presenters.run.workspace import Workspace
from gui.presenters.stages.stage_view import Size, StageView, rectangle, sentence
from pipelines.stages.base import Context
from studio.capture import Footage, check_footage, open_footage
from studio.errors import Cancelled, StudioError

TINT = np.array(ACCENT, np.float32)

WIDE, WIDEST = 480, 2048
"""Most columns of a thumbnail, and of the image of one camera."""


class CaptureView(StageView):
    """Thumbnails of all cameras, or one of them (`camera`): with the matte as an overlay, without it, or cut out."""

    modes = ("mask overlay", "images", "performer")

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._footage: Footage | None = None
        self._footage_of: object = None
        self._check = FootageCheck()

    def state(self) -> Hashable:
        """The capture settings, the frame, the mode, the result of the check."""
        config = self.workspace.config
        capture = config.capture if config is not None else self.workspace.without_settings
        return (capture, self.camera, self.frame, self.mode, self._check.words, tuple(self._check.problems), self.em)

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        """See `StageView`."""
        footage = self._open()
        if footage is None:
            return sentence(size, self.workspace.without_settings, self.em)
        problems = [*map(str, footage.problems), *self._check.problems]
        lines = [line for problem in problems for line in wrapped(problem, self._small, size[0] - 2 * self.em)]
        room = min(len(lines), 8)
        bottom = (room + 1.2) * line_height(self._small) if lines or self._check.words else 0
        canvas = Canvas(*size, GROUND)
        frame = footage.frames[min(self.frame, len(footage.frames) - 1)]
        self._thumbnails(canvas, footage, frame, size[1] - bottom)
        y = size[1] - bottom
        words = self._check.words or (f"Problems in the footage: {len(problems)}" if problems else "")
        canvas.text(self.em, y, words, self._small, BAD if problems else DIM)
        for line in lines[:room]:
            y += line_height(self._small)
            canvas.text(self.em, y, line, self._small, BAD)
        return canvas.pixels

    @property
    def _small(self) -> int:
        return round(0.85 * self.em)

    def _open(self) -> Footage | None:
        context = self.workspace.context
        if context is None:
            return None
        config = context.config
        if self._footage is None or self._footage_of != (config.capture, config.run.paths):
            self._footage = open_footage(
                context.footage.capture,
                None,
                strict=False,
                cache_folder=self._cache_folder(),
                device=config.run.device,
                threads=config.run.threads,
            )
            self._footage_of = (config.capture, config.run.paths)
        return self._footage

    def _cache_folder(self) -> Path | None:
        take = self.workspace.take
        return take.footage_cache if take is not None else None

    def _thumbnails(self, canvas: Canvas, footage: Footage, frame: int, height: float) -> None:
        alone = self.camera in footage.camera_names
        names = (self.camera,) if alone else footage.camera_names
        places = []
        width, row = grid(len(names), canvas.width, height, _aspect(footage, names[0]), self._small)
        columns = max(canvas.width // width, 1)
        for number, name in enumerate(names):
            x, y = number % columns * width, number // columns * row
            held_out = name in footage.held_out_cameras
            places.append((name, rectangle(x, y, width, row)))
            try:
                picture = self._thumbnail(footage, name, frame, WIDEST if alone else WIDE)
                left, top, wide, high = canvas.fit_image(x + 3, y + 3, width - 6, row - self._small - 11, picture)
                if held_out:
                    canvas.frame(left, top, wide, high, ACCENT)
            except StudioError as error:
                canvas.rect(x + 3, y + 3, width - 6, row - self._small - 11, RAISED)
                step = line_height(self._small)
                for line, words in enumerate(
                    wrapped(str(error), self._small, width - 18)[: max(int(row // step) - 2, 1)]
                ):
                    canvas.text(x + 9, y + 9 + line * step, words, self._small, BAD)
            label = f"{name}, held out" if held_out else name
            label += "; click for all cameras" if alone else ""
            canvas.text(x + width / 2, y + row - self._small - 7, label, self._small, TEXT, align="middle", width=width)
        self.places = places

    def _thumbnail(self, footage: Footage, name: str, frame: int, widest: int) -> np.ndarray:
        import cv2

        image = footage.raw_image(name, frame)
        scale = min(1.0, widest / image.shape[1])
        size = max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1)
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        if self.mode == "images":
            return small
        matte = cv2.resize(footage.raw_matte(name, frame), size, interpolation=cv2.INTER_AREA)[..., None] / np.float32(
            255
        )
        if self.mode == "performer":
            return (small * matte + np.array(GROUND) * (1 - matte)).astype(np.uint8)
        dark = small * (0.35 + 0.65 * matte)
        edge = cv2.morphologyEx((matte > 0.5).astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
        dark[edge] = TINT
        return dark.astype(np.uint8)

    def check(self) -> None:
        """Decode all of the footage once and list problems, on a separate thread."""
        context = self.workspace.context
        if context is not None:
            self._check.start(context)

    def stop_check(self) -> None:
        """Stop the check."""
        self._check.stop()

    @property
    def checking(self) -> bool:
        """Whether the check is running."""
        return self._check.running

    def close(self) -> bool:
        """See `StageView`."""
        self._check.stop()
        return super().close()


def _aspect(footage: Footage, camera: str) -> float:
    width, height = footage.raw_size(camera)
    return width / height


def grid(count: int, width: int, height: float, aspect: float, label: int) -> tuple[int, int]:
    """(width, height) of the largest cells that fit `count` pictures of an aspect ratio, with a label under each."""
    best = (1, 1)
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        wide = width // columns
        high = min(round((wide - 6) / aspect) + label + 11, int(height // rows))
        area = min(wide - 6, (high - label - 11) * aspect)
        if area > min(best[0] - 6, (best[1] - label - 11) * aspect):
            best = (wide, high)
    return best


class FootageCheck:
    """Runs `Footage.check` on a thread.

    Attributes:
        words: progress or outcome; "" before the first check.
        problems: the problems found.
    """

    def __init__(self) -> None:
        self.words = ""
        self.problems: Sequence[str] = ()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def running(self) -> bool:
        """Whether it is running."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, context: Context) -> None:
        """Start, unless it is running."""
        if self.running:
            return
        self._stop.clear()
        self.words, self.problems = "checking the footage", ()
        self._thread = threading.Thread(target=self._run, args=(context,), name="v3studio check", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop at the next image."""
        self._stop.set()

    def _run(self, context: Context) -> None:
        def progress(done: int, total: int, **figures: object) -> None:
            if self._stop.is_set():
                raise Cancelled
            self.words = f"checking the footage, {done} of {total} images"

        try:
            run = context.config.run
            footage = open_footage(
                context.footage.capture.replace(cache_megabytes=64),
                None,
                strict=False,
                cache_folder=context.take.footage_cache,
                device=run.device,
                threads=run.threads,
            )
            problems = check_footage(footage, progress)
        except Cancelled:
            self.words = "check stopped"
        except StudioError as error:
            self.words, self.problems = "check failed", (str(error),)
        else:
            count = len(problems)
            self.problems = [str(problem) for problem in problems]
            self.words = (
                f"{count} problem{'s' * (count != 1)} found" if problems else "all images checked, no problems found"
            )
