"""Viewpoint: the open take or stream, which part of it is on screen, and from which camera."""

import time
from collections.abc import Callable, Hashable

import numpy as np

from v3studio.gui.drawing.compare import ALONE, Mode, What, boxes
from v3studio.gui.models.held_out import held_out_cameras, held_out_first
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.gui.models.playback.other_source import OTHERS, OtherSource, shown_beside
from v3studio.gui.models.playback.sources import FrameSource, Opened
from v3studio.gui.models.scene.contents import SHOWN_AT_FIRST
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.stages import Inputs
from v3studio.studio.cameras import Camera

BACKGROUNDS = {"dark": (0.08, 0.09, 0.1), "black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0)}
NOTHING_OPEN = "Open a take or a stream, or create a new take from footage (File menu)."

RESTS_AFTER = 0.4  # seconds without a change after which the view rests

_SAME_SHAPE = 0.01  # relative difference between the shapes of two images below which they show the same


class Rest:
    """Whether the view has rested for a moment, so that there is time for a better image. `now`: a clock, seconds."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._view: Hashable = None
        self._since = 0.0

    def rests(self, view: Hashable, moving: bool) -> bool:
        """Whether the view has been equal for `RESTS_AFTER`. Call at each tick. `moving`: it moves on its own."""
        if moving or view != self._view:
            self._view, self._since = view, self._now()
        return self._now() - self._since >= RESTS_AFTER


class Viewpoint:
    """The open take or stream, which part of it is on screen, and from which camera.

    Signals:
        refused: something cannot be shown or done, for this reason, a sentence.
    """

    def __init__(self) -> None:
        self.opened: Opened | None = None
        self.others: list[OtherSource] = []  # other bakes or takes that comparisons are against, the last one first
        self.context: Inputs | None = None  # the take with its footage; None for a bare stream
        self.what: str = What.DECODED  # one of `What`, or the name of the only source
        self.mode = Mode.SINGLE
        self.camera = ""  # the capture camera; "" for the free view
        self.image_zoom = ImageZoom()
        self._zoom_follows = False
        self.points = np.zeros((0, 3))  # (N, 3) world: where splats are in any frame, which images should contain
        self.orbit = OrbitCamera()  # orbit, home: the current and the initial free view
        self.home = self.orbit
        self.size = self._fitted_size = (960, 540)
        self.background = "dark"  # one of `BACKGROUNDS`
        self.refused: Signal[[str]] = Signal()
        self.scene_parts = SHOWN_AT_FIRST  # what the scene shows, of `gui.models.scene.contents.PARTS`

    @property
    def sources(self) -> dict[str, FrameSource]:
        """The sources of the open take or stream, and what they are compared with, by name."""
        return {**self.opened.sources, **dict(zip(OTHERS, self.others, strict=False))} if self.opened else {}

    @property
    def source(self) -> FrameSource | None:
        """Source of the Gaussians on screen; for footage, the source it is compared with."""
        return self.sources.get(self.what) or (self.opened.default if self.opened is not None else None)

    @property
    def capture_camera(self) -> Camera | None:
        """The capture camera that one looks through; None for the free view."""
        rig = self.opened.rig if self.opened is not None else None
        return rig[self.camera] if rig is not None and self.camera else None

    @property
    def camera_names(self) -> list[str]:
        """Names of the capture cameras, the held-out ones first."""
        names = [camera.name for camera in self.opened.rig] if self.opened and self.opened.rig else []
        return held_out_first(names, self.held_out)

    def why_not(self, what: str) -> str:
        """Return why a source cannot be shown; "" if it can."""
        if self.opened is None:
            return NOTHING_OPEN
        if what == What.FOOTAGE:
            if self.context is None:
                return "A stream has no footage; open its take instead."
            return "" if self.camera_names else "Footage needs cameras. Run Calibrate."
        if what in self.sources:
            return ""
        if what == What.OTHER:
            return "No other bake or take to compare with is open. Choose one with Bake > Bakes."
        return f"Nothing {what} yet. Run {'Train' if what == What.TRAINED else 'Bake'}."

    @property
    def reference(self) -> str:
        """The other side of a comparison: another open bake or take, footage in a camera's view, the other source."""
        default = self.opened.default if self.opened is not None else None
        if self.others:
            return What.OTHER if self.what != What.OTHER or default is None else default.name
        if self.camera and not self.why_not(What.FOOTAGE):
            return What.FOOTAGE
        return What.TRAINED if self.what == What.DECODED else What.DECODED

    @property
    def held_out(self) -> tuple[str, ...]:
        """The cameras that are not trained on."""
        return held_out_cameras(self.context)

    def zoom_to_performer(self) -> None:
        """Zoom to the performer in the capture camera's image, or back to the whole image."""
        self._zoom_follows = self.camera != "" and self.image_zoom == ImageZoom()
        self.image_zoom = ImageZoom()
        self._fit_zoom()

    def _fit_zoom(self) -> None:
        """Keep the performer in view at the current size, until the user zooms or pans."""
        camera = self.capture_camera
        if self._zoom_follows and camera is not None:
            self._fitted_size = self.size
            self.image_zoom = ImageZoom.around(self.points, camera.undistorted(), *self._box_size)

    @property
    def _box_size(self) -> tuple[int, int]:
        """Size of one image: the whole viewport, or a part of a side-by-side view."""
        if self.mode != Mode.SIDE_BY_SIDE:
            return self.size
        box = boxes(self.size, len(shown_beside(list(self.sources), self.camera)), self.shape)[0]
        return box.width, box.height

    @property
    def shape(self) -> float:
        """Width by height of the performer as first seen from here, which images side by side are arranged for."""
        if self.opened is None or not len(self.points):
            return 1.0
        camera = self.capture_camera
        view = self.home.camera(*self.size) if camera is None else camera.undistorted()
        pixels, depth = view.project(self.points)
        if not (depth > 0).any():
            return 1.0
        ends = np.quantile(pixels[depth > 0], (0.01, 0.99), axis=0)
        wide, high = np.ptp(np.clip(ends, 0, (view.width, view.height)), axis=0)
        return float(np.clip(wide / max(high, 1e-6), 0.2, 5.0))

    def resize(self, width: int, height: int) -> None:
        """Set the size of the viewport in pixels."""
        size = (max(int(width), 16), max(int(height), 16))
        if size != self.size:
            self.size, fitted = size, self._fitted_size
            # an image of the same view in another resolution, whose sides are rounded, keeps its zoom
            if abs(size[0] * fitted[1] / (size[1] * fitted[0]) - 1) > _SAME_SHAPE:
                self._fit_zoom()

    def look_through(self, camera: str) -> None:
        """Look through a capture camera; "" returns to the free view, from the same position."""
        self.camera, self.image_zoom = camera, ImageZoom()
        through = self.capture_camera
        if through is not None:
            self.orbit = OrbitCamera.looking_through(through, self.home.target, self.home.up)
        if not camera and self.what == What.FOOTAGE and self.opened is not None and self.opened.default is not None:
            self.what = self.opened.default.name
        self._zoom_follows = camera != "" and self.mode not in ALONE
        self._fit_zoom()
        if not camera and self.mode not in ALONE and len(self.sources) < 2:
            self.mode = Mode.SINGLE

    def next_camera(self) -> None:
        """Switch to the next capture camera."""
        names = self.camera_names
        if not names:
            self.refused.emit("No capture cameras.")
        elif not self.camera:
            self.look_through(names[0])
        else:
            self.look_through(names[(names.index(self.camera) + 1) % len(names)])

    def drag(self, dx: float, dy: float, turn: bool, height: int) -> None:
        """Handle a drag in pixels, see `StageView`: orbiting leaves a capture camera, panning stays in its image."""
        if turn:
            if self.camera:
                self.look_through("")
            self.orbit = self.orbit.orbit(dx, dy)
            return
        camera = self.capture_camera
        if camera is not None:
            self._zoom_follows = False
            self.image_zoom = self.image_zoom.moved(dx, dy, camera, *self._box_size)
            return
        self.orbit = self.orbit.pan(dx, dy, height)

    def wheel(self, x: float, y: float, notches: float) -> None:
        """Zoom; within the image in a capture camera's view."""
        if self.camera:
            self._zoom_follows = False
            self.image_zoom = self.image_zoom.zoomed(notches)
            return
        self.orbit = self.orbit.zoom(notches)

    def view(self, size: tuple[int, int] | None = None) -> Camera | None:
        """The pinhole camera of the current view; None if nothing is open. `size`: (width, height)."""
        if self.opened is None:
            return None
        width, height = size or self.size
        camera = self.capture_camera
        if camera is not None:
            return self.image_zoom.camera(camera.undistorted(), width, height)
        return self.orbit.camera(width, height)

    def reset(self) -> None:
        """Reset the free view, or show the whole image in a capture camera's view."""
        if self.camera:
            self.image_zoom, self._zoom_follows = ImageZoom(), False
        else:
            self.orbit = self.home
