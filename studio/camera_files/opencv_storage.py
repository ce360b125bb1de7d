"""Calibrations in OpenCV's FileStorage format (XML or YAML).

`Storage` reads the values of a file. `read_opencv_cameras` reads rigs that have one file per camera, such as
`{camera}/config.xml`. Keys differ from program to program; known names of the intrinsics K, the distortion, the
rotation (a vector or a matrix, world to camera) and the translation are compared in lower case without underscores.
Pixel coordinates are OpenCV's: the center of the first pixel is (0, 0).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from studio.camera_files.common import naming, no_cameras, read_text, wrong_shape
from studio.camera_files.nearby import size_nearby, size_within
from studio.cameras import Camera, Rig
from studio.capture.patterns import find_files
from studio.errors import StudioError
from studio.validation import check_finite, missing_key, whole

EXTENSIONS = frozenset({".xml", ".yml", ".yaml"})
_K = ("cameramatrix", "intrinsicmatrix", "intrinsics", "intrinsic", "k", "mtx", "m")
_DISTORTION = (
    "distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoefs", "distortion", "dist", "d",
)  # fmt: skip
_ROTATION = ("rotationvalues", "rotationmatrix", "rotationvector", "rotation", "rvec", "rot", "r")
_TRANSLATION = ("translationvalues", "translationvector", "translation", "tvec", "trans", "t")
_POSE = ("extrinsicmatrix", "extrinsics", "extrinsic", "worldtocamera", "rt", "pose")
_WIDTH, _HEIGHT = ("imagewidth", "width", "w"), ("imageheight", "height", "h")


class Storage:
    """A file, parsed by OpenCV; its values are validated.

    Raises:
        StudioError: it cannot be read or parsed (camera_file.*).
    """

    def __init__(self, path: Path) -> None:
        import cv2

        self.path = path
        text = read_text(path)
        try:
            self.storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        except (cv2.error, SystemError) as error:  # OpenCV 5's bindings raise SystemError for some errors
            reason = str(error.__cause__ or error).split("error:")[-1].strip().splitlines()[0]
            raise StudioError(
                "camera_file.syntax",
                f"OpenCV cannot parse the file ({reason})",
                file=path,
                fix="The file may be truncated: export the cameras again.",
            ) from None

    def names(self) -> list[str]:
        """The list `names`."""
        node = self.storage.getNode("names")
        if node.empty() or not node.size():
            raise no_cameras("the list 'names' is missing or empty", self.path)
        entries = [node.at(index) for index in range(node.size())]
        return [entry.string() if entry.isString() else str(int(entry.real())) for entry in entries]

    def key(self, known: tuple[str, ...]) -> str | None:
        """The first of the known keys, in lower case without underscores, that the file has."""
        keys = {key.lower().replace("_", ""): key for key in self.storage.root().keys()}  # noqa: SIM118
        return next((keys[name] for name in known if name in keys), None)

    def matrix(self, key: str, camera: str, shapes: tuple[tuple[int, int], ...] = ()) -> np.ndarray | None:
        """A finite matrix of one of the shapes (any if empty); None if the key is missing. A list is a column."""
        import cv2

        node = self.storage.getNode(key)
        if node.empty():
            return None
        value: Any = None
        try:
            if node.isMap():
                value = node.mat()
            elif node.isSeq():
                value = np.array([[node.at(index).real()] for index in range(node.size())])
        except cv2.error:
            value = None
        if value is None:
            raise StudioError(
                "camera.not_a_matrix",
                f"Camera '{camera}': '{key}' is not a complete matrix",
                file=self.path,
                fix="Export the cameras again.",
                camera=camera,
                key=key,
            )
        matrix = np.asarray(value, np.float64)
        with naming(self.path):
            if shapes and matrix.shape not in shapes:
                raise wrong_shape(key, camera, matrix.shape, shapes)
            check_finite(matrix, key, camera)
        return matrix

    def needed(self, key: str, camera: str, shapes: tuple[tuple[int, int], ...] = ()) -> np.ndarray:
        """A required matrix."""
        matrix = self.matrix(key, camera, shapes)
        if matrix is None:
            with naming(self.path):
                raise missing_key(key, camera)
        return matrix

    def whole(self, key: str, camera: str) -> int | None:
        """An integer, or None if the key is missing."""
        node = self.storage.getNode(key)
        if node.empty():
            return None
        value = node.real() if node.isInt() or node.isReal() else node.string() if node.isString() else None
        with naming(self.path):
            return whole({key: value}, key, camera)


def read_opencv_cameras(root: Path, pattern: str) -> Rig:
    """A rig from one file per camera.

    Args:
        root: folder of the capture.
        pattern: path of the files below it, with `{camera}`.

    Raises:
        StudioError: no file matches (camera_file.no_cameras), a file cannot be read (camera_file.*), or a camera lacks
            a value or its size is unknown (camera.*).
    """
    matches = find_files(root, pattern, EXTENSIONS)
    if not matches:
        raise no_cameras(f"no file matches '{pattern}'", root)
    with naming(root / pattern):
        return Rig(tuple(_camera(root, match.path, match.camera) for match in matches))


def _camera(root: Path, path: Path, name: str) -> Camera:
    import cv2

    storage = Storage(path)
    with naming(path):
        key = storage.key(_K)
        if key is None:
            raise missing_key("camera_matrix", name)
        K = storage.needed(key, name, ((3, 3),)).copy()
        K[:2, 2] += 0.5
        key = storage.key(_DISTORTION)
        distortion = storage.matrix(key, name) if key is not None else None
        transform = np.eye(4)
        pose, rotation, translation = storage.key(_POSE), storage.key(_ROTATION), storage.key(_TRANSLATION)
        if rotation is not None and translation is not None:
            value = storage.needed(rotation, name, ((3, 1), (1, 3), (3, 3)))
            transform[:3, :3] = cv2.Rodrigues(value)[0] if value.size == 3 else value
            transform[:3, 3] = storage.needed(translation, name, ((3, 1), (1, 3))).ravel()
        elif pose is not None:
            value = storage.needed(pose, name, ((3, 4), (4, 4)))
            transform[:3] = value[:3]
        else:
            raise StudioError(
                "camera.missing_key",
                f"Camera '{name}': the file has intrinsics, but no rotation and translation",
                fix="Set capture.rig to files with poses, or to null to calibrate from the footage.",
                camera=name,
                key="rotation",
            )
        width, height = (
            storage.whole(key, name) if key is not None else None for key in (storage.key(_WIDTH), storage.key(_HEIGHT))
        )
        if width is None or height is None or width < 1 or height < 1:
            width, height = size_within(path.parent, name) or size_nearby(root, name, name)
        coefficients = distortion.ravel() if distortion is not None and distortion.any() else np.zeros(0)
        return Camera(name, width, height, K, transform, coefficients)
