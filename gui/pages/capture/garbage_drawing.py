"""Garbage masks drawn in the window: polygons of one camera where the performer never is."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.palette import BAD, FAIR, GOOD
from v3studio.gui.models.history import Change
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.playback.image_zoom import Magnifier
from v3studio.gui.models.take.settings import setting_value
from v3studio.gui.models.take.workspace import Workspace, modified
from v3studio.pipelines.takes.authored.drawn_masks import DRAWN, file_of_garbage
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.studio.atomic_files import remove, write_bytes
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.garbage_polygons import (
    EXTENSIONS,
    GarbagePolygons,
    read_garbage_polygons,
    write_garbage_polygons,
)
from v3studio.studio.storage import is_address

SETTING = "capture.garbage_masks"
Polygons = Mapping[str, GarbagePolygons]
Point = tuple[float, float]
_State = tuple[object, Polygons | None]  # the value of the setting, and the take's own polygons; None: no file


class GarbageDrawing:
    """Polygons that exclude parts of the images. They are kept in the take; a file that the setting named before stays
    as it is. `corners`: of the polygon that is being drawn, pixels of the footage.

    Signals:
        outcome: a change was made, "", or is refused for this reason.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self.corners: tuple[Point, ...] = ()
        self.outcome: Signal[[str]] = Signal()
        self._corners_of: object = None

    def polygons(self) -> Polygons:
        """The polygons in use, by camera. Raises StudioError: they are images, or the file cannot be read."""
        context = self._workspace.context
        if context is None or not context.config.capture.garbage_masks:
            return {}
        return read_garbage_polygons(self._path())

    @property
    def stamp(self) -> object:
        """Changes with the polygons in use."""
        context = self._workspace.context
        if context is None or not context.config.capture.garbage_masks:
            return None
        in_take = file_of_garbage(context.config.capture, context.take) is not None
        if not in_take and is_address(context.config.capture.root):  # objects are not asked for at each tick
            return None
        with suppress(StudioError):
            return modified(self._path())
        return None

    def click(self, camera: str, at: Point, size: tuple[int, int], reach: float) -> None:
        """Add a corner; close the polygon if it is within `reach` of the first one. In pixels of the footage."""
        of = (camera, self._workspace.take and self._workspace.take.root)
        if of != self._corners_of:  # another camera, or another take
            self.corners, self._corners_of = (), of
        at = (min(max(at[0], 0.0), float(size[0])), min(max(at[1], 0.0), float(size[1])))
        if not self.corners or np.hypot(*np.subtract(at, self.corners[0])) > reach:
            self.corners = (*self.corners, at)
        elif len(self.corners) > 2:
            self._close(camera, size)

    def right_click(self, camera: str, at: Point, size: tuple[int, int]) -> None:
        """Take back the last corner; without one, delete the polygon under the pointer."""
        if self.corners:
            self.corners = self.corners[:-1]
            return
        try:
            old = self.polygons()
        except StudioError as error:
            self.outcome.emit(str(error))
            return
        polygons = old.get(camera, GarbagePolygons())
        x, y = (np.array(at) * _scale(polygons, size)).tolist()
        inside = cv2.pointPolygonTest
        left = tuple(each for each in polygons.remove if inside(each.astype(np.float32), (x, y), False) < 0)
        if len(left) < len(polygons.remove):
            self._write({**old, camera: replace(polygons, remove=left)}, f"delete a garbage mask of {camera}")

    def leave(self) -> bool:
        """Forget the unfinished polygon; returns whether there was one."""
        begun, self.corners = bool(self.corners), ()
        return begun

    def _close(self, camera: str, size: tuple[int, int]) -> None:
        context = self._workspace.context
        try:
            used = context is not None and context.config.capture.garbage_masks
            old = self.polygons() if used else self._own() or {}  # or the file would lose what is in it
        except StudioError as error:
            self.outcome.emit(str(error))
            return
        polygons = old.get(camera, GarbagePolygons())
        polygon = np.array(self.corners) * _scale(polygons, size)
        new = {**old, camera: replace(polygons, remove=(*polygons.remove, polygon))}
        if self._write(new, f"garbage mask of {camera}"):
            self.corners = ()

    def _path(self) -> Path:
        context = self._workspace.context
        assert context is not None
        named = context.config.capture.garbage_masks or ""
        if Path(named).suffix.lower() not in EXTENSIONS:
            problem = "the garbage masks of this take are images, so no polygons can be drawn"
            fix = f"Empty {SETTING}, or add polygons to the images."
            raise StudioError("gui.garbage_images", problem, value=named, fix=fix, setting=SETTING)
        in_take = file_of_garbage(context.config.capture, context.take)
        return in_take if in_take is not None else context.capture.root / Path(named).expanduser()

    def _own(self) -> Polygons | None:
        """The polygons in the take, also while they are not used; None: no file."""
        take = self._workspace.take
        return read_garbage_polygons(take.garbage) if take is not None and take.garbage.is_file() else None

    def _write(self, polygons: Polygons, words: str) -> bool:
        """Use these polygons as one change, which can be undone; returns whether that was possible."""
        workspace = self._workspace
        take, context = workspace.take, workspace.context
        if take is None or context is None:
            return False
        left = {camera: own for camera, own in polygons.items() if own.keep or own.remove}
        after: _State = (DRAWN, left) if left else (None, None)
        try:
            before: _State = (setting_value(context.config, SETTING), self._own())
            self._apply(after)
        except StudioError as error:
            self.outcome.emit(str(error))
            return False
        workspace.history.add(Change(words, lambda: self._apply(before), lambda: self._apply(after)))
        self.outcome.emit("")
        return True

    def _apply(self, state: _State) -> None:
        """Write the file and the setting, both or neither. Raises StudioError."""
        workspace, (value, polygons) = self._workspace, state
        take, _ = workspace.changeable()
        with disk_errors(take.root):
            before = take.garbage.read_bytes() if take.garbage.is_file() else None
            if polygons is not None:
                write_garbage_polygons(take.garbage, polygons)
            try:
                workspace.write_settings({SETTING: value})
            except StudioError:
                if before is not None:
                    write_bytes(take.garbage, before)
                else:
                    remove(take.garbage)
                raise
            if polygons is None:
                remove(take.garbage)
        workspace.inputs_changed()


def _scale(polygons: GarbagePolygons, size: tuple[int, int]) -> np.ndarray:
    """Pixels of the polygons per pixel of an image of this size."""
    return np.ones(2) if polygons.size is None else np.array(polygons.size) / size


def draw_garbage(canvas: Canvas, image: Magnifier, polygons: GarbagePolygons | None, corners: Sequence[Point]) -> None:
    """Draw a camera's polygons over its image."""
    if polygons is not None:
        scale = _scale(polygons, (image.width, image.height))
        fill = np.zeros(canvas.pixels.shape[:2], np.uint8)
        places = [image.shown(polygon / scale) for polygon in polygons.remove]
        for place in places:
            cv2.fillPoly(fill, [np.rint(place).astype(np.int32)], 255)
        mixed = 0.55 * canvas.pixels + 0.45 * np.array(BAD)
        canvas.pixels[:] = np.where(fill[..., None] > 0, mixed, canvas.pixels).astype(np.uint8)
        for place in places:
            canvas.line(np.vstack([place, place[:1]]), BAD, 2)
        for polygon in polygons.keep:
            place = image.shown(polygon / scale)
            canvas.line(np.vstack([place, place[:1]]), GOOD, 2)
    if corners:
        place = image.shown(np.array(corners))
        if len(place) > 1:
            canvas.line(place, FAIR, 2)
        for x, y in place:
            canvas.dot(x, y, 4, FAIR)
        canvas.dot(place[0, 0], place[0, 1], 8, FAIR, filled=False)
