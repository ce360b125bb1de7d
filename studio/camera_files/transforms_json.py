"""transforms.json of instant-ngp, nerfstudio, NeuS2 and VideoGS, and pairs of transforms_train.json and _test.json.

Each of the `frames[]` has a `file_path` and a `transform_matrix`, camera to world with OpenGL axes (x right, y up, z
back); with `"from_na": true` (NeuS2), the axes are OpenCV's. Intrinsics are at the top level or in each frame: `fl_x`,
`fl_y` or `camera_angle_x`, `camera_angle_y`, or a matrix `intrinsic_matrix` or `K`; `cx`, `cy`, `w`, `h`; distortion
`k1 k2 p1 p2 k3` of OpenCV's model, for FULL_OPENCV also `k4 k5 k6`, or nerfstudio's `distortion_params`. The pixel
origin is the image corner, as in COLMAP, since these files are usually converted from COLMAP models.

Files for scenes with motion have an entry per camera and time; entries with equal cameras are one camera, named after
what their paths have in common.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from studio.camera_files.common import (
    camera_names,
    check_pose,
    fisheye,
    matrix,
    no_cameras,
    read_json,
    rigid_inverse,
    write_atomic,
    wrong_shape,
)
from studio.camera_files.keyed import TERMS, Found, agreeing, check_model
from studio.cameras import OPENGL_AXES, Camera, Rig
from studio.capture.images import image_header
from studio.capture.patterns import without_extension
from studio.counts import listed
from studio.errors import StudioError, naming
from studio.json_types import JsonObject
from studio.validation import array, camera_error, missing_key, number

_SUFFIXES = ("", ".png", ".jpg", ".jpeg", ".webp", ".exr")
_SPLIT = re.compile(r"transforms_(train|val|test)\.json")
_KNOWN = frozenset({
    "fl_x", "fl_y", "cx", "cy", "w", "h", "width", "height", "camera_angle_x", "camera_angle_y", "intrinsic_matrix",
    "K", "camera_model", "is_fisheye", "distortion_params", "transform_matrix", "file_path", "from_na",
}) | set(TERMS)  # fmt: skip
_SAME = (  # keys of the same value: one in an entry replaces all of them beside `frames`
    {"fl_x", "fl_y", "camera_angle_x", "camera_angle_y"},
    {"intrinsic_matrix", "K"},
    {"w", "width"},
    {"h", "height"},
    {"distortion_params", *TERMS},
)
_HARMLESS = frozenset({
    "frames", "aabb_scale", "aabb", "scale", "offset", "n_frames", "applied_transform", "applied_scale",
    "orientation_override", "up", "ply_file_path", "colmap_im_id", "sharpness", "time", "mask_path",
    "depth_file_path", "depth_path", "normal_path", "semantic_path", "alpha_path", "camera_id", "cam_id",
    "frame_id", "image_id", "timestamp", "rotation", "near", "far", "bounds", "train_filenames", "val_filenames",
    "test_filenames", "integer_depth_scale", "enable_depth_loading", "depth_unit_scale_factor", "render_aabb",
    "white_transparent", "black_transparent", "n_extra_learnable_dims", "sharpen", "envmap", "registration_matrix",
    "camera_label", "semantics", "panoptic_classes", "trajectory",
})  # fmt: skip
"""Keys that do not change how a camera projects; `rotation` is the step between views of Blender's synthetic scenes."""


_Given = list[tuple[str, float]]  # keys and the value that each gives


def _image_size(path: Path, file: str) -> tuple[int, int] | None:
    """Width and height of an image next to the JSON file; None if it is missing or unreadable."""
    for suffix in _SUFFIXES:
        candidate = path.parent / (file + suffix)
        if candidate.is_file():
            try:
                return image_header(candidate)[:2]
            except StudioError as error:
                if error.code.startswith("storage."):
                    raise
                return None
    return None


def _size(values: JsonObject, path: Path, file: str, camera: str) -> tuple[int, int]:
    sides = []
    for keys in (("w", "width"), ("h", "height")):
        given = [(key, np.array([number(values, key, camera)])) for key in keys if values.get(key) is not None]
        if given:
            sides.append(round(float(agreeing(camera, given)[0])))
    if len(sides) == 2:
        return sides[0], sides[1]
    found = _image_size(path, file)
    if found is None:
        problem = f"the file does not contain 'w' and 'h', and there is no image '{file}' next to it"
        fix = "Add 'w' and 'h', or put the images next to the file."
        raise camera_error("camera.size_unknown", camera, problem, value=file, fix=fix)
    return found


def _intrinsics(values: JsonObject, width: int, height: int, camera: str) -> np.ndarray:
    """K (3, 3). Values under several keys must agree."""
    fx = _focal(values, "fl_x", "camera_angle_x", width, camera)
    fy = _focal(values, "fl_y", "camera_angle_y", height, camera)
    cx: _Given = [("cx", number(values, "cx", camera))] if "cx" in values else []
    cy: _Given = [("cy", number(values, "cy", camera))] if "cy" in values else []
    K = None
    for key in ("intrinsic_matrix", "K"):
        if key in values:
            rows = values[key]
            columns = len(rows[0]) if isinstance(rows, list) and rows and isinstance(rows[0], list) else 3
            K = matrix(rows, (3, 4), 4 if columns == 4 else 3, key, camera)[:3, :3]
            for value, given in ((K[0, 0], fx), (K[1, 1], fy), (K[0, 2], cx), (K[1, 2], cy)):
                given.append((key, float(value)))
    if not fx:
        raise missing_key("fl_x", camera)
    wanted = (fx, fy or fx, cx or [("w", width / 2)], cy or [("h", height / 2)])
    x, y, u, v = (float(agreeing(camera, [(key, np.array([value])) for key, value in given])[0]) for given in wanted)
    return np.array([[x, 0, u], [0, y, v], [0, 0, 1]]) if K is None else K


def _focal(values: JsonObject, key: str, angle: str, side: int, camera: str) -> _Given:
    found = [(key, number(values, key, camera))] if key in values else []
    if angle in values:
        radians = number(values, angle, camera)
        if not 0 < radians < np.pi:
            problem = f"'{angle}' is {radians:g}, expected a value between 0 and pi"
            fix = "Correct it in the camera file; angles are in radians."
            raise camera_error("camera.field_of_view", camera, problem, value=radians, fix=fix, key=angle)
        found.append((angle, 0.5 * side / float(np.tan(0.5 * radians))))
    return found


def _distortion(values: JsonObject, camera: str, found: Found) -> np.ndarray:
    model = str(values.get("camera_model", "OPENCV"))
    check_model(camera, "camera_model", model)
    if values.get("is_fisheye"):
        raise fisheye(camera)
    terms = np.array([number(values, key, camera, 0.0) for key in TERMS])
    bent = any(key in values for key in TERMS)
    if "distortion_params" in values:  # nerfstudio: k1 k2 k3 k4 p1 p2
        given = array(values["distortion_params"], "distortion_params", camera)
        if given.shape != (6,):
            raise wrong_shape("distortion_params", camera, given.shape, ((6,),))
        k1, k2, k3, k4, p1, p2 = given
        given = np.array([k1, k2, p1, p2, k3, k4, 0.0, 0.0])
        first = next((key for key in TERMS if key in values), "")
        terms = agreeing(camera, [("distortion_params", given), *([(first, terms)] if first else [])])
        bent = True
    if terms[5:].any() and model.upper() != "FULL_OPENCV":  # k4 is a fisheye lens's in instant-ngp
        raise fisheye(camera)
    (found.bent if bent else found.straight).append(camera)
    missing = "" if bent else "lens distortion"
    found.check_unknown(camera, {key: values[key] for key in values.keys() - _KNOWN - _HARMLESS}, missing)
    count = 8 if terms[5:].any() else 5 if terms[4] else 4
    return terms[:count] if terms.any() else np.zeros(0)


def rig_from_transforms(path: Path, values: JsonObject) -> Rig:
    """A rig from the JSON object in the file, and in the other parts of a split into training and test views."""
    files = {path: values}
    if _SPLIT.fullmatch(path.name):
        others = (path.parent / f"transforms_{part}.json" for part in ("train", "val", "test"))
        files = {other: values if other == path else read_json(other) for other in others if other.is_file()}
    entries = [entry for file, content in files.items() for entry in _entries(file, content)]
    names = camera_names([file_path for _, file_path, _ in entries])
    found = Found()
    groups: dict[bytes, list[int]] = {}
    cameras = []
    for index, (name, (file, file_path, both)) in enumerate(zip(names, entries, strict=True)):
        with naming(file):
            cameras.append(_camera(name, file, file_path, both, found))
        groups.setdefault(_fingerprint(cameras[-1]), []).append(index)
    notes = []
    if 1 < len(groups) < len(cameras):
        notes.append(f"The camera file has {len(cameras)} entries for {len(groups)} cameras.")
        paths = [[without_extension(entries[index][1]) for index in group] for group in groups.values()]
        for name, group in zip(_common_names(paths), groups.values(), strict=True):
            for index in group:
                names[index] = name
        first = [group[0] for group in groups.values()]
        cameras = [replace(cameras[index], name=names[index]) for index in first]
    training = {name for name, (file, *_) in zip(names, entries, strict=True) if file.name == "transforms_train.json"}
    tested = tuple(camera.name for camera in cameras if training and camera.name not in training)
    return Rig(tuple(cameras), (*found.notes, *_overridden(files), *notes), for_evaluation=tested)


def _entries(path: Path, values: JsonObject) -> list[tuple[Path, str, JsonObject]]:
    """File, path of the image and values of each entry."""
    with naming(path):
        frames = values.get("frames")
        if not isinstance(frames, list) or not frames:
            raise no_cameras("the list 'frames' is missing or empty")
        for index, frame in enumerate(frames):
            if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
                raise missing_key("file_path", f"number {index}")
    return [(path, frame["file_path"], {**_not_in(frame, values), **frame}) for frame in frames]


def _not_in(frame: JsonObject, values: JsonObject) -> JsonObject:
    """The values beside `frames` for which an entry has none of its own, under no key."""
    replaced = [key for same in _SAME if frame.keys() & same for key in same]
    return {key: value for key, value in values.items() if key not in replaced}


def _overridden(files: Mapping[Path, JsonObject]) -> tuple[str, ...]:
    """Notes on values beside `frames` that differ from those of the entries: nerfstudio would use the former."""
    keys = {
        key
        for values in files.values()
        for frame in values["frames"]
        for key in _KNOWN & frame.keys() & values.keys()
        if frame[key] != values[key]
    }
    return (f"Entries have their own {listed(sorted(map(repr, keys)))}; those beside 'frames' differ.",) if keys else ()


def _camera(name: str, path: Path, file_path: str, values: JsonObject, found: Found) -> Camera:
    if "transform_matrix" not in values:
        raise missing_key("transform_matrix", name)
    pose = matrix(values["transform_matrix"], (3, 4), 4, "transform_matrix", name)
    check_pose(pose, "transform_matrix", name)
    if not values.get("from_na"):
        pose = pose @ OPENGL_AXES
    width, height = _size(values, path, file_path, name)
    K = _intrinsics(values, width, height, name)
    return Camera(name, width, height, K, rigid_inverse(pose), _distortion(values, name, found))


def _fingerprint(camera: Camera) -> bytes:
    """Equal for entries of the same camera."""
    parts = (camera.world_to_camera.ravel(), camera.K.ravel(), camera.distortion)
    return bytes(np.round(np.concatenate(parts), 6) + 0.0)


_TRAILING = re.compile(r"[_.\- ]*(frame|f|t)?[_.\- ]*\d+$", re.IGNORECASE)
_LEADING = re.compile(r"^(frame|f|t)?[_.\- ]*\d+[_.\- ]+", re.IGNORECASE)


def _common_names(groups: Sequence[Sequence[str]]) -> list[str]:
    """The name that all paths of a group share and no other group has: that of the file, of one of its folders, or the
    file's name without a number at its end or beginning."""

    def part(level: int) -> Callable[[str], str]:
        return lambda path: PurePosixPath(path).parts[-1 - level] if level < len(PurePosixPath(path).parts) else ""

    ways = [
        part(0),
        lambda path: _TRAILING.sub("", PurePosixPath(path).name),
        lambda path: _LEADING.sub("", PurePosixPath(path).name),
        *(part(level) for level in (1, 2, 3)),
    ]
    for way in ways:
        names = [{way(path) for path in group} for group in groups]
        if all(len(own) == 1 and "" not in own for own in names) and len(set().union(*names)) == len(groups):
            return [own.pop() for own in names]
    group = next(group for group in groups if len(group) > 1)
    problem = (
        f"'{group[0]}' and '{group[1]}' have the same camera, but no file or folder name in common that no other "
        "camera has; cameras must not move"
    )
    fix = "Use footage of fixed cameras, with the name of the camera in the path."
    raise StudioError("camera_file.no_common_name", problem, value=list(group[:2]), fix=fix)


def write_transforms(rig: Rig, path: Path) -> None:
    """Write transforms.json atomically, with intrinsics per camera and at most the distortion k1 k2 p1 p2 k3."""
    frames = []
    for camera in rig:
        if np.any(camera.distortion[5:]):
            raise camera_error(
                "camera_file.not_expressible",
                camera.name,
                f"transforms.json only supports the distortion terms k1 k2 p1 p2 k3, but "
                f"this camera has {camera.distortion.size} terms",
                value=camera.distortion.size,
                fix="Undistort the images first, or write rig.json.",
            )
        if abs(camera.K[0, 1]) > 1e-9:
            problem = f"transforms.json cannot express skew ({camera.K[0, 1]:g})"
            fix = "Calibrate without skew, or write rig.json."
            raise camera_error(
                "camera_file.not_expressible", camera.name, problem, value=float(camera.K[0, 1]), fix=fix
            )
        distortion = dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion[:5].tolist(), strict=False))
        frames.append(
            {
                "file_path": f"images/{camera.name}.png",
                "w": camera.width,
                "h": camera.height,
                "fl_x": camera.fx,
                "fl_y": camera.fy,
                "cx": camera.cx,
                "cy": camera.cy,
                **distortion,
                "transform_matrix": (rigid_inverse(camera.world_to_camera) @ OPENGL_AXES).tolist(),
            }
        )
    write_atomic(path, (json.dumps({"camera_model": "OPENCV", "frames": frames}, indent=1) + "\n").encode())
