"""The editing state of manual tie points: points, selection, undo, and their file."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from v3studio.gui.models.take.workspace import modified
from v3studio.studio.calibration import TiePoint, read_tie_points, write_tie_points
from v3studio.studio.cameras import Camera, Rig

LEAST = 6  # recommended minimum of marks per camera


class TieMarks:
    """The points of a file in list order (StudioError: unreadable); those with marks are saved after each change."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.points: list[TiePoint] = list(read_tie_points(path)) if path.is_file() else []
        self.chosen = 0
        self.changes = 0
        self._before: list[tuple[list[TiePoint], int]] = []
        self._stamp = modified(path)

    @property
    def stale(self) -> bool:
        """Whether another program has changed the file."""
        return modified(self.path) != self._stamp

    @property
    def point(self) -> TiePoint | None:
        return self.points[self.chosen] if 0 <= self.chosen < len(self.points) else None

    def count(self, camera: str) -> int:
        """The number of points marked in a camera."""
        return sum(camera in point.pixels for point in self.points)

    def choose(self, index: int) -> None:
        """Select a point; the index is clamped."""
        self.chosen = min(max(index, 0), max(len(self.points) - 1, 0))
        self.changes += 1

    def add(self) -> None:
        names = {point.name for point in self.points}
        number = next(n for n in range(1, len(names) + 2) if f"point {n}" not in names)
        self.points = [*self.points, TiePoint(f"point {number}")]
        self.choose(len(self.points) - 1)

    def mark(self, camera: str, x: float, y: float, frame: int) -> None:
        """Mark the selected point (or a new one) at a pixel of a camera's image. Raises StudioError: not writable."""
        if self.point is None:
            self.add()
        point = self.points[self.chosen]
        pixels = {**point.pixels, camera: (float(x), float(y))}
        self._put(replace(point, pixels=pixels, frame=frame if point.frame is None else point.frame))

    def unmark(self, camera: str) -> None:
        """Remove the selected point's mark in a camera."""
        point = self.point
        if point is not None and camera in point.pixels:
            self._put(replace(point, pixels={name: xy for name, xy in point.pixels.items() if name != camera}))

    def describe(self, name: str, place: str) -> str:
        """Set the name of the selected point and its position, "" or such as "0 0.3 0". Returns "" or an error."""
        point = self.point
        if point is None:
            return "Select a point first."
        name = name.strip()
        if not name:
            return "A point needs a name."
        if any(other.name == name for other in self.points if other is not point):
            return f"Another point is named '{name}'. Choose a unique name."
        world = None
        if place.strip():
            words = place.replace(",", " ").split()
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                numbers = []
            if len(numbers) != 3 or not np.isfinite(numbers).all():
                return f"'{place}' is not a position of three numbers in meters (z up). Example: 0 0.3 0."
            world = (numbers[0], numbers[1], numbers[2])
        self._put(replace(point, name=name, world=world))
        return ""

    def remove(self) -> None:
        if self.point is not None:
            self._change(self.points[: self.chosen] + self.points[self.chosen + 1 :])
            self.choose(self.chosen)

    def undo(self) -> None:
        if self._before:
            self.points, self.chosen = self._before.pop()
            self._write()

    def _put(self, point: TiePoint) -> None:
        self._change([*self.points[: self.chosen], point, *self.points[self.chosen + 1 :]])

    def _change(self, points: list[TiePoint]) -> None:
        self._before.append((self.points, self.chosen))
        self.points = points
        self._write()

    def _write(self) -> None:
        self.changes += 1
        write_tie_points([point for point in self.points if point.pixels], self.path)
        self._stamp = modified(self.path)


def advice(marks: TieMarks, names: Sequence[str], camera: str, frame: int | None) -> str:
    """Status line: what a click does, and which cameras have too few marks. `frame`: its number in the footage."""
    point = marks.point
    if point is None:
        words = "click to add a point"
    elif None not in (point.frame, frame) and point.frame != frame and point.pixels:
        moved = f"marked in frame {point.frame}, but this is frame {frame}; it must not have moved"
        words = f"'{_short(point.name)}' was {moved}"
    else:
        does = "move" if camera in point.pixels else "mark"
        words = f"click to {does} '{_short(point.name)}' in {camera}; wheel and drag to zoom and pan"
    few = [name for name in names if marks.count(name) < LEAST]
    if few:
        more = f" and {len(few) - 3} more" if len(few) > 3 else ""
        words += f"; fewer than {LEAST} marks: {', '.join(few[:3])}{more}"
    return words


def _short(name: str) -> str:
    return name if len(name) < 32 else f"{name[:30].rstrip()}…"


def expected(point: TiePoint, camera: Camera, rig: Rig) -> np.ndarray | None:
    """The place of a point in a camera's image, predicted from marks in others: (1, 2) a pixel, from two or more;
    (N, 2) its epipolar line, from a single one; None without other marks."""
    from v3studio.studio.calibration.manual.bootstrap import Observations, TieRig, triangulate

    others = [name for name in point.pixels if name != camera.name and name in rig]
    if not others:
        return None
    if len(others) > 1:
        seen = {name: np.array([point.pixels[name]]) for name in others}
        unknown = np.full((1, 3), np.nan)
        solved = TieRig({name: rig[name] for name in others}, unknown, Observations([point.name], unknown, seen))
        triangulate(solved)
        places = solved.points3d
    else:
        other = rig[others[0]]
        ray = other.normalized(np.array([point.pixels[others[0]]]))[0]
        away = float(np.linalg.norm(other.center - rig.focus))
        depths = away * np.geomspace(0.2, 3.0, 60)
        local = np.column_stack([ray[0] * depths, ray[1] * depths, depths])
        places = (local - other.translation) @ other.rotation
    pixels, depth = camera.project(places)
    inside = (depth > 0) & (pixels >= -200).all(1) & (pixels <= np.array([camera.width, camera.height]) + 200).all(1)
    return pixels[inside] if inside.any() else None
