"""What is shown of a frame, made on the viewport's thread: Gaussians drawn, ground truth read, pictures compared."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gui.presenters.playback import compare
from gui.presenters.playback.compare import Box
from gui.presenters.playback.image_zoom import Lens
from gui.presenters.playback.orbit import OrbitCamera
from gui.presenters.playback.sources import FrameSource
from pipelines.stages.base import Context
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.gaussians import Gaussians

KEPT_PICTURES = 9

Color = tuple[float, float, float]
DrawFn = Callable[[Gaussians, Camera, Color], np.ndarray]


@dataclass(frozen=True, eq=False)
class Wish:
    """A picture to be made.

    Attributes:
        sources: Gaussians by name ("trained", "decoded").
        frame: counted from 0.
        mode: of `compare.MODES`.
        what: what is shown; in a comparison it is compared with `reference`.
        orbit: the viewer's own camera.
        camera: name of the capture camera to look through; "" for the viewer's own.
        lens: which part of its image.
        size: (width, height).
        wipe: place of the wipe's line, 0 to 1.
        context: the take, for ground truth; None where there is none.
        rig: the capture's cameras where the footage itself cannot be opened.
    """

    sources: dict[str, FrameSource]
    frame: int
    mode: str
    what: str
    reference: str
    orbit: OrbitCamera
    camera: str
    lens: Lens
    size: tuple[int, int]
    background: Color
    wipe: float
    context: Context | None
    rig: Rig | None

    @property
    def names(self) -> tuple[str, ...]:
        """Pictures that are needed, left to right."""
        if self.mode == "single":
            return (self.what,)
        if self.mode == "side by side":
            order = ("truth", "trained", "decoded") if self.camera else ("trained", "decoded")
            return tuple(name for name in order if name in self.sources or name == "truth")
        return (self.reference, self.what)

    def same_as(self, other: Wish) -> bool:
        """Whether it would give the same picture."""
        return (
            self.orbit is other.orbit
            and self.context is other.context
            and all(self.sources.get(name) is other.sources.get(name) for name in ("trained", "decoded"))
            and (self.frame, self.mode, self.what, self.reference, self.camera, self.lens, self.size, self.background,
                self.wipe)
            == (other.frame, other.mode, other.what, other.reference, other.camera, other.lens, other.size,
                other.background, other.wipe)
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that was made.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        frame: counted from 0.
        source: what it shows ("decoded", "trained", "truth").
        splats: how many Gaussians it was drawn from; 0 for ground truth.
        load_seconds, draw_seconds: what getting the Gaussians and drawing them took, all parts together.
        mode: of `compare.MODES`.
        box: where (the left) picture lies in the image; the wipe's line moves within it.
        camera: the capture camera looked through; "" for the viewer's own.
    """

    image: np.ndarray
    frame: int
    source: str
    splats: int
    load_seconds: float
    draw_seconds: float
    mode: str = "single"
    box: Box = field(default_factory=lambda: Box(0, 0, 1, 1))
    camera: str = ""


@dataclass(frozen=True, eq=False)
class _Part:
    image: np.ndarray
    splats: int
    load_seconds: float
    draw_seconds: float
    holder: object  # kept alive with the part, so that its id stays its own


@dataclass
class PictureMaker:
    """Makes wishes true; remembers the last few parts, so that moving the wipe's line draws nothing anew.

    Args:
        draw: makes the pixels.
    """

    draw: DrawFn
    _kept: OrderedDict[tuple[object, ...], _Part] = field(default_factory=OrderedDict)

    def __call__(self, wish: Wish) -> Picture:
        """The picture.

        Raises:
            StudioError: a frame or an image that is not there or damaged.
        """
        capture = capture_camera(wish)
        names = wish.names
        apart = wish.mode == "side by side"
        where = compare.boxes(wish.size, len(names) if apart else 1)
        parts = [self._part(wish, name, where[0], capture) for name in names]
        images = [part.image for part in parts]
        if wish.mode == "single":
            image = images[0]
        elif apart:
            image = compare.side_by_side(wish.size, where, images, names)
        elif wish.mode == "wipe":
            image = compare.wipe(wish.size, where[0], images[0], images[1], wish.wipe, (names[0], names[1]))
        else:
            image = compare.heat_map(wish.size, where[0], images[0], images[1], (names[0], names[1]))
        return Picture(
            image,
            wish.frame,
            wish.what,
            parts[-1].splats,
            sum(part.load_seconds for part in parts),
            sum(part.draw_seconds for part in parts),
            wish.mode,
            where[0],
            wish.camera,
        )

    def _part(self, wish: Wish, name: str, box: Box, capture: Camera | None) -> _Part:
        source = wish.sources.get(name)
        seen_by: object = (wish.camera, wish.lens) if capture is not None else wish.orbit.key
        holder = wish.context if name == "truth" else source
        key = (name, id(holder), wish.frame, seen_by, wish.background, box.width, box.height)
        kept = self._kept.get(key)
        if kept is None:
            start = time.perf_counter()
            if name == "truth":
                image = ground_truth(wish, box.width, box.height)
                kept = _Part(image, 0, time.perf_counter() - start, 0.0, holder)
            elif source is None:
                raise StudioError(f"There is nothing {name} to show yet.")
            else:
                gaussians = source.gaussians(wish.frame)
                loaded = time.perf_counter()
                camera = wish.orbit.camera(box.width, box.height)
                if capture is not None:
                    camera = wish.lens.camera(capture, box.width, box.height)
                image = self.draw(gaussians, camera, wish.background)
                if capture is not None:
                    wish.lens.mask_outside(image, capture)
                kept = _Part(image, len(gaussians), loaded - start, time.perf_counter() - loaded, holder)
        self._kept[key] = kept
        self._kept.move_to_end(key)
        while len(self._kept) > KEPT_PICTURES:
            self._kept.popitem(last=False)
        return kept

    def forget(self) -> None:
        """Something was opened or written anew."""
        self._kept.clear()


def capture_camera(wish: Wish) -> Camera | None:
    """The capture camera to look through, without lens distortion; None for the viewer's own.

    Raises:
        StudioError: there is no such camera.
    """
    if not wish.camera:
        return None
    if wish.context is not None:
        try:
            return wish.context.footage.calibrated.rig[wish.camera]
        except StudioError:
            if wish.rig is None:
                raise
    if wish.rig is None:
        raise StudioError("A stream alone has no capture cameras; open its take.")
    return wish.rig[wish.camera].undistorted()


def ground_truth(wish: Wish, width: int, height: int) -> np.ndarray:
    """(height, width, 3) uint8: the performer as filmed, over the background, as evaluation sees it.

    Raises:
        StudioError: no footage, or an image that cannot be read.
    """
    if wish.context is None:
        raise StudioError("A stream alone has no ground truth; open its take.")
    if not wish.camera:
        raise StudioError("Ground truth is seen from capture cameras only; choose one (C).")
    footage = wish.context.footage.calibrated
    if wish.frame >= len(footage.frames):
        raise StudioError(f"The footage has the frames 0 to {len(footage.frames) - 1}; there is no frame {wish.frame}.")
    frame = footage.frames[wish.frame]
    alpha = footage.evaluation_matte(wish.camera, frame)[..., None].astype(np.float32) / 255
    background = np.array(wish.background, np.float32) * 255
    image = footage.image(wish.camera, frame).astype(np.float32) * alpha + background * (1 - alpha)
    camera = footage.rig[wish.camera]
    pixels = wish.lens.picture((image + 0.5).astype(np.uint8), camera, width, height)
    wish.lens.mask_outside(pixels, camera)
    return pixels
