"""The cameras and frames of new footage as an image in which both can be chosen."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.compare import Box, boxes, label
from v3studio.gui.drawing.palette import ACCENT, DIALOG, DIM, HELD_OUT, RAISED, RGB, TEXT
from v3studio.pipelines.inspection import Inspection

FRAMES, GAP = 0.28, 0.5  # share of the height that the strip of frames gets; gap above it, em
DARK = 0.3  # brightness of cameras and frames that are not used


@dataclass(frozen=True)
class FootageSheet:
    """An image of the footage. `span`: first and last frame used. `words`: shown while there is no image."""

    size: tuple[int, int]
    em: float
    found: Inspection
    uses: Mapping[str, str]
    span: tuple[int, int]
    words: str = ""

    @cached_property
    def cameras(self) -> dict[str, Box]:
        """The box of each camera."""
        shapes = [image.shape[1] / image.shape[0] for image in self.found.thumbnails.values()]
        high = round((1 - FRAMES) * self.size[1] - GAP * self.em)
        places = boxes((self.size[0], high), max(len(self.uses), 1), max(shapes, default=1.0))
        return dict(zip(self.uses, places, strict=False))

    @cached_property
    def frames(self) -> dict[int, Box]:
        """The box of each frame of the strip."""
        top = round((1 - FRAMES) * self.size[1])
        count = max(len(self.found.strip), 1)
        places = boxes((self.size[0], self.size[1] - top), count, 1e-3)  # in one row
        return {frame: replace(place, y=top) for frame, place in zip(self.found.strip, places, strict=False)}

    @property
    def places(self) -> dict[str, list[float]]:
        """The middles of the cameras, and of the frames as "frame NUMBER", 0 to 1 across and down."""
        named = {**self.cameras, **{f"frame {frame}": box for frame, box in self.frames.items()}}
        return {name: box.middle(self.size) for name, box in named.items()}

    def camera_at(self, x: float, y: float) -> str:
        """The camera at a pixel; "" if there is none."""
        return next((name for name, box in self.cameras.items() if box.holds(x, y)), "")

    def frame_at(self, x: float, y: float) -> int | None:
        """The frame at a pixel, of all that there are; None outside of the strip."""
        if not self.frames or y < next(iter(self.frames.values())).y:
            return None
        frames = self.found.frames
        return frames[min(max(int(x / self.size[0] * len(frames)), 0), len(frames) - 1)]

    def draw(self) -> np.ndarray:
        """(height, width, 3) uint8."""
        canvas = Canvas(*self.size, DIALOG)
        small = round(0.75 * self.em)
        if self.words:
            canvas.text(self.size[0] / 2, self.size[1] / 2, self.words, round(self.em), DIM, "middle", self.size[0])
            return canvas.pixels
        for name, box in self.cameras.items():
            use, image = self.uses[name], self.found.thumbnails.get(name)
            held_out = use == "held out"
            self._cell(canvas, box, image, name, HELD_OUT if held_out else TEXT, dark=use == "not used")
            if image is None and name in self.found.unmasked:
                canvas.text(box.x + box.width / 2, box.y + box.height / 2, "no masks", small, DIM, "middle", box.width)
            for inset in range(2 * held_out):
                canvas.frame(box.x + inset, box.y + inset, box.width - 2 * inset, box.height - 2 * inset, HELD_OUT)
        for frame, box in self.frames.items():
            used = self.span[0] <= frame <= self.span[1]
            self._cell(canvas, box, self.found.strip[frame], str(frame), TEXT, dark=not used)
        frames = self.found.frames
        inside = [index for index, frame in enumerate(frames) if self.span[0] <= frame <= self.span[1]]
        if inside and self.frames:
            left, right = (at / len(frames) * self.size[0] for at in (inside[0], inside[-1] + 1))
            canvas.rect(left, self.size[1] - 3, right - left, 3, ACCENT)
        return canvas.pixels

    def _cell(self, canvas: Canvas, box: Box, image: np.ndarray | None, name: str, color: RGB, dark: bool) -> None:
        canvas.rect(box.x, box.y, box.width, box.height, RAISED)
        if image is not None:
            canvas.fit_image(box.x, box.y, box.width, box.height, (DARK * image).astype(np.uint8) if dark else image)
        label(canvas, box.x, box.y, name, color=DIM if dark else color, size=round(0.75 * self.em))
