"""What is shown of a frame, made on the viewport's thread: Gaussians drawn, ground truth read, pictures compared."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gui.presenters.playback import compare
from gui.presenters.playback.compare import Box
from gui.presenters.playback.image_zoom import ImageZoom
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
class RenderRequest:
    """A picture to be made.

    Attributes:
        sources: Gaussians by name ("trained", "decoded").
        frame: counted from 0.
        mode: of `compare.MODES`.
        what: what is shown; in a comparison it is compared with `reference`.
        orbit: the viewer's own camera.
        camera: name of the capture camera to look through; "" for the viewer's own.
        image_zoom: which part of its image.
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
    image_zoom: ImageZoom
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

    def same_as(self, other: RenderRequest) -> bool:
        """Whether it would give the same picture."""
        return (
            self.orbit is other.orbit
            and self.context is other.context
            and all(self.sources.get(name) is other.sources.get(name) for name in ("trained", "decoded"))
            and (self.frame, self.mode, self.what, self.reference, self.camera, self.image_zoom, self.size,
                self.background, self.wipe)
            == (other.frame, other.mode, other.what, other.reference, other.camera, other.image_zoom, other.size,
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
class FrameRenderer:
    """Makes wishes true; remembers the last few parts, so that moving the wipe's line draws nothing anew.

    Args:
        draw: makes the pixels.
    """

    draw: DrawFn
    _kept: OrderedDict[tuple[object, ...], _Part] = field(default_factory=OrderedDict)

    def __call__(self, wanted: RenderRequest) -> Picture:
        """The picture.

        Raises:
            StudioError: a frame or an image that is not there or damaged.
        """
        capture = capture_camera(wanted)
        names = wanted.names
        apart = wanted.mode == "side by side"
        where = compare.boxes(wanted.size, len(names) if apart else 1)
        parts = [self._part(wanted, name, where[0], capture) for name in names]
        images = [part.image for part in parts]
        if wanted.mode == "single":
            image = images[0]
        elif apart:
            image = compare.side_by_side(wanted.size, where, images, names)
        elif wanted.mode == "wipe":
            image = compare.wipe(wanted.size, where[0], images[0], images[1], wanted.wipe, (names[0], names[1]))
        else:
            image = compare.heat_map(wanted.size, where[0], images[0], images[1], (names[0], names[1]))
        return Picture(
            image,
            wanted.frame,
            wanted.what,
            parts[-1].splats,
            sum(part.load_seconds for part in parts),
            sum(part.draw_seconds for part in parts),
            wanted.mode,
            where[0],
            wanted.camera,
        )

    def _part(self, wanted: RenderRequest, name: str, box: Box, capture: Camera | None) -> _Part:
        source = wanted.sources.get(name)
        seen_by: object = (wanted.camera, wanted.image_zoom) if capture is not None else wanted.orbit.key
        holder = wanted.context if name == "truth" else source
        key = (name, id(holder), wanted.frame, seen_by, wanted.background, box.width, box.height)
        kept = self._kept.get(key)
        if kept is None:
            start = time.perf_counter()
            if name == "truth":
                image = ground_truth(wanted, box.width, box.height)
                kept = _Part(image, 0, time.perf_counter() - start, 0.0, holder)
            elif source is None:
                raise StudioError(f"There is nothing {name} to show yet.")
            else:
                gaussians = source.gaussians(wanted.frame)
                loaded = time.perf_counter()
                camera = wanted.orbit.camera(box.width, box.height)
                if capture is not None:
                    camera = wanted.image_zoom.camera(capture, box.width, box.height)
                image = self.draw(gaussians, camera, wanted.background)
                if capture is not None:
                    wanted.image_zoom.mask_outside(image, capture)
                kept = _Part(image, len(gaussians), loaded - start, time.perf_counter() - loaded, holder)
        self._kept[key] = kept
        self._kept.move_to_end(key)
        while len(self._kept) > KEPT_PICTURES:
            self._kept.popitem(last=False)
        return kept

    def forget(self) -> None:
        """Something was opened or written anew."""
        self._kept.clear()


def capture_camera(wanted: RenderRequest) -> Camera | None:
    """The capture camera to look through, without lens distortion; None for the viewer's own.

    Raises:
        StudioError: there is no such camera.
    """
    if not wanted.camera:
        return None
    if wanted.context is not None:
        try:
            return wanted.context.footage.calibrated.rig[wanted.camera]
        except StudioError:
            if wanted.rig is None:
                raise
    if wanted.rig is None:
        raise StudioError("A stream alone has no capture cameras; open its take.")
    return wanted.rig[wanted.camera].undistorted()


def ground_truth(wanted: RenderRequest, width: int, height: int) -> np.ndarray:
    """(height, width, 3) uint8: the performer as filmed, over the background, as evaluation sees it.

    Raises:
        StudioError: no footage, or an image that cannot be read.
    """
    if wanted.context is None:
        raise StudioError("A stream alone has no ground truth; open its take.")
    if not wanted.camera:
        raise StudioError("Ground truth is seen from capture cameras only; choose one (C).")
    footage = wanted.context.footage.calibrated
    if wanted.frame >= len(footage.frames):
        raise StudioError(
            f"The footage has the frames 0 to {len(footage.frames) - 1}; there is no frame {wanted.frame}."
        )
    frame = footage.frames[wanted.frame]
    alpha = footage.evaluation_matte(wanted.camera, frame)[..., None].astype(np.float32) / 255
    background = np.array(wanted.background, np.float32) * 255
    image = footage.image(wanted.camera, frame).astype(np.float32) * alpha + background * (1 - alpha)
    camera = footage.rig[wanted.camera]
    pixels = wanted.image_zoom.picture((image + 0.5).astype(np.uint8), camera, width, height)
    wanted.image_zoom.mask_outside(pixels, camera)
    return pixels
