"""Points marked by hand, as they are being marked: which is chosen, where it is seen, and the file they live in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from studio.calibration import TiePoint, read_tie_points, write_tie_points
from studio.cameras import Camera, Rig

LEAST = 6
"""Marks that a camera should have at least."""


class TieMarks:
    """The points of a file, which is written at each change.

    Args:
        path: the file; it need not be there yet.

    Attributes:
        points: in the order of the list; a point without a mark is kept here, not in the file.
        chosen: index of the point that the next click marks.
        changes: grows with each change.

    Raises:
        StudioError: the file is there and cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.points: list[TiePoint] = list(read_tie_points(path)) if path.is_file() else []
        self.chosen = 0
        self.changes = 0
        self._before: list[tuple[list[TiePoint], int]] = []
        self._stamp = self._time()

    def _time(self) -> int:
        return self.path.stat().st_mtime_ns if self.path.is_file() else 0

    @property
    def stale(self) -> bool:
        """Whether somebody else has changed the file since."""
        return self._time() != self._stamp

    @property
    def point(self) -> TiePoint | None:
        """The chosen point; None where there is none."""
        return self.points[self.chosen] if 0 <= self.chosen < len(self.points) else None

    def count(self, camera: str) -> int:
        """How many points are marked in a camera."""
        return sum(camera in point.pixels for point in self.points)

    def choose(self, index: int) -> None:
        """The point of this index, as far as there is one."""
        self.chosen = min(max(index, 0), max(len(self.points) - 1, 0))
        self.changes += 1

    def add(self) -> None:
        """A new point, chosen."""
        names = {point.name for point in self.points}
        number = next(n for n in range(1, len(names) + 2) if f"point {n}" not in names)
        self.points = [*self.points, TiePoint(f"point {number}")]
        self.choose(len(self.points) - 1)

    def mark(self, camera: str, x: float, y: float, frame: int) -> None:
        """The chosen point (a new one where there is none) lies here in a camera's picture.

        Raises:
            StudioError: the file cannot be written.
        """
        if self.point is None:
            self.add()
        point = self.points[self.chosen]
        pixels = {**point.pixels, camera: (float(x), float(y))}
        self._put(replace(point, pixels=pixels, frame=frame if point.frame is None else point.frame))

    def unmark(self, camera: str) -> None:
        """The chosen point is not seen in a camera after all."""
        point = self.point
        if point is not None and camera in point.pixels:
            self._put(replace(point, pixels={name: xy for name, xy in point.pixels.items() if name != camera}))

    def describe(self, text: str) -> str:
        """Name the chosen point and say where it lies, as in "corner of the mat; 0 0.3 0"; returns what is wrong.

        Without numbers its place in the world is not known.
        """
        point = self.point
        if point is None:
            return "Choose a point first."
        name, _, place = (part.strip() for part in text.partition(";"))
        if not name:
            return "A point needs a name."
        if any(other.name == name for other in self.points if other is not point):
            return f"Another point is called '{name}'; give each a name of its own."
        world = None
        if place:
            words = place.replace(",", " ").split()
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                numbers = []
            if len(numbers) != 3 or not np.isfinite(numbers).all():
                return f"'{place}' is no place: give three numbers in meters, as in 0 0.3 0 (z is up)."
            world = (numbers[0], numbers[1], numbers[2])
        self._put(replace(point, name=name, world=world))
        return ""

    def remove(self) -> None:
        """The chosen point goes altogether."""
        if self.point is not None:
            self._change(self.points[: self.chosen] + self.points[self.chosen + 1 :])
            self.choose(self.chosen)

    def undo(self) -> None:
        """Take the last change back, and the ones before."""
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
        self._stamp = self._time()


def advice(marks: TieMarks, names: Sequence[str], camera: str, frame: int | None) -> str:
    """What a click in a camera does, and which cameras have too few marks.

    Args:
        marks: the points.
        names: all cameras.
        camera: the one that is shown.
        frame: the footage's number of the frame that is shown.
    """
    point = marks.point
    if point is None:
        words = "a click begins a point"
    elif None not in (point.frame, frame) and point.frame != frame and point.pixels:
        words = f"'{_short(point.name)}' was marked in frame {point.frame}, this is {frame}: only for what stands still"
    else:
        does = "moves" if camera in point.pixels else "marks"
        words = f"a click {does} '{_short(point.name)}' in {camera}; wheel and drag look closer"
    few = [name for name in names if marks.count(name) < LEAST]
    if few:
        more = f" and {len(few) - 3} more" if len(few) > 3 else ""
        words += f"; fewer than {LEAST} marks: {', '.join(few[:3])}{more}"
    return words


def _short(name: str) -> str:
    return name if len(name) < 32 else f"{name[:30].rstrip()}…"


def expected(point: TiePoint, camera: Camera, rig: Rig) -> np.ndarray | None:
    """Where cameras that stand say that a point lies in a camera's picture.

    Returns:
        (1, 2) its place, from two other cameras' marks or more; (N, 2) a line on which it lies, from one mark; None
        without any.
    """
    from studio.calibration.manual.bootstrap import Observations, TieRig, triangulate

    others = [name for name in point.pixels if name != camera.name and name in rig]
    if not others:
        return None
    if len(others) > 1:
        seen = {name: np.array([point.pixels[name]]) for name in others}
        solved = TieRig({name: rig[name] for name in others}, np.full((1, 3), np.nan))
        triangulate(Observations([point.name], solved.points3d, seen), solved)
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
