"""Manual tie points: one camera's image, the list of points, and crops of the selected point in other cameras."""

from collections.abc import Callable, Hashable, Mapping
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from v3studio.gui.drawing.areas import Box
from v3studio.gui.drawing.palette import FAIR
from v3studio.gui.models.held_out import held_out_first
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.playback.image_zoom import Magnifier
from v3studio.gui.models.stages import Inputs
from v3studio.gui.models.take.workspace import Workspace, modified
from v3studio.gui.pages.calibrate.marks import TieMarks, advice, expected
from v3studio.gui.pages.calibrate.points_drawing import MOST_PICTURES, Action, PointsImage, Spots
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.stage_view import Size, StageView
from v3studio.pipelines.takes.results.stage_files import read_cameras_report
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.report import CalibrationReport, TiePointReport
from v3studio.studio.camera_files import read_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.storage import is_address


class PointsView(StageView):
    """The images of a frame, in which tie points are marked. Clicks act on the last image's layout. `magnifiers`: by
    camera, what is shown of it and where.

    Signals:
        described: the name and position of the selected point are to be typed.
        run: Calibrate is to be run.
    """

    modes = (ViewMode.BY_HAND,)

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self.marks: TieMarks | None = None
        self.snaps = True
        self.described: Signal[[]] = Signal()
        self.run: Signal[[]] = Signal()
        self.problem = ""
        self.magnifiers: dict[str, Magnifier] = {}
        self._images: MemoryCache[tuple[str, int], np.ndarray] = MemoryCache(MOST_PICTURES + 3)
        self._spots = Spots()
        self._changes = 0
        self._scroll = 0
        self._refused: tuple[Path, int] | None = None  # a damaged file is read only once
        self._rigs: MemoryCache[Hashable, Rig | None] = MemoryCache(1)
        self._footage: tuple[Inputs | None, tuple[str, ...]] = (None, ())

    # What it depends on

    @property
    def path(self) -> Path | None:
        """File of the points: from the settings, else points.yaml in the take."""
        take, context = self.workspace.take, self.workspace.context
        if take is None or context is None:
            return None
        named, root = context.config.calibrate.tie_points, context.config.capture.root
        if named and not is_address(root):
            root = context.capture.root
        return root / named if named else take.root / "points.yaml"

    def state(self) -> Hashable:
        path = self.path
        if path is not None and (self.marks is None or self.marks.path != path or self.marks.stale):
            stamp = (path, modified(path))
            if self.marks is not None or stamp != self._refused:
                self._load(path)
                self._refused = stamp if self.marks is None else None
        take = self.workspace.take
        solved = (modified(take.rig), modified(take.calibration_report)) if take is not None else ()
        changes = self.marks.changes if self.marks is not None else 0
        magnifier = self.magnifiers.get(self.camera)
        view = magnifier.view if magnifier is not None else None
        return (path, changes, self._changes, self.camera, self.frame, self.em, solved, view)

    def _load(self, path: Path) -> None:
        chosen = self.marks.chosen if self.marks is not None and self.marks.path == path else 0
        if is_address(path):
            self.marks = None
            self.problem = (
                f"{path}: the window cannot save points in object storage. Copy this file to this machine and set "
                "calibrate.tie_points to its whole path; or leave it empty, so that points are kept in the take."
            )
            return
        try:
            self.marks, self.problem = TieMarks(path), ""
        except StudioError as error:
            self.marks, self.problem = None, str(error)
        else:
            self.marks.choose(chosen)
            self._changes += 1

    def names(self) -> tuple[str, ...]:
        """Camera names; empty until the footage has been opened."""
        context, names = self._footage
        return names if context is self.workspace.context else ()

    # Images

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        marks, context = self.marks, self.workspace.context
        if marks is None or context is None:
            problem = self.problem or "no take is open"
            raise StudioError("gui.no_points", problem, fix="" if self.problem else "Open a take.")
        footage = context.raw_footage
        names = tuple(held_out_first(footage.camera_names, footage.held_out_cameras))
        if self._footage[0] is not context:
            self._images.clear()  # of another take, or of other settings
        self._footage = (context, names)
        if self.camera not in names:
            self.camera = names[0]
        image = PointsImage(size, self.em, marks, self.camera, self.show_camera)
        left, right = min(15 * self.em, 0.3 * size[0]), min(9 * self.em, 0.2 * size[0])
        top = image.tabs(left, size[0] - left, names)
        self._magnified(image, marks, (left, top, size[0] - left - right, size[1] - top))
        if marks.point is not None:
            shown = [name for name in names if name in marks.point.pixels]
            if len(shown) > MOST_PICTURES and self.camera in shown:  # this camera and the following ones
                here = shown.index(self.camera)
                shown = shown[here:] + shown[:here]
            frame = marks.point.frame  # moving points are elsewhere in other frames
            images = {name: self._image(name, frame) for name in shown[:MOST_PICTURES]}
            image.crops((size[0] - right, top, right, size[1] - top), images, marks.point)
        buttons, solved = self._buttons(), _solved(context.take, modified(context.take.calibration_report))
        self._scroll = image.points(left, self._scroll, solved, buttons)
        self._spots = image.spots
        return image.canvas.pixels

    def _image(self, camera: str, number: int | None = None) -> np.ndarray:
        """A camera's image, of this frame number or else of the current frame."""
        assert self.workspace.context is not None
        if number is None or number not in self.workspace.context.raw_footage.frames:
            number = self._number()
        raw = self.workspace.context.raw_footage
        return self._images.get_or_make((camera, number), lambda key: raw.raw_image(*key))

    def _number(self) -> int:
        """Frame number in the footage of the current frame."""
        assert self.workspace.context is not None
        frames = self.workspace.context.raw_footage.frames
        return int(frames[min(self.frame, len(frames) - 1)])

    def _magnified(self, image: PointsImage, marks: TieMarks, rect: Box) -> None:
        canvas, filmed = image.canvas, self._image(self.camera)
        magnifier = self.magnifiers.get(self.camera)
        size = (filmed.shape[1], filmed.shape[0])
        if magnifier is None or (magnifier.width, magnifier.height) != size:
            magnifier = self.magnifiers[self.camera] = Magnifier(size)
        magnifier.rect = rect
        magnifier.draw(canvas, filmed)
        image.crosses(magnifier)
        rig = self._cameras()
        chosen = marks.point
        if rig is not None and chosen is not None and self.camera in rig:
            guess = expected(chosen, rig[self.camera], rig)
            if guess is not None:
                shown = [place for place in magnifier.shown(guess) if magnifier.holds(*place)]
                if len(guess) > 1:
                    canvas.line(shown, FAIR)
                elif shown:
                    canvas.dot(shown[0][0], shown[0][1], 0.7 * self.em, FAIR, filled=False)

    def _buttons(self) -> list[tuple[str, Action]]:
        return [
            ("New point (N)", partial(self.edit, TieMarks.add)),
            ("Edit name, position (E)", self.described.emit),
            ("Not in this camera (Delete)", self.unmark),
            ("Delete point", partial(self.edit, TieMarks.remove)),
            ("Undo (U)", partial(self.edit, TieMarks.undo)),
            (f"Snapping: {'on' if self.snaps else 'off'} (A)", self.toggle_snap),
            ("Calibrate", self.run.emit),
        ]

    def _cameras(self) -> Rig | None:
        """The calibrated cameras, if they match the footage's resolution."""
        take, context = self.workspace.take, self.workspace.context
        if take is None or context is None or not take.rig.is_file():
            return None
        footage, rig_file = context.raw_footage, take.rig

        def read(_: Hashable) -> Rig | None:
            rig = read_rig(rig_file)
            sizes = {camera.name: (camera.width, camera.height) for camera in rig}
            return rig if all(footage.raw_size(name) == sizes.get(name) for name in footage.camera_names) else None

        return self._rigs.get_or_make((context, modified(rig_file)), read)

    # User actions

    def click(self, x: float, y: float) -> None:
        """Handle a click at a pixel of the image."""
        action = self._spots.at(x, y)
        if action is not None:
            self._try(action)
            self._changes += 1
            return
        magnifier = self.magnifiers.get(self.camera)
        if magnifier is not None and magnifier.holds(x, y) and self.marks is not None:
            self._try(partial(self._mark, *magnifier.pixel(x, y)))

    def _mark(self, x: float, y: float) -> None:
        from v3studio.studio.calibration.manual.subpixel import snap

        assert self.marks is not None
        image = self._image(self.camera)
        if not (0 <= x < image.shape[1] and 0 <= y < image.shape[0]):
            return
        if self.snaps:
            x, y = snap(image, x, y, max(4, round(5 * max(image.shape[:2]) / 1500)))
        self.marks.mark(self.camera, x, y, self._number())

    def _try(self, action: Action) -> None:
        try:
            action()
            self.problem = ""
        except StudioError as error:
            self.problem = str(error)

    def show_camera(self, name: str) -> None:
        self.camera = name
        self._changes += 1

    def step_camera(self, direction: int) -> None:
        """Switch to the next (1) or previous (-1) camera."""
        names = self.names()
        if names:
            here = names.index(self.camera) if self.camera in names else 0
            self.show_camera(names[(here + direction) % len(names)])

    def edit(self, action: Callable[[TieMarks], None]) -> None:
        """Change the points or the selection, if there is a file for them."""
        if self.marks is not None:
            self._try(partial(action, self.marks))

    def step_point(self, direction: int) -> None:
        """Select the next (1) or previous (-1) point in the list."""
        self.edit(lambda marks: marks.choose(marks.chosen + direction))

    def unmark(self) -> None:
        """Remove the selected point's mark in this camera."""
        self.edit(lambda marks: marks.unmark(self.camera))

    def toggle_snap(self) -> None:
        """Toggle snapping of clicks to the nearest corner or dot."""
        self.snaps = not self.snaps
        self._changes += 1

    def drag(self, dx: float, dy: float, turn: bool, height: int) -> None:
        magnifier = self.magnifiers.get(self.camera)
        if magnifier is not None:
            magnifier.pan(dx, dy)

    def wheel(self, x: float, y: float, notches: float) -> None:
        """Zoom at the pointer; over the list, select the next or previous point."""
        magnifier = self.magnifiers.get(self.camera)
        if magnifier is not None and magnifier.holds(x, y):
            magnifier.zoom(notches, x, y)
        else:
            self.step_point(-1 if notches > 0 else 1)

    def reset(self) -> None:
        self.magnifiers.pop(self.camera, None)
        self._changes += 1

    @property
    def status(self) -> str:
        if self.problem:
            return self.problem
        if self.marks is None:
            return ""
        names = self.names()
        return advice(self.marks, names, self.camera, self._number()) if names else ""


@lru_cache(maxsize=1)
def _solved(take: Take, written: int) -> Mapping[str, TiePointReport]:
    """Figures by point from the last calibration, if it used tie points; `written`: when, see `modified`."""
    report = read_cameras_report(take)
    return report.tie_points if isinstance(report, CalibrationReport) else {}
