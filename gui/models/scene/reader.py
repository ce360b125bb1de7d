"""Reads what the scene shows from the take, and keeps it until a file changes. Runs on the viewport's thread."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TypeVar, cast

import cv2
import numpy as np

from v3studio.gui.drawing.palette import FAIR, HELD_OUT, RGB
from v3studio.gui.models.held_out import held_out_cameras
from v3studio.gui.models.scene import contents as scene
from v3studio.gui.models.scene.contents import Lines, SceneCamera, SceneContents, SceneRequest, Surface
from v3studio.gui.models.scene.handles import up_of
from v3studio.gui.models.stages import Inputs
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.pipelines.takes.results.point_files import read_points, read_sparse_points
from v3studio.studio.cameras import Rig
from v3studio.studio.counts import counted
from v3studio.studio.edits.edit_list import EditList
from v3studio.studio.errors import StudioError
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.similarity import Similarity

OTHERS: RGB = (150, 156, 166)  # color of the frusta of cameras that are not held out

THUMBNAIL = 160  # longer side of the images on the frusta, pixels

MOST_THUMBNAILS = 200

SmallImages = MemoryCache[tuple[str, int], np.ndarray]  # by camera and frame
Points = tuple[np.ndarray, np.ndarray]
Content = TypeVar("Content")


class SceneReader:
    """Reads the scene, and keeps it until a file changes. `read_mesh`: reads a mesh file."""

    def __init__(self, read_mesh: Callable[[Path], Surface | None]) -> None:
        self._read_mesh = read_mesh
        self._files: MemoryCache[tuple[Path, int], object] = MemoryCache(9)
        self._images: SmallImages = MemoryCache(MOST_THUMBNAILS)
        self._last: dict[str, np.ndarray | None] = {}
        self._context: object = None

    def read(self, wanted: SceneRequest) -> SceneContents:
        """The contents beside the splats. Raises StudioError: a damaged file."""
        edits = EditList()
        points: Points = np.zeros((0, 3)), np.zeros((0, 3))
        sparse, words = points, list[str]()
        surfaces: list[tuple[Surface | None, Similarity]] = []
        if wanted.take is not None:
            folder = wanted.take.initialize_group(wanted.group)
            edits = self._file(wanted.take.edits, read_edits, edits)
            points = self._file(folder / "points.ply", read_points, points)
            if "points" in wanted.parts:
                rig = wanted.take.rig
                sparse = self._file(wanted.take.calibration_points, partial(read_sparse_points, rig=rig), points)
                words.append(counted(len(sparse[0]), "initial point" if sparse is points else "sparse point"))
            if "mesh" in wanted.parts:
                surfaces.append((self._file(folder / "mesh.ply", self._read_mesh, None), Similarity()))
        if wanted.cast is not None:
            surfaces = [(wanted.cast.ground(wanted.frame), Similarity())]
        body = points[0] if len(points[0]) else wanted.points
        lines: list[Lines] = []
        if len(body):
            up = up_of(edits, wanted.up)
            low, high = body.min(axis=0), body.max(axis=0)
            middle, reach = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
            if "grid" in wanted.parts:
                # from all frames where they are known, so that it does not change from group to group
                around = wanted.points if len(wanted.points) else body
                height = edits.ground.height if edits.ground is not None else float(np.quantile(around @ up, 0.002))
                normal = edits.ground.unit if edits.ground is not None else up
                ends = np.quantile(around, (0.01, 0.99), axis=0)  # without strays
                grid, step = scene.grid_lines(
                    (ends[0] + ends[1]) / 2, normal, height, float(np.linalg.norm(ends[1] - ends[0])) or 1.0
                )
                lines.append(grid)
                words.append(f"grid {step * edits.similarity.scale:g}")
            if "axes" in wanted.parts:
                back = edits.similarity.inverse
                lines.append(scene.axis_lines(back.points(np.zeros(3)), back.directions(np.eye(3)), 0.25 * reach))
            if "volume" in wanted.parts and len(points[0]):
                corners = np.where(np.arange(8)[:, None] >> np.arange(3) & 1, high, low)
                lines.append(scene.box_lines(corners, FAIR, 1.5))
                size = " x ".join(f"{side:.3g}" for side in (high - low) * edits.similarity.scale)
                words.append(f"visual hull {size}")
        else:
            middle = np.zeros(3)
        cameras: tuple[SceneCamera, ...] = ()
        length = 1.0
        if wanted.rig is not None and "cameras" in wanted.parts:
            cameras, length = self._cameras(wanted, wanted.rig), scene.frustum_length(wanted.rig, middle)
        return SceneContents(
            cameras=cameras,
            length=length,
            points=[scene.cloud(*sparse)],
            surfaces=[(surface, at) for surface, at in surfaces if surface is not None],
            lines=lines,
            words="   ".join(words),
        )

    def _file(self, path: Path, read: Callable[[Path], Content], missing: Content) -> Content:
        """The content of a file, `missing` if it does not exist."""
        if not path.is_file():
            return missing
        return cast(Content, self._files.get_or_make((path, path.stat().st_mtime_ns), lambda _: read(path)))

    def _cameras(self, wanted: SceneRequest, rig: Rig) -> tuple[SceneCamera, ...]:
        if self._context is not wanted.context:
            self._context = wanted.context
            self._images.clear()
            self._last.clear()
        held_out = held_out_cameras(wanted.context)
        return tuple(
            SceneCamera(
                camera.undistorted(),
                HELD_OUT if camera.name in held_out else OTHERS,
                self._image(wanted, camera.name),
            )
            for camera in rig
            if camera.name != wanted.camera  # one looks through it
        )

    def _image(self, wanted: SceneRequest, name: str) -> np.ndarray | None:
        """The camera's image of the frame; until the view rests, the last one that was read."""
        context, key = wanted.context, (name, wanted.frame)
        if context is not None and (wanted.still or key in self._images):
            self._last[name] = small_image(self._images, context, *key, wanted.number)
        return self._last.get(name)

    def forget(self) -> None:
        self._files.clear()
        self._images.clear()
        self._last.clear()


def small_image(
    images: SmallImages, context: Inputs, camera: str, frame: int, number: int | None = None
) -> np.ndarray | None:
    """(h, w, 3) uint8: a camera's image of a frame for its frustum, by its number, or counted from 0 if that is None;
    kept in `images`. None if it cannot be read now: the Capture view says why."""

    def read(key: tuple[str, int]) -> np.ndarray:
        footage = context.raw_footage
        number_in_files = footage.frames[min(frame, len(footage.frames) - 1)] if number is None else number
        whole = footage.raw_image(camera, number_in_files)
        scale = THUMBNAIL / max(whole.shape[:2])
        return cv2.resize(whole, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)

    with suppress(StudioError):
        return images.get_or_make((camera, frame), read)
    return None
