"""COLMAP model folders, text and binary: cameras.{txt,bin} and images.{txt,bin}.

Follows COLMAP's documentation, "Output Format". Only cameras and poses are read, so models with many points are read
equally fast. Poses are world to camera with OpenCV axes, and the pixel origin is the image corner: the conventions of
`studio.cameras`. Newer models with rigs and frames still contain the pose of each image.
"""

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypedDict

import numpy as np

from v3studio.studio.bounded_files import read_bounded
from v3studio.studio.camera_files.common import camera_names, check_expressible, read_text, unreadable, write_atomic
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.lenses import THIN_PRISM
from v3studio.studio.rotations import matrices_to_quats, quats_to_matrices

# name -> (id in the binary format, number of parameters)
MODELS = {
    "SIMPLE_PINHOLE": (0, 3),
    "PINHOLE": (1, 4),
    "SIMPLE_RADIAL": (2, 4),
    "RADIAL": (3, 5),
    "OPENCV": (4, 8),
    "FULL_OPENCV": (6, 12),
    "OPENCV_FISHEYE": (5, 8),
    "SIMPLE_RADIAL_FISHEYE": (8, 4),
    "RADIAL_FISHEYE": (9, 5),
    "THIN_PRISM_FISHEYE": (10, 12),
}
_ONE_FOCAL_LENGTH = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")


class Intrinsics(TypedDict):
    """The lens of a `Camera`, in its names."""

    K: np.ndarray
    distortion: np.ndarray
    fisheye: bool


def intrinsics(model: str, parameters: Sequence[float]) -> Intrinsics:
    """The lens of a COLMAP camera; a pinhole camera has no distortion coefficients."""
    if model not in MODELS:
        raise _unsupported_model(model)
    if len(parameters) != MODELS[model][1]:
        problem = f"found {len(parameters)} parameters for camera model {model}, expected {MODELS[model][1]}"
        fix = "Export the model again."
        raise StudioError(
            "camera_file.model_parameters", problem, value=len(parameters), fix=fix, expected=MODELS[model][1]
        )
    p = np.array(parameters, np.float64)
    if model in _ONE_FOCAL_LENGTH:
        p = np.concatenate([p[:1], p])  # one focal length for both axes
    K = np.array([[p[0], 0, p[2]], [0, p[1], p[3]], [0, 0, 1.0]])
    distortion = p[4:]
    if len(distortion) in (1, 2):
        distortion = np.concatenate([distortion, np.zeros(4 - len(distortion))])
    fisheye = "FISHEYE" in model
    if model == "THIN_PRISM_FISHEYE":
        distortion = distortion[THIN_PRISM]
    return {"K": K, "distortion": distortion if fisheye or distortion.any() else np.zeros(0), "fisheye": fisheye}


def _unsupported_model(model: str) -> StudioError:
    problem = f"the camera model {model} is not supported"
    fix = f"Undistort the images with COLMAP; supported are {', '.join(MODELS)}."
    return StudioError("camera_file.lens_model", problem, value=model, fix=fix)


def camera_model(camera: Camera) -> tuple[str, list[float]]:
    """COLMAP model name and parameters of a camera."""
    check_expressible(camera, "COLMAP", 8, fisheye=True)
    if camera.fisheye:
        model = "THIN_PRISM_FISHEYE" if np.any(camera.distortion[4:]) else "OPENCV_FISHEYE"
        return model, model_parameters(camera, model)
    model = "PINHOLE" if camera.is_pinhole else "FULL_OPENCV" if np.any(camera.distortion[4:]) else "OPENCV"
    return model, model_parameters(camera, model)


def model_parameters(camera: Camera, model: str) -> list[float]:
    """Parameters of a COLMAP model for a camera, without the distortion terms that the model does not have."""
    focal, distortion = (camera.fx + camera.fy) / 2, np.zeros(8)
    distortion[: camera.distortion.size] = camera.distortion[:8]
    if model == "THIN_PRISM_FISHEYE":
        distortion = distortion[THIN_PRISM]
    base = [focal, camera.cx, camera.cy] if model in _ONE_FOCAL_LENGTH else [camera.fx, camera.fy, camera.cx, camera.cy]
    return base + distortion[: MODELS[model][1] - len(base)].tolist()


_Lens = tuple[str, int, int, list[float]]  # model, width, height, parameters
_Pose = tuple[str, int, list[float]]  # name of an image, id of its camera, quaternion and translation


def is_in(folder: Path) -> bool:
    """Return whether a folder contains a model, or numbered folders with models."""
    return any((folder / f"cameras.{suffix}").is_file() for suffix in ("txt", "bin")) or bool(_numbered_models(folder))


def read(file: CameraFile) -> Rig:
    """Read a model: one camera per registered image, sorted by name and named after the image.

    The path is that of its folder or of one of its files. The folder contains cameras and images as .bin or .txt
    (binary is preferred, as in COLMAP), either directly or in `sparse` or numbered folders in it, of which the one with
    the most images is read.
    """
    folder = file.path if file.path.is_dir() else file.path.parent
    for candidates in ([folder], _numbered_models(folder), [folder / "sparse"], _numbered_models(folder / "sparse")):
        models = [(part, rig) for part, rig in ((part, _read_one(part)) for part in candidates) if rig is not None]
        if not models:
            continue
        largest, rig = max(models, key=lambda model: len(model[1]))
        if len(models) == 1:
            return rig
        counts = ", ".join(f"{part.name} has {len(own)}" for part, own in models)
        note = (
            f"COLMAP made {len(models)} models without common cameras; the largest is used, {largest.name} ({counts})."
        )
        return replace(rig, notes=(*rig.notes, note))
    fix = "A COLMAP model is cameras.bin and images.bin, or cameras.txt and images.txt."
    raise StudioError("camera_file.no_model", "no camera file or COLMAP model in the folder", file=folder, fix=fix)


def _numbered_models(folder: Path) -> list[Path]:
    """The folders 0, 1, ... with cameras.bin or cameras.txt: COLMAP writes several if it cannot connect all images."""
    numbered = [part for part in folder.glob("[0-9]*") if part.name.isdecimal() and part.is_dir()]
    numbered = [part for part in numbered if any((part / f"cameras.{form}").is_file() for form in ("bin", "txt"))]
    return sorted(numbered, key=lambda part: int(part.name))


def _read_one(folder: Path) -> Rig | None:
    forms = {suffix: (folder / f"cameras{suffix}", folder / f"images{suffix}") for suffix in (".bin", ".txt")}
    present = [suffix for suffix, files in forms.items() if all(file.is_file() for file in files)]
    if not present:
        return None
    cameras, images = forms[present[0]]
    binary = present[0] == ".bin"
    with naming(cameras):
        by_id = _intrinsics_binary(cameras) if binary else _intrinsics_text(cameras)
    with naming(images):
        rig = _rig(cameras, by_id, _poses_binary(images) if binary else _poses_text(images))
    if len(present) > 1:
        note = "cameras.bin and images.bin are read; cameras.txt and images.txt in the same folder are not."
        rig = replace(rig, notes=(*rig.notes, note))
    return rig


def _rig(camera_path: Path, by_id: dict[int, _Lens], poses: list[_Pose]) -> Rig:
    if not poses:
        fix = "Run the reconstruction again."
        raise StudioError("camera_file.no_cameras", "the model has no registered images", fix=fix)
    poses = sorted(poses, key=lambda pose: pose[0])
    result = []
    for name, (image, key, numbers) in zip(camera_names([pose[0] for pose in poses]), poses, strict=True):
        if key not in by_id:
            problem = f"image '{image}' uses camera {key}, which is not in {camera_path.name}"
            fix = "Copy both files of the model again."
            raise StudioError("camera_file.unknown_camera", problem, value=key, fix=fix, camera=name)
        model, width, height, parameters = by_id[key]
        with naming(camera_path):
            lens = intrinsics(model, parameters)
        quat = np.array(numbers[:4])
        if not np.isfinite(quat).all() or np.linalg.norm(quat) < 1e-6:
            problem = f"image '{image}' has an invalid rotation quaternion {numbers[:4]}"
            fix = "Export the model again."
            raise StudioError("camera.rotation", problem, value=numbers[:4], fix=fix, camera=name)
        pose = np.column_stack([quats_to_matrices(quat), numbers[4:]])
        result.append(Camera(name, width, height, world_to_camera=pose, **lens))
    return Rig(tuple(result))


def _fields(number: int, line: str, kinds: str) -> list[float | int | str]:
    """Leading fields of a line by kind: i: int, f: float, s: word, r: rest of the line."""
    words = line.split()
    if len(words) < len(kinds):
        problem = f"line {number} has {len(words)} values, expected at least {len(kinds)}"
        fix = "The file may be truncated: copy it again."
        raise StudioError("camera_file.truncated", problem, value=len(words), fix=fix, line=number, expected=len(kinds))
    parsed: list[float | int | str] = []
    for index, kind in enumerate(kinds):
        try:
            if kind == "r":
                parsed.append(line.split(maxsplit=index)[index].strip())
            else:
                parsed.append({"i": int, "f": float, "s": str}[kind](words[index]))
        except ValueError:
            problem = f"line {number} has {words[index]!r}, expected a number"
            fix = "Export the model again."
            raise StudioError("camera_file.not_a_number", problem, value=words[index], fix=fix, line=number) from None
    return parsed


def _intrinsics_text(path: Path) -> dict[int, _Lens]:
    lenses = {}
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        key, model, width, height = _fields(number, line, "isii")
        words = line.split()[4:]
        parameters = _fields(number, " ".join(words), "f" * len(words))
        if int(key) in lenses:
            problem = f"line {number} is another camera {key}"
            fix = "Export the model again."
            raise StudioError("camera_file.camera_twice", problem, value=int(key), fix=fix, line=number)
        lenses[int(key)] = str(model), int(width), int(height), [float(p) for p in parameters]
    return lenses


def _poses_text(path: Path) -> list[_Pose]:
    """Two lines per image, as COLMAP reads them; the second lists its points (x, y, id) and may be empty."""
    poses = []
    lines = iter(enumerate(read_text(path).splitlines(), 1))
    for number, line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        fields = _fields(number, line, "ifffffffir")
        poses.append((str(fields[9]), int(fields[8]), [float(value) for value in fields[1:8]]))
        number, points = next(lines, (0, ""))
        if not _is_points(points):
            problem = f"line {number} is not a list of points (x, y, id) of the image in the line above"
            fix = "Put an empty line after the line of each image, also the last one."
            raise StudioError("camera_file.no_points_line", problem, value=points.split()[:12], fix=fix, line=number)
    return poses


def _is_points(line: str) -> bool:
    words = line.split()
    try:
        numbers = [float(word) for word in words]
        return len(numbers) % 3 == 0 and all(key == int(key) >= -1 for key in numbers[2::3])
    except (ValueError, OverflowError):
        return False


_MAX_BYTES = 4 << 30  # images.bin also has every feature of every image


class _Reader:
    """Little-endian values from a file that may be truncated."""

    def __init__(self, path: Path) -> None:
        try:
            self.data = read_bounded(path, _MAX_BYTES)
        except OSError as error:
            raise unreadable(path, error) from None
        self.at = 0

    def take(self, form: str) -> tuple[int | float, ...]:
        size = struct.calcsize("<" + form)
        self.skip(size)
        return struct.unpack_from("<" + form, self.data, self.at - size)

    def skip(self, size: int) -> None:
        if self.at + size > len(self.data):
            problem = f"the file is truncated: {len(self.data)} bytes, expected at least {self.at + size}"
            fix = "Copy it again."
            raise StudioError("camera_file.truncated", problem, value=len(self.data), fix=fix, expected=self.at + size)
        self.at += size

    def word(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            problem = "the file is truncated in an image name"
            fix = "Copy it again."
            raise StudioError("camera_file.truncated", problem, value=len(self.data), fix=fix)
        start, self.at = self.at, end + 1
        return self.data[start:end].decode("utf-8", "replace")


def _intrinsics_binary(path: Path) -> dict[int, _Lens]:
    reader, lenses = _Reader(path), {}
    by_id = {model_id: (name, count) for name, (model_id, count) in MODELS.items()}
    for _ in range(int(reader.take("Q")[0])):
        key, model, width, height = (int(value) for value in reader.take("iiQQ"))
        if model not in by_id:
            from pycolmap import CameraModelId

            names = {other.value: name for name, other in CameraModelId.__members__.items()}
            raise _unsupported_model(names.get(model, f"number {model}"))
        name, count = by_id[model]
        lenses[key] = name, width, height, [float(p) for p in reader.take(f"{count}d")]
    return lenses


def _poses_binary(path: Path) -> list[_Pose]:
    reader, poses = _Reader(path), []
    for _ in range(int(reader.take("Q")[0])):
        fields = reader.take("i7di")
        name = reader.word()
        reader.skip(24 * int(reader.take("Q")[0]))  # x, y, point id
        poses.append((name, int(fields[8]), [float(value) for value in fields[1:8]]))
    return poses


def write(rig: Rig, path: Path) -> None:
    """Write a folder with a text model without points: cameras.txt, images.txt, points3D.txt."""
    cameras = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    images = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    for key, camera in enumerate(rig, 1):
        model, parameters = camera_model(camera)
        cameras.append(" ".join([str(key), model, str(camera.width), str(camera.height), *map(repr, parameters)]))
        pose = [*matrices_to_quats(camera.rotation).tolist(), *camera.translation.tolist()]
        images += [" ".join([str(key), *map(repr, pose), str(key), f"{camera.name}.png"]), ""]
    files = {"cameras.txt": cameras, "images.txt": images, "points3D.txt": ["# no points"]}
    for name, lines in files.items():
        write_atomic(path / name, ("\n".join(lines) + "\n").encode())
