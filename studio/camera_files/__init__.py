"""Camera files: `read_rig` reads all supported formats, `write_rig` writes some.

`CAMERA_FORMATS` lists them. Reading, writing, the search for camera files beside footage, error texts and the
documentation read that table; the module of a format is only imported when a file may be of that format.

A module has `read(file: CameraFile) -> Rig`, and as far as its entry needs them, `matches(file: CameraFile) -> bool`,
`write(rig, path)` and `is_in(folder) -> bool`. Errors name the file; readers of several files name the one that is
wrong.
"""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.nearby import sizes_of_capture
from v3studio.studio.cameras import Rig
from v3studio.studio.counts import cameras_listed
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.validation import camera_error

__all__ = ["CAMERA_FORMATS", "CameraFormat", "find_camera_files", "read_rig", "write_rig"]

_TEXTS = frozenset({".csv", ".json", ".toml", ".txt", ".xml", ".yaml", ".yml"})
_MOST_BYTES = 4 << 20
_LEAST_FOCAL = 0.1  # of the longer side of the image: a field of view of 157 degrees


@dataclass(frozen=True)
class CameraFormat:
    """One format. Patterns of names are those of `fnmatch`."""

    name: str  # of the module in `studio.camera_files`
    title: str  # for error texts and the documentation; names of files are in backticks
    notes: str = ""  # for the documentation, in Markdown
    named: tuple[str, ...] = ()  # names that only this format has; of other files, `matches` looks at the content
    usual: tuple[str, ...] = ()  # names under which a file is found in the folder of a capture
    is_spare: bool = False  # whether it is found only in folders without others, which often have the same cameras
    is_folder: bool = False  # whether folders are in this format: those for which `is_in` is true
    per_camera: tuple[str, ...] = ()  # patterns under which files are found, of a format with one file per camera
    written: tuple[str, ...] = ()  # names that are written in this format; "": without an extension, a folder

    @property
    def module(self) -> Any:
        """The module that reads and writes it."""
        return importlib.import_module(f"v3studio.studio.camera_files.{self.name}")


CAMERA_FORMATS = (
    CameraFormat(
        "transforms_json", "`transforms.json` (instant-ngp, nerfstudio, NeuS2, VideoGS)",
        "one folder per frame, as in VideoGS, is accepted too; entries that differ only in time count as one camera; "
        "`transforms_train.json`, `_val` and `_test` are read together",
        usual=("transforms.json", "transforms_train.json"), written=("transforms*.json",),
    ),
    CameraFormat(
        "dynamic_gaussians", "`train_meta.json`, `test_meta.json` (Dynamic 3D Gaussians)",
        "both are read; cameras must not move",
        usual=("train_meta.json",),
    ),
    CameraFormat(
        "panoptic", "`calibration_*.json` (CMU Panoptic)", "OpenCV's pixel origin; centimeters become meters",
        usual=("calibration_*.json",),
    ),
    CameraFormat(
        "rig_json", "`rig.json`, `cameras.json` with K, R, t", "V3 Studio's own is `rig.json`",
        usual=("rig.json", "cameras.json"), written=("*.json",),
    ),
    CameraFormat(
        "cameras_3dgs", "`cameras.json` (3DGS)", "a list; without principal points and distortion",
        usual=("cameras.json",),
    ),
    CameraFormat(
        "multical", "`calibration.json` (multical)", "OpenCV's pixel origin",
        usual=("calibration.json",),
    ),
    CameraFormat(
        "thuman", "`calibration.json` (THuman4.0), `calibration_full.json` (AvatarReX)",
        "image sizes are taken from the footage if the file has none",
        usual=("calibration.json", "calibration_full.json"),
    ),
    CameraFormat(
        "colmap_model", "a COLMAP model folder, text or binary",
        "written as text; of `sparse/0`, `sparse/1`, ..., the model with the most images is read; in `images.txt`, "
        "every image has a second line, which may be empty",
        named=("cameras.bin", "cameras.txt", "images.bin", "images.txt", "points3D.bin", "points3D.txt"),
        is_folder=True, written=("",),
    ),
    CameraFormat(
        "easymocap", "`intri.yml`, `extri.yml` (EasyMocap, EasyVolcap)",
        "OpenCV's pixel origin; image sizes are taken from the footage if the file has none",
        named=("intri.yml", "extri.yml"), usual=("intri.yml",), written=("intri.yml", "extri.yml"),
    ),
    CameraFormat(
        "actorshq", "`calibration.csv` (ActorsHQ)", "no distortion",
        usual=("calibration.csv",), written=("*.csv",),
    ),
    CameraFormat(
        "realityscan", "the CSV \"Internal/External camera parameters\" of RealityScan, such as `calibration.csv`",
        "image sizes are taken from the images next to it; rows without an image are left out; tangential terms must "
        "be 0; semicolons and decimal commas are accepted",
        usual=("calibration.csv",),
    ),
    CameraFormat(
        "toml_rigs", "`Calib*.toml` (Pose2Sim), `calibration.toml` (Anipose), `*_camera_calibration.toml` "
        "(FreeMoCap), `camera_array.toml` (Caliscope)", "OpenCV's pixel origin",
        named=("*.toml",), written=("*.toml",),
        usual=("camera_array.toml", "Calib*.toml", "calibration.toml", "*_camera_calibration.toml"),
    ),
    CameraFormat(
        "metashape", "Metashape XML, such as `cameras.xml`",
        "a lens with k4 is converted to OpenCV's rational model (within 0.25 px); p3 and p4 are not "
        "supported; slave cameras are placed from their masters",
        usual=("cameras.xml",),
    ),
    CameraFormat(
        "rerf", "`CamPose.inf`, `Intrinsic.inf` (ReRF, NHR)",
        "image sizes are taken from the footage next to them",
        named=("CamPose.inf", "Intrinsic.inf"), usual=("CamPose.inf",),
    ),
    CameraFormat(
        "mc_calib", "`calibrated_cameras_data.yml` (MC-Calib)",
        "OpenCV's pixel origin; the largest of MC-Calib's groups is read",
        usual=("calibrated_cameras_data.yml",),
    ),
    CameraFormat(
        "opencv_cameras", "OpenCV's XML or YAML, one file per camera",
        "`capture.rig: '{camera}/config.xml'`; camera matrix, distortion, rotation and translation under their usual "
        "names",
        per_camera=tuple(
            f"{stem}.{extension}"
            for stem in (
                *(
                    f"{folder}{{camera}}/{name}"
                    for folder in ("", "calibration/") for name in ("config", "calibration", "camera", "{camera}")
                ),
                "calibration/{camera}", "cameras/{camera}",
            )
            for extension in ("xml", "yml", "yaml")
        ),
    ),
    CameraFormat(
        "kalibr", "`camchain.yaml` (Kalibr)", "OpenCV's pixel origin; pinhole-equi and pinhole-radtan",
        named=("*camchain*.yaml",), usual=("*camchain*.yaml",),
    ),
    CameraFormat("qualisys", "Qualisys `.qca.txt`", usual=("*.qca.txt",)),
    CameraFormat(
        "annots_npy", "`annots.npy` (ZJU-MoCap)", "millimeters become meters; used if there is no other calibration",
        named=("annots.npy",), usual=("annots.npy",), is_spare=True,
    ),
    CameraFormat(
        "poses_bounds", "`poses_bounds.npy` (LLFF, N3DV)",
        "cameras are named after the videos, in their order; used if there is no other calibration",
        named=("*.npy",), usual=("poses_bounds.npy",), is_spare=True,
    ),
    CameraFormat(
        "mvsnet", "a folder of `NAME_cam.txt` (MVSNet, PKU-DyMVHumans)", "image sizes are taken from the footage",
        is_folder=True,
    ),
)  # fmt: skip
"""All formats, in the order in which they are tried and listed."""


def find_camera_files(folder: Path) -> list[Path]:
    """Camera files with usual names in a folder, or the folder itself if it contains a COLMAP model or MVSNet's files;
    if there are none, the camera file of the first frame's folder of VideoGS, whose frames have the same cameras, or
    files of any name with several cameras."""
    paths = _with_usual_names(folder, is_spare=False)
    if any(form.is_folder and form.module.is_in(folder) for form in CAMERA_FORMATS):
        paths.append(folder)
    if not paths:
        paths = _with_usual_names(folder, is_spare=True)[:1]
    if not paths:
        frames = [path for path in folder.glob("*/transforms.json") if path.parent.name.isdecimal()]
        paths = sorted(frames, key=lambda path: int(path.parent.name))[:1]
    return paths or [path for path in sorted(folder.iterdir()) if _has_cameras(path)]


def _has_cameras(path: Path) -> bool:
    """Return whether a file has several cameras, also if one of them is invalid."""
    if path.suffix.lower() not in _TEXTS or not path.is_file() or path.stat().st_size > _MOST_BYTES:
        return False
    try:
        return len(read_rig(path)) > 1
    except StudioError as error:
        return error.code.startswith("camera.")


def _with_usual_names(folder: Path, is_spare: bool) -> list[Path]:
    patterns = [pattern for form in CAMERA_FORMATS if form.is_spare == is_spare for pattern in form.usual]
    paths = [path for pattern in patterns for path in sorted(folder.glob(pattern)) if path.is_file()]
    return list(dict.fromkeys(paths))


def read_rig(path: Path | str, sizes: Mapping[str, tuple[int, int]] | None = None) -> Rig:
    """Read cameras; the format is detected from the file's name and content.

    Example:
        >>> rig = v3.read_rig("footage/cameras.json")
        >>> rig.names[:2], rig["cam0"].width, rig.centers.shape
        (('cam0', 'cam1'), 64, (6, 3))

    Args:
        path: a file in a format of docs/reference/files.md; a folder with exactly one of these, with a COLMAP model,
            with *_cam.txt (MVSNet), or with one folder per frame (VideoGS); or a pattern with {camera} of OpenCV's XML
            or YAML files, one per camera.
        sizes: width and height in pixels of the footage's cameras, by name, for files that have none and are not next
            to the footage.

    Returns:
        the rig, in the conventions of `studio.cameras` (OpenCV axes, pixel origin at the image corner); its notes say
        what was assumed and what was left out.

    Raises:
        StudioError: the file is missing, of an unknown format, truncated or otherwise unusable (camera_file.*), or one
            of its cameras is invalid (camera.*). The error contains the file.
    """
    path = Path(path)
    with naming(path), sizes_of_capture(sizes or {}):
        if "{camera}" not in str(path) and not path.exists():
            raise StudioError("camera_file.missing", "camera file not found", fix="Check the path.")
        file = CameraFile(path)
        form = _format_of(file)
        if form is None and path.is_dir():
            chosen = _only_file_in(path)
            if chosen != path:
                return read_rig(chosen, sizes)
            form = next(form for form in CAMERA_FORMATS if form.name == "colmap_model")
        if form is None:
            raise _unknown_format(file)
        return _checked(form.module.read(file))


def _format_of(file: CameraFile) -> CameraFormat | None:
    """The format of a file, or of a folder that has one itself."""
    if "{camera}" in str(file.path):
        return next(form for form in CAMERA_FORMATS if form.per_camera)
    name = file.path.stem + file.path.suffix.lower()
    for form in CAMERA_FORMATS:
        if any(fnmatchcase(name, pattern) for pattern in form.named) and not file.path.is_dir():
            return form
    return next((form for form in CAMERA_FORMATS if not form.named and form.module.matches(file)), None)


def _checked(rig: Rig) -> Rig:
    """The rig, with a note on principal points that are unlikely. Raises StudioError: camera.focal_length_unit."""
    for camera in rig:
        focal, longer = min(camera.fx, camera.fy), max(camera.width, camera.height)
        if focal < _LEAST_FOCAL * longer:
            problem = f"a focal length of {focal:.4g} pixels is too short for images of {camera.width}x{camera.height}"
            fix = "Give focal lengths and principal points in pixels, not in millimeters or relative to the size."
            raise camera_error("camera.focal_length_unit", camera.name, problem, value=focal, fix=fix)
    outside = [
        camera.name for camera in rig if not (0 <= camera.cx <= camera.width and 0 <= camera.cy <= camera.height)
    ]
    if not outside:
        return rig
    note = (
        "The principal point is outside of the image, as if the images had another size when they were calibrated: "
        f"{cameras_listed(outside)}."
    )
    return replace(rig, notes=(*rig.notes, note))


def _unknown_format(file: CameraFile) -> StudioError:
    problem = "not a camera file of a supported format"
    if file.kind == "json":
        keys = ", ".join(f"'{key}'" for key in list(file.json)[:20]) if isinstance(file.json, dict) else "a list"
        problem = f"the JSON has no cameras under a known key ({keys or 'empty'})"
    elif file.kind == "xml" and file.xml is not None:
        problem = f"the XML has no cameras of a supported program (its root is <{file.xml.tag}>)"
    titles = ", ".join(form.title.replace("`", "") for form in CAMERA_FORMATS)
    return StudioError("camera_file.unknown_format", problem, fix=f"Supported are {titles}.")


def _only_file_in(folder: Path) -> Path:
    """The only camera file in a folder; the folder itself if it has none, or a COLMAP model only."""
    files = find_camera_files(folder)
    if len(files) > 1:
        names = [path.name for path in files]
        problem = f"several camera files in the folder: {', '.join(names)}"
        raise StudioError("camera_file.ambiguous", problem, value=names, fix="Specify one of them.")
    return files[0] if files else folder


def write_rig(rig: Rig, path: Path | str) -> None:
    """Write cameras, atomically, in the first format of docs/reference/files.md that is written under such a name:
    `rig.json`, `transforms.json`, `calibration.csv`, `Calib.toml` or `intri.yml`, for example; without an extension, a
    folder with a COLMAP model.

    Raises:
        StudioError: the extension is unknown (camera_file.unknown_extension), the format cannot express a camera
            (camera_file.not_expressible), or the file cannot be written (camera_file.unwritable).
    """
    path = Path(path)
    name = path.name.lstrip(".") if path.suffix else ""
    forms = [form for form in CAMERA_FORMATS if any(fnmatchcase(name, pattern) for pattern in form.written)]
    if not forms and path.is_dir():
        forms = [form for form in CAMERA_FORMATS if "" in form.written]
    with naming(path):
        if not forms:
            problem = f"cameras cannot be written as '{path.suffix}'"
            names = dict.fromkeys(name for form in CAMERA_FORMATS for name in form.written if name)
            fix = f"Use {', '.join(names)}, or a folder for a COLMAP model."
            raise StudioError("camera_file.unknown_extension", problem, value=path.suffix, fix=fix)
        forms[0].module.write(rig, path)
