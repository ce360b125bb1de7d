"""The contents of the scene besides splats: cameras, points, mesh, grid, axes, and the box around the visual hull."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from v3studio.gui.drawing.palette import AXES, LINE, RGB
from v3studio.gui.drawing.plots import round_step
from v3studio.gui.models.stages import Inputs
from v3studio.pipelines.share.cast_frames import CastFrames
from v3studio.pipelines.takes.take import Take
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.similarity import Similarity

PARTS = ("splats", "set", "cameras", "points", "mesh", "grid", "axes", "volume")
SHOWN_AT_FIRST = frozenset({"splats", "set", "cameras", "grid", "axes", "volume"})

FRUSTUM = 0.16  # length of the frusta, relative to the median distance of the cameras from the performer
GRID_CELLS = 5  # cells of the grid on each side of its middle

Color = tuple[float, float, float]


class Surface(Protocol):
    """A triangle mesh."""

    def seen(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """(H, W, 3) uint8 RGB and (H, W) float32 depth, infinite beside the mesh."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneRequest:
    """A frame, and what to show of it."""

    take: Take | None  # None for a bare stream
    context: Inputs | None  # the take with its footage; None if there is none, or its settings cannot be read
    rig: Rig | None
    frame: int  # counted from 0
    number: int | None  # of the frame in the footage; None if that is not known: they are counted from 0, too
    group: int  # the frame's group
    camera: str  # name of the capture camera that one looks through; "" for the free view
    background: Color  # RGB in 0 to 1
    parts: frozenset[str]  # of `PARTS`
    up: np.ndarray
    points: np.ndarray  # (N, 3) points of the performer
    still: bool  # whether the view rests: time for full resolution, and for the frame's images on the frusta
    em: float
    cast: CastFrames | None  # with models and a ground; None for none


@dataclass(frozen=True, eq=False)
class SceneCamera:
    """A capture camera. `image`: (h, w, 3) uint8 of its frame, small; None if it is not known."""

    camera: Camera
    color: RGB
    image: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines in the world. `ends`: (M, 2, 3). `colors`: (M, 3) uint8. `width`: pixels."""

    ends: np.ndarray
    colors: np.ndarray
    width: float = 1.0

    @classmethod
    def of(cls, ends: Sequence[Sequence[np.ndarray]] | np.ndarray, color: RGB, width: float = 1.0) -> Lines:
        array = np.asarray(ends, np.float64).reshape(-1, 2, 3)
        return cls(array, np.tile(np.array(color, np.uint8), (len(array), 1)), width)


Cloud = tuple[np.ndarray, np.ndarray, int]  # points (N, 3), colors (N, 3) uint8, and a radius, pixels


def cloud(points: np.ndarray, colors: np.ndarray) -> Cloud:
    """Points (N, 3) with colors (N, 3) in 0 to 1."""
    return points, (np.clip(colors, 0, 1) * 255).astype(np.uint8), 2


@dataclass(frozen=True, eq=False)
class SceneContents:
    """The scene besides splats, world units. `length`: of frusta. `surfaces`: meshes, the ground, and their places."""

    cameras: Sequence[SceneCamera] = ()
    length: float = 1.0
    points: Sequence[Cloud] = ()
    surfaces: Sequence[tuple[Surface, Similarity]] = ()
    lines: Sequence[Lines] = ()
    words: str = ""

    def seen_from(self, eye: np.ndarray) -> SceneContents:
        """The scene without cameras so near to a point (3,) that their images would cover the view."""
        far = [shown for shown in self.cameras if np.linalg.norm(shown.camera.center - eye) > 1.2 * self.length]
        return replace(self, cameras=tuple(far))


def frustum_length(rig: Rig, target: np.ndarray) -> float:
    """Length of the frusta for cameras around a point (3,)."""
    distances = np.linalg.norm(rig.centers - target, axis=1)
    return FRUSTUM * float(np.median(distances)) if len(distances) else 1.0


def grid_lines(middle: np.ndarray, up: np.ndarray, height: float, reach: float) -> tuple[Lines, float]:
    """A grid on the ground, up to twice as wide as `reach`, the performer's size; and the size of a cell."""
    step = round_step(max(0.4 * reach / GRID_CELLS, 1e-9))
    first = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    # on multiples of the step, so that it stays where it is while the performer moves
    start = np.round(np.array([middle @ first, middle @ second]) / step) * step
    ends = []
    half = GRID_CELLS * step
    for cell in range(-GRID_CELLS, GRID_CELLS + 1):
        for across, down, at in ((first, second, start), (second, first, start[::-1])):
            along = height * up + (at[0] + cell * step) * across
            ends.append((along + (at[1] - half) * down, along + (at[1] + half) * down))
    return Lines.of(ends, LINE), step


def axis_lines(origin: np.ndarray, directions: np.ndarray, length: float) -> Lines:
    """Three axes: x red, y green, z blue. `directions`: (3, 3) unit vectors, one per row."""
    ends = np.stack([np.tile(origin, (3, 1)), origin + length * directions], axis=1)
    return Lines(ends, np.array(AXES, np.uint8), 3.0)


def box_lines(corners: np.ndarray, color: RGB, width: float) -> Lines:
    """The edges of a box with corners (8, 3), in the order of `CropBox.corners`."""
    edges = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]
    return Lines.of(corners[np.array(edges)], color, width)
