"""Coverage of the performer by training cameras: drawn around the performer, and in figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.gui.drawing.palette import BAD, FAIR, GOOD, GROUND, RGB
from v3studio.gui.models.scene.contents import Cloud
from v3studio.gui.models.take.inspector import Block
from v3studio.studio.calibration.coverage import FADE, LARGEST_GAPS, ViewRange, facing_cameras, gaps, view_range
from v3studio.studio.cameras import Rig

FEW_CAMERAS = (
    "Few cameras: views from the directions that are not covered will be poor, and players fade them out. Add cameras "
    "there, or let players show all views with bake.view_range = none."
)

_COLORS = np.array([GOOD, FAIR, BAD], np.uint8)
_RADIUS = 0.5  # radius of the sphere of directions, as a share of the cameras' distance
_LOWEST = -0.5  # sine of the lowest direction that is drawn: nobody looks from below the floor


@dataclass(frozen=True, eq=False)
class RigCoverage:
    """How well the training cameras see the performer's surface, and from which directions they film it."""

    range: ViewRange  # from where views are good
    cameras: int
    outside: float  # share of the horizontal directions outside of the range, 0 to 1
    farthest: float  # largest angle between such a direction and the nearest camera, degrees
    points: np.ndarray  # (N, 3) on the surface, world units; none before the stage Initialize
    facing: np.ndarray  # (N,) training cameras that see each point
    radius: float
    up: np.ndarray

    @classmethod
    def of(
        cls, rig: Rig, names: Sequence[str], center: np.ndarray, surface: tuple[np.ndarray, np.ndarray] | None
    ) -> RigCoverage | None:
        """Measure a rig by the training cameras `names` that it has; `surface`: points and normals, (N, 3) each, or
        None before the stage Initialize: then `center`, (3,), is the middle of the scene."""
        cameras = [camera for camera in rig if camera.name in names]
        points, normals = surface if surface is not None and len(surface[0]) else (np.zeros((0, 3)), np.zeros((0, 3)))
        views = view_range(cameras, points.mean(0) if len(points) else center)
        if views is None:
            return None
        distance = float(np.median([np.linalg.norm(camera.center - views.center) for camera in cameras]))
        return cls(
            views,
            len(cameras),
            *gaps(views, rig.up),
            points,
            facing_cameras(cameras, points, normals),
            _RADIUS * distance,
            rig.up / np.linalg.norm(rig.up),
        )

    def seen_from(self, eye: np.ndarray, dot: int) -> list[Cloud]:
        """Dots for directions on a sphere, smaller and dark on its far side, and points of the surface inside."""
        towards = _sphere(600)
        towards = towards[towards @ self.up > _LOWEST]
        places = self.range.center + self.radius * towards
        colors = _COLORS[np.digitize(self.range.angles(towards), (self.range.angle, self.range.angle + FADE))]
        near = ((eye - places) * towards).sum(1) > 0
        dark = (0.3 * colors[~near] + 0.7 * np.array(GROUND)).astype(np.uint8)
        surface = (self.points, _COLORS[np.digitize(-self.facing, (-2.5, -1.5))], 2)
        return [(places[~near], dark, max(dot - 1, 1)), surface, (places[near], colors[near], dot)]

    @property
    def legend(self) -> tuple[tuple[str, RGB], ...]:
        """The meaning of the colors."""
        good, fair = f"{self.range.angle:.0f}", f"{self.range.angle + FADE:.0f}"
        words = (
            f"up to {good} degrees from a training camera",
            f"{good} to {fair} degrees: poor",
            "farther: not covered",
        )
        seen = ("; surface: faces 3 or more", "; surface: faces 2", "; surface: faces 1 or none")
        return tuple(
            (word + (more if len(self.points) else ""), color)
            for word, more, color in zip(words, seen, (GOOD, FAIR, BAD), strict=True)
        )

    @property
    def block(self) -> Block:
        """Figures for the inspector."""
        share = round(100 * self.outside)
        rows = [
            ("training cameras", str(self.cameras)),
            ("good views", f"up to {self.range.angle:.0f} degrees away"),
            ("not covered", f"{share}% of all directions"),
            ("farthest view", f"{self.farthest:.0f} degrees away"),
        ]
        if len(self.points):
            rows.append(("surface seen by 0 or 1", f"{100 * float((self.facing < 2).mean()):.0f}%"))
        return Block("Coverage", rows, FEW_CAMERAS if self.outside > LARGEST_GAPS else "")


def _sphere(count: int) -> np.ndarray:
    """(count, 3) directions spread evenly (Fibonacci lattice)."""
    number = np.arange(count) + 0.5
    z, turn = 1 - 2 * number / count, np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
