"""Renders what the viewport shows, on its worker thread: Gaussians, footage, comparisons."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from v3studio.gui.drawing import compare
from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.compare import Box, Mode, What
from v3studio.gui.drawing.palette import BAD, BLACK
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.gui.models.playback.other_source import OtherSource, shown_beside
from v3studio.gui.models.playback.sources import FrameSource
from v3studio.gui.models.scene.compose import as_pixels, draw_layer
from v3studio.gui.models.scene.contents import Color, SceneRequest
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.scene.reader import SceneReader
from v3studio.gui.models.scene.render import Place, render_scene
from v3studio.gui.models.stages import performer_over
from v3studio.studio.calibration.coverage import ViewRange
from v3studio.studio.cameras import Camera
from v3studio.studio.comparison import lit
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.memory_cache import MemoryCache

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage

KEPT_PICTURES = 9

FAINTEST = 0.1  # how much of the image is left where nothing was filmed

DrawFn = Callable[[Gaussians, Camera, Color], np.ndarray]


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderRequest(SceneRequest):
    """An image to render."""

    sources: dict[str, FrameSource]
    mode: Mode
    what: str  # one of `What`; a comparison compares it with `reference`
    reference: str
    orbit: OrbitCamera
    home: OrbitCamera  # the initial free view: side by side, it is reduced so that the narrow images contain `points`
    image_zoom: ImageZoom  # visible part of the capture camera's image
    size: tuple[int, int]
    wipe: float  # position of the wipe, 0 to 1
    shape: float  # width by height of the performer, which images side by side are arranged for
    # the point of the world that the frame's mark is about; None for none
    place: tuple[float, float, float] | None

    @property
    def text(self) -> int:
        """Size of labels, pixels of the image."""
        return max(round(0.88 * self.em), compare.LEAST_SIZE)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the images, from left to right."""
        if self.mode in compare.ALONE:
            return (self.what,)
        if self.mode == Mode.SIDE_BY_SIDE:
            return shown_beside(list(self.sources), self.camera)
        return (self.reference, self.what)

    @property
    def label(self) -> tuple[object, ...]:
        """The subject of the image, apart from frame and view: images with different labels must not be confused."""
        return (self.mode, self.names, self.camera, *(id(self.sources.get(name)) for name in self.names))

    def shown(self, name: str) -> str:
        """The name of an image on screen."""
        source = self.sources.get(name)
        return source.label if isinstance(source, OtherSource) else name

    @property
    def key(self) -> tuple[object, ...]:
        """Equal keys of two requests mean equal images."""
        same = [id(part) for part in (self.orbit, self.context, self.rig, self.points, *self.sources.values())]
        return (
            same, self.frame, self.number, self.group, self.mode, self.what, self.reference, self.camera, self.parts,
            self.still, self.em, self.image_zoom, self.size, self.background, self.wipe, self.place,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Picture:
    """A rendered image."""

    image: np.ndarray  # (H, W, 3) uint8 RGB
    request: RenderRequest
    splats: int  # number of Gaussians drawn; 0 for footage
    draw_seconds: float  # total time to render the Gaussians of all parts
    box: Box  # rectangle of the (left) image in the image; the wipe moves within it
    # cameras, ends: of a scene: name and (N, 2) pixels of frusta and of the ends of the view axes
    cameras: tuple[Place, ...] = ()
    ends: tuple[Place, ...] = ()


@dataclass(frozen=True, eq=False)
class _Part:
    image: np.ndarray
    splats: int
    draw_seconds: float


@dataclass
class FrameRenderer:
    """Renders requests; caches the last few parts, so that moving the wipe renders nothing again."""

    draw: DrawFn
    reader: SceneReader
    _kept: MemoryCache[tuple[object, ...], _Part] = field(default_factory=lambda: MemoryCache(KEPT_PICTURES))

    def __call__(self, request: RenderRequest) -> Picture:
        """Render the image. Raises StudioError: a missing or damaged frame or image."""
        capture = capture_camera(request)
        if request.mode == Mode.SCENE:
            return self._scene(request, capture)
        names = request.names
        apart = request.mode == Mode.SIDE_BY_SIDE
        where = compare.boxes(request.size, len(names) if apart else 1, request.shape)
        uncut = request.mode == Mode.DIFFERENCE and capture is not None and What.FOOTAGE in names
        parts = [self._part(request, name, where[0], capture, uncut) for name in names]
        images = [part.image for part in parts]
        shown = [request.shown(name) for name in names]
        if request.mode == Mode.SINGLE:
            image = images[0]
        elif apart:
            corner = (0, 0)
            if capture is not None:
                corner = request.image_zoom.inside(capture, where[0].width, where[0].height)[:2]
            image = compare.side_by_side(request.size, where, images, shown, request.text, corner)
        elif request.mode == Mode.WIPE:
            pair, box = (shown[0], shown[1]), where[0]
            image = compare.wipe(request.size, box, images[0], images[1], request.wipe, pair, request.text)
        else:
            pair, under = (shown[0], shown[1]), None
            if uncut:
                under = self._part(request, What.FOOTAGE, where[0], capture).image
            seen = (pair, request.text, request.background, under)
            image = compare.heat_map(request.size, where[0], images[0], images[1], *seen)
        if request.place is not None:
            image = image.copy()
            for box in where:
                ring(image, box, self._camera(request, box, capture), request.place, request.text)
        seconds = sum(part.draw_seconds for part in parts)
        return Picture(image, request, parts[-1].splats, seconds, where[0])

    def _scene(self, request: RenderRequest, capture: Camera | None) -> Picture:
        gaussians = _splats(_source(request, request.what), request)
        start = time.perf_counter()
        box = Box(0, 0, *request.size)
        image, cameras, ends = render_scene(self.reader, gaussians, self._camera(request, box, capture), request)
        return Picture(image, request, len(gaussians), time.perf_counter() - start, box, cameras, ends)

    def _part(self, request: RenderRequest, name: str, box: Box, capture: Camera | None, uncut: bool = False) -> _Part:
        """An image of what is called `name`. `uncut`: to compare splats over the set with the footage. Without an image
        of the set, the footage is cut out."""
        source = request.context if name == What.FOOTAGE else _source(request, name)
        seen_by: object = (request.camera, request.image_zoom) if capture is not None else request.orbit.key
        key = (
            name, source, request.frame, request.number, seen_by, request.background, box.width, box.height, uncut,
            "set" in request.parts,
        )  # fmt: skip
        # `forget` replaces the cache, on another thread
        return self._kept.get_or_make(key, lambda _: self._drawn(request, name, box, capture, uncut))

    def _drawn(self, request: RenderRequest, name: str, box: Box, capture: Camera | None, uncut: bool) -> _Part:
        if name == What.FOOTAGE:
            return _Part(footage_image(request, box.width, box.height, uncut), 0, 0.0)
        source = _source(request, name)
        gaussians = source.gaussians(request.frame) if uncut else _splats(source, request)
        start = time.perf_counter()
        camera = self._camera(request, box, capture)
        behind = set_image(request, box.width, box.height) if uncut else None
        if behind is None:
            image = self.draw(gaussians, camera, request.background)
        else:
            image = as_pixels(draw_layer(gaussians, camera).over(behind.astype(np.float32) / 255))
        if capture is not None:
            request.image_zoom.mask_outside(image, capture)
        else:
            image = faded(image, getattr(source, "view_range", None), camera, request.background, request.text)
        return _Part(image, len(gaussians), time.perf_counter() - start)

    def _camera(self, request: RenderRequest, box: Box, capture: Camera | None) -> Camera:
        if capture is not None:
            return request.image_zoom.camera(capture, box.width, box.height)
        return request.orbit.camera(box.width, box.height, self._reduced(request, box))

    def _reduced(self, request: RenderRequest, box: Box) -> float:
        """Only the initial view decides, so that zooming in still enlarges."""
        if request.mode != Mode.SIDE_BY_SIDE:
            return 1.0
        return request.home.widened(request.points, box.width, box.height)

    def forget(self) -> None:
        """Empty the cache: something else was opened, or files have changed."""
        self._kept = MemoryCache(KEPT_PICTURES)
        self.reader.forget()


def _splats(source: FrameSource, request: RenderRequest) -> Gaussians:
    """The frame's splats, with those of the set if it is shown."""
    return source.gaussians(request.frame).before(source.behind() if "set" in request.parts else None)


def _source(request: RenderRequest, name: str) -> FrameSource:
    if name not in request.sources:
        raise StudioError("playback.no_source", f"no {name} frames yet", value=name)
    return request.sources[name]


def capture_camera(request: RenderRequest) -> Camera | None:
    """The selected capture camera, undistorted; None for the free view. Raises StudioError: it has none."""
    if not request.camera:
        return None
    if request.context is not None:
        try:
            return request.context.trained_footage.rig[request.camera]
        except StudioError:
            if request.rig is None:
                raise
    if request.rig is None:
        raise StudioError("playback.no_cameras", "a stream has no capture cameras", fix="Open its take.")
    return request.rig[request.camera].undistorted()


def ring(image: np.ndarray, box: Box, camera: Camera, place: tuple[float, float, float], size: int) -> None:
    """Draw a ring around a point of the world, if it is in the camera's part of the image. `size`: radius, pixels."""
    pixels, depth = camera.project(np.array([place]))
    x, y = pixels[0]
    if depth[0] <= 0 or not (0 <= x <= box.width and 0 <= y <= box.height):
        return
    canvas = Canvas.of(image)
    for radius, color in ((size + 2, BLACK), (size - 2, BLACK), (size, BAD)):
        canvas.dot(box.x + x, box.y + y, radius, color, filled=False)


def faded(
    image: np.ndarray, covered: ViewRange | None, camera: Camera, background: Color, text: int = compare.LABEL_SIZE
) -> np.ndarray:
    """The (H, W, 3) uint8 image, faded to the background where no camera filmed from near `camera`, with a word."""
    seen = 1.0 if covered is None else covered.visibility(camera.center)
    if seen >= 1:
        return image
    weight, color = FAINTEST + (1 - FAINTEST) * seen, 255 * np.asarray(background, np.float32)
    canvas = Canvas.of((color + (image - color) * weight + 0.5).astype(np.uint8))
    if seen <= 0.5:
        compare.label(canvas, 12, 12, "Not filmed from here", size=text)
    return canvas.pixels


def footage_image(request: RenderRequest, width: int, height: int, compared: bool = False) -> np.ndarray:
    """(height, width, 3) uint8: the image as filmed; if it is `compared`, but the set is not known, only the performer,
    over the background. StudioError: `playback.no_footage`, `playback.no_camera_selected`, `footage.no_such_frame`, or
    an unreadable image."""
    footage, number = _filmed(request)
    if compared and _plate(request) is None:
        image = performer_over(footage, request.camera, number, request.background)
    else:
        image = footage.image(request.camera, number)
    return request.image_zoom.picture(image, footage.rig[request.camera], width, height)


def set_image(request: RenderRequest, width: int, height: int) -> np.ndarray | None:
    """(height, width, 3) uint8: the set, as bright as the footage; None if it is not known. StudioError as above."""
    footage, number = _filmed(request)
    plate = _plate(request)
    if plate is None:
        return None
    image = (255 * lit(plate, footage.image(request.camera, number)) + 0.5).astype(np.uint8)
    return request.image_zoom.picture(image, footage.rig[request.camera], width, height)


def _plate(request: RenderRequest) -> np.ndarray | None:
    """The set, as `EmptySets.plate`."""
    return request.context.sets.plate(request.camera) if request.context is not None else None


def _filmed(request: RenderRequest) -> tuple[Footage, int]:
    """The footage, and the frame's number in it."""
    if request.context is None:
        raise StudioError("playback.no_footage", "a stream has no footage", fix="Open its take.")
    if not request.camera:
        raise StudioError("playback.no_camera_selected", "footage needs a capture camera", fix="Select one (C).")
    footage = request.context.trained_footage
    known = range(len(footage.frames)) if request.number is None else footage.frames
    frame = request.frame if request.number is None else request.number
    if frame not in known:
        words = f"the settings use frames {footage.frames[0]} to {footage.frames[-1]} of the footage only"
        raise StudioError("footage.no_such_frame", words, frame=frame)
    return footage, footage.frames[frame] if request.number is None else frame
