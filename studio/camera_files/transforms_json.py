"""transforms.json of instant-ngp, nerfstudio, NeuS2 and VideoGS, and pairs of transforms_train.json and _test.json.

Each of the `frames[]` has a `file_path` and a `transform_matrix`, camera to world with OpenGL axes (x right, y up, z
back); with `"from_na": true` (NeuS2), the axes are OpenCV's. Intrinsics are at the top level or in each frame: `fl_x`,
`fl_y` or `camera_angle_x`, `camera_angle_y`, or a matrix `intrinsic_matrix` or `K`; `cx`, `cy`, `w`, `h`; distortion
`k1 k2 p1 p2 k3` of OpenCV's model, for FULL_OPENCV also `k4 k5 k6`, or nerfstudio's `distortion_params`; `k1 k2 k3 k4`
with `camera_model` OPENCV_FISHEYE or `is_fisheye`, for THIN_PRISM_FISHEYE also `p1 p2 sx1 sy1`. The pixel origin is the
image corner, as in COLMAP, since these files are usually converted from COLMAP models.

Files for scenes with motion have an entry per camera and time; entries with equal cameras are one camera, named after
what their paths have in common.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from v3studio.studio.camera_files.common import (
    camera_names,
    check_expressible,
    no_cameras,
    read_json,
    rigid_inverse,
    write_atomic,
    wrong_shape,
)
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import (
    FISHEYE_MODELS,
    TERMS,
    FileNotes,
    KeyedForm,
    keyed_camera,
    normal_key,
)
from v3studio.studio.camera_files.common.nearby import size_nearby
from v3studio.studio.cameras import OPENGL_AXES, Camera, Rig
from v3studio.studio.capture.patterns import camera_in, without_extension
from v3studio.studio.counts import listed
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.json_types import JsonObject
from v3studio.studio.validation import array, camera_error, missing_key

_SPLIT = re.compile(r"transforms_(train|val|test)\.json")
_SAME = (  # keys of the same value: one in an entry replaces all of them beside `frames`
    {"fl_x", "fl_y", "camera_angle_x", "camera_angle_y"},
    {"intrinsic_matrix", "K"},
    {"w", "width"},
    {"h", "height"},
    {"distortion_params", "sx1", "sy1", *TERMS},
)
_HARMLESS = frozenset({
    "file_path", "from_na", "aabb_scale", "aabb", "scale", "offset", "applied_transform", "applied_scale",
    "orientation_override", "up", "ply_file_path", "colmap_im_id", "sharpness", "mask_path", "depth_file_path",
    "depth_path", "normal_path", "semantic_path", "alpha_path", "frame_id", "image_id", "timestamp", "train_filenames",
    "val_filenames", "test_filenames", "integer_depth_scale", "enable_depth_loading", "depth_unit_scale_factor",
    "render_aabb", "white_transparent", "black_transparent", "n_extra_learnable_dims", "sharpen", "envmap",
    "registration_matrix", "camera_label", "semantics", "panoptic_classes", "trajectory",
})  # fmt: skip
"""Keys that do not change how a camera projects, in addition to `HARMLESS` keys of all files."""
_SPELLINGS = {"transformmatrix": "cameratoworld", "distortionparams": "distortion"}


def matches(file: CameraFile) -> bool:
    """Return whether a file has this form."""
    content = file.json_object
    return isinstance(content.get("frames"), list) and "cameras" not in content


def read(file: CameraFile) -> Rig:
    """Read the cameras, also those in the other parts of a split into training and test views."""
    path, parsed = file.path, file.json_object
    files = {path: parsed}
    if _SPLIT.fullmatch(path.name):
        others = (path.parent / f"transforms_{part}.json" for part in ("train", "val", "test"))
        files = {other: parsed if other == path else read_json(other) for other in others if other.is_file()}
    entries = [entry for part, content in files.items() for entry in _entries(part, content)]
    names = camera_names([file_path for _, file_path, _ in entries])
    seen = FileNotes()
    groups: dict[bytes, list[int]] = {}
    cameras = []
    for index, (name, (part, file_path, both)) in enumerate(zip(names, entries, strict=True)):
        with naming(part):
            cameras.append(_camera(name, part, file_path, both, seen))
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
    training = {name for name, (part, *_) in zip(names, entries, strict=True) if part.name == "transforms_train.json"}
    tested = tuple(camera.name for camera in cameras if training and camera.name not in training)
    return Rig(tuple(cameras), (*seen.sentences, *_overridden(files), *notes), for_evaluation=tested)


def _entries(path: Path, content: JsonObject) -> list[tuple[Path, str, JsonObject]]:
    """File, path of the image and values of each entry."""
    with naming(path):
        frames = content.get("frames")
        if not isinstance(frames, list) or not frames:
            raise no_cameras("the list 'frames' is missing or empty")
        for index, frame in enumerate(frames):
            if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
                raise missing_key("file_path", f"number {index}")
    return [(path, frame["file_path"], {**_not_in(frame, content), **frame}) for frame in frames]


def _not_in(frame: JsonObject, content: JsonObject) -> JsonObject:
    """The values beside `frames` for which an entry has none of its own, under no key."""
    replaced = [key for same in _SAME if frame.keys() & same for key in same]
    return {key: value for key, value in content.items() if key not in replaced}


def _overridden(files: Mapping[Path, JsonObject]) -> tuple[str, ...]:
    """Notes on values beside `frames` that differ from those of the entries: nerfstudio would use the former."""
    keys = {
        key
        for content in files.values()
        for frame in content["frames"]
        for key in (frame.keys() & content.keys()) - _HARMLESS
        if frame[key] != content[key]
    }
    return (f"Entries have their own {listed(sorted(map(repr, keys)))}; those beside 'frames' differ.",) if keys else ()


def _camera(name: str, path: Path, file_path: str, entry: JsonObject, seen: FileNotes) -> Camera:
    form = KeyedForm(
        corner=True,
        centered=True,
        harmless=_HARMLESS,
        spelling=lambda key, camera: _SPELLINGS.get(normal_key(key), normal_key(key)),
        size_of=lambda camera: size_nearby(path.parent, file_path, camera),
    )
    known = {key: value for key, value in entry.items() if key != "rotation"}  # between views of Blender's scenes
    if "distortion_params" in entry:  # nerfstudio: k1 k2 k3 k4 p1 p2
        terms = array(entry["distortion_params"], "distortion_params", name)
        if terms.shape != (6,):
            raise wrong_shape("distortion_params", name, terms.shape, ((6,),))
        if not entry.get("is_fisheye") and normal_key(str(entry.get("camera_model"))) not in FISHEYE_MODELS:
            known["distortion_params"] = [*terms[[0, 1, 4, 5, 2]], *([terms[3], 0, 0] if terms[3] else [])]
    camera = keyed_camera(path.parent, name, known, form, seen)
    if camera is None:
        raise missing_key("transform_matrix", name)
    is_told = camera.fisheye or str(entry.get("camera_model")).upper() == "FULL_OPENCV"
    if camera.distortion[5:].any() and not is_told:
        problem, fix = "k4 may be that of a fisheye lens", "Set camera_model to OPENCV_FISHEYE or FULL_OPENCV."
        raise camera_error("camera.lens_model", name, problem, value=entry.get("camera_model"), fix=fix, key="k4")
    if entry.get("from_na"):
        return camera
    return replace(camera, world_to_camera=OPENGL_AXES @ camera.world_to_camera)


def _fingerprint(camera: Camera) -> bytes:
    """Equal for entries of the same camera."""
    parts = (camera.world_to_camera.ravel(), camera.K.ravel(), camera.distortion)
    return bytes(np.round(np.concatenate(parts), 6) + 0.0)


def _common_names(groups: Sequence[Sequence[str]]) -> list[str]:
    """The name, for each group of paths, that all of them share and no other group has: the file's name, the name of
    one of its folders, or the file's name without a number at its end or beginning."""

    for way in range(len(camera_in("-"))):
        names = [{camera_in(path)[way] for path in group} for group in groups]
        if all(len(own) == 1 and "" not in own for own in names) and len(set().union(*names)) == len(groups):
            return [own.pop() for own in names]
    group = next(group for group in groups if len(group) > 1)
    problem = (
        f"'{group[0]}' and '{group[1]}' have the same camera, but no file or folder name in common that no other "
        "camera has; cameras must not move"
    )
    fix = "Use footage of fixed cameras, with the name of the camera in the path."
    raise StudioError("camera_file.no_common_name", problem, value=list(group[:2]), fix=fix)


def write(rig: Rig, path: Path) -> None:
    """Write transforms.json atomically, with intrinsics per camera and at most the distortion k1 k2 p1 p2 k3, or k1 to
    k4 of fisheye lenses, which nerfstudio needs all cameras to have."""
    frames = []
    fisheye = all(camera.fisheye for camera in rig)
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    for camera in rig:
        check_expressible(camera, "transforms.json", len(names), fisheye)
        distortion = dict(zip(names, camera.distortion[: len(names)].tolist(), strict=False))
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
    model = "OPENCV_FISHEYE" if fisheye else "OPENCV"
    write_atomic(path, (json.dumps({"camera_model": model, "frames": frames}, indent=1) + "\n").encode())
