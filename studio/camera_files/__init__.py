"""Camera files: `read_rig` reads all supported formats, `write_rig` writes them.

Both name the file in errors; readers of several files name the one that is wrong.
"""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from v3studio.studio.camera_files import annots_npy, dynamic_gaussians, easymocap, mvsnet, poses_bounds, rerf
from v3studio.studio.camera_files.actorshq import COLUMNS as ACTORSHQ_COLUMNS
from v3studio.studio.camera_files.actorshq import read_actorshq, write_actorshq
from v3studio.studio.camera_files.colmap_model import numbered_models, read_colmap, write_colmap
from v3studio.studio.camera_files.common import read_json_value, read_text
from v3studio.studio.camera_files.json_rigs import rig_from_json
from v3studio.studio.camera_files.metashape import rig_from_metashape
from v3studio.studio.camera_files.opencv_storage import read_opencv_cameras, read_storage, rig_from_mc_calib
from v3studio.studio.camera_files.qualisys import rig_from_qualisys
from v3studio.studio.camera_files.realityscan import read_realityscan
from v3studio.studio.camera_files.rig_json import check_format, write_rig_json
from v3studio.studio.camera_files.toml_rigs import read_toml, write_toml
from v3studio.studio.camera_files.transforms_json import rig_from_transforms, write_transforms
from v3studio.studio.cameras import Rig
from v3studio.studio.counts import cameras_listed
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.validation import camera_error

__all__ = ["find_camera_files", "read_rig", "write_rig"]

_KNOWN = (
    "rig.json, cameras.json (K, R, t; 3DGS), transforms.json, a COLMAP model folder, intri.yml and extri.yml, "
    "calibration.csv (ActorsHQ, RealityScan), calibration.json (THuman4.0, multical, CMU Panoptic), train_meta.json "
    "(Dynamic 3D Gaussians), calibrated_cameras_data.yml (MC-Calib), *.toml (Pose2Sim, Caliscope), *.xml (Metashape), "
    "a Qualisys .qca.txt, CamPose.inf and Intrinsic.inf, poses_bounds.npy (N3DV), annots.npy (ZJU-MoCap), "
    "a folder of *_cam.txt (MVSNet), or OpenCV's XML or YAML with one file per camera, '{camera}/config.xml'"
)
_COLMAP_FILES = {f"{stem}.{suffix}" for stem in ("cameras", "images", "points3D") for suffix in ("bin", "txt")}
_USUAL_NAMES = (
    "rig.json", "cameras.json", "calibration.json", "calibration_full.json", "transforms.json",
    "transforms_train.json", "calibration.csv", "camera_array.toml", "cameras.xml", easymocap.INTRINSICS, rerf.POSES,
    dynamic_gaussians.TRAIN, "calibrated_cameras_data.yml",
)  # fmt: skip
_LESS_EXACT = (annots_npy.NAME, poses_bounds.NAME)  # often next to one of the above, with the same cameras
_USUAL_PATTERNS = ("*.qca.txt", "Calib*.toml", "calibration_*.json")
_LEAST_FOCAL = 0.1  # of the longer side of the image: a field of view of 157 degrees


def find_camera_files(folder: Path) -> list[Path]:
    """Camera files with common names in a folder, or the folder itself if it contains a COLMAP model or MVSNet's files;
    if there are none, that of the first of VideoGS's folders, one per frame, which all have the same cameras."""
    found = [folder / name for name in _USUAL_NAMES if (folder / name).is_file()]
    for pattern in _USUAL_PATTERNS:
        found += [path for path in sorted(folder.glob(pattern)) if path not in found]
    colmap = any((folder / f"cameras.{suffix}").is_file() for suffix in ("txt", "bin"))
    if colmap or numbered_models(folder) or any(folder.glob(f"*{mvsnet.SUFFIX}")):
        found.append(folder)
    found = found or [folder / name for name in _LESS_EXACT if (folder / name).is_file()][:1]
    frames = [] if found else [path for path in folder.glob("*/transforms.json") if path.parent.name.isdecimal()]
    return found or sorted(frames, key=lambda path: int(path.parent.name))[:1]


def read_rig(path: Path | str) -> Rig:
    """Read cameras; the format is detected from the file's name and content.

    Args:
        path: a file in a format of docs/reference/files.md; a folder with exactly one of these, with a COLMAP model,
            with *_cam.txt (MVSNet), or with one folder per frame (VideoGS); or a pattern with {camera} of OpenCV's XML
            or YAML files, one per camera.

    Returns:
        the rig, in the conventions of `studio.cameras` (OpenCV axes, pixel origin at the image corner); its notes say
        what was assumed and what was left out.

    Raises:
        StudioError: the file is missing, of an unknown format, truncated or otherwise unusable (camera_file.*), or one
            of its cameras is invalid (camera.*). The error contains the file.
    """
    with naming(Path(path)):
        return _checked(_read(Path(path)))


def _checked(rig: Rig) -> Rig:
    """The rig, with notes on what is unlikely, whatever the format of its file."""
    for camera in rig:
        focal, longer = min(camera.fx, camera.fy), max(camera.width, camera.height)
        if focal < _LEAST_FOCAL * longer:
            problem = f"a focal length of {focal:.4g} pixels is too short for images of {camera.width}x{camera.height}"
            fix = "Give focal lengths and principal points in pixels, not in millimeters or relative to the size."
            raise camera_error("camera.focal_length_unit", camera.name, problem, value=focal, fix=fix)
    outside = [one.name for one in rig if not (0 <= one.cx <= one.width and 0 <= one.cy <= one.height)]
    if not outside:
        return rig
    note = (
        "The principal point is outside of the image, as if the images had another size when they were calibrated: "
        f"{cameras_listed(outside)}."
    )
    return replace(rig, notes=(*rig.notes, note))


def _read(path: Path) -> Rig:
    if "{camera}" in str(path):
        fixed = next(parent for parent in path.parents if "{camera}" not in str(parent))
        return read_opencv_cameras(fixed, path.relative_to(fixed).as_posix())
    if path.is_dir():
        return _read_folder(path)
    if not path.exists():
        raise StudioError("camera_file.missing", "camera file not found", fix="Check the path.")
    if path.name in _COLMAP_FILES:
        return read_colmap(path.parent)
    if path.suffix.lower() == ".json":
        return _read_json(path)
    if path.name in (easymocap.INTRINSICS, easymocap.EXTRINSICS):
        return easymocap.read_easymocap(path.parent)
    if path.name in (rerf.POSES, rerf.INTRINSICS):
        return rerf.read_rerf(path.parent)
    if path.suffix.lower() == ".toml":
        return read_toml(path)
    if path.suffix.lower() == ".npy":
        return annots_npy.read_annots(path) if path.name == annots_npy.NAME else poses_bounds.read_poses_bounds(path)
    text = read_text(path)
    start = text.lstrip()[:1]
    if path.suffix.lower() == ".csv":
        heads = {head.strip() for head in text.lstrip().splitlines()[0].split(",")}
        return read_actorshq(path) if len(heads & set(ACTORSHQ_COLUMNS)) > 9 else read_realityscan(path)
    if start == "<":
        return _read_xml(text)
    if text.startswith("%YAML"):  # OpenCV writes "%YAML:1.0" or, since version 5, "%YAML 1.2"
        values = read_storage(path)
        if "nb_camera" in values:
            return rig_from_mc_calib(path.parent, values)
        raise _one_camera()
    if start not in "{[":
        raise _unknown_format("not a camera file of a supported format")
    return _read_json(path)


def _read_json(path: Path) -> Rig:
    values = read_json_value(path)
    if isinstance(values, dict):
        if isinstance(values.get("frames"), list) and "cameras" not in values:
            return rig_from_transforms(path, values)
        if dynamic_gaussians.is_meta(values):
            return dynamic_gaussians.read_meta(path)
        check_format(values)
    rig = rig_from_json(path.parent, values)
    if rig is not None:
        return rig
    keys = ", ".join(f"'{key}'" for key in list(values)[:20]) if isinstance(values, dict) else "a list"
    raise _unknown_format(f"the JSON has no cameras under a known key ({keys or 'empty'})")


def _unknown_format(problem: str) -> StudioError:
    return StudioError("camera_file.unknown_format", problem, fix=f"Supported are {_KNOWN}.")


def _one_camera() -> StudioError:
    problem = "an OpenCV calibration, which describes one camera"
    fix = "Set capture.rig to the pattern of all of them, for example '{camera}/config.xml'."
    return StudioError("camera_file.one_camera", problem, fix=fix, setting="capture.rig")


def _read_folder(folder: Path) -> Rig:
    if any(folder.glob(f"*{mvsnet.SUFFIX}")):
        return mvsnet.read_mvsnet(folder)
    files = find_camera_files(folder)
    if len(files) > 1:
        names = ", ".join(file.name for file in files)
        problem = f"several camera files in the folder: {names}"
        fix = "Specify one of them."
        raise StudioError("camera_file.ambiguous", problem, value=[file.name for file in files], fix=fix)
    if files and files[0] != folder:
        return read_rig(files[0])
    return read_colmap(folder)


def _read_xml(text: str) -> Rig:
    try:
        root = ElementTree.fromstring(text.encode())
    except ElementTree.ParseError as error:
        line, column = error.position
        problem = f"invalid XML at line {line}, column {column + 1}"
        fix = "The file may be truncated: export the cameras again."
        raise StudioError("camera_file.syntax", problem, fix=fix, line=line, column=column + 1) from None
    if root.tag in ("document", "chunk"):
        return rig_from_metashape(root)
    if root.tag == "opencv_storage":
        raise _one_camera()
    return rig_from_qualisys(root)


def write_rig(rig: Rig, path: Path | str) -> None:
    """Write cameras, atomically, in the format that the name selects.

    `transforms*.json`: transforms.json; any other `.json`: rig.json; `.csv`: ActorsHQ's calibration.csv;
    `camera_array*.toml`: Caliscope; any other `.toml`: Pose2Sim; `intri.yml` or `extri.yml`: both files of EasyMocap;
    no extension: a folder with a COLMAP text model.

    Raises:
        StudioError: the extension is unknown (camera_file.unknown_extension), the format cannot express a camera
            (camera_file.not_expressible), or the file cannot be written (camera_file.unwritable).
    """
    path = Path(path)
    with naming(path):
        if path.suffix == ".json" and path.name.lstrip(".").startswith("transforms"):
            write_transforms(rig, path)
        elif path.suffix == ".json":
            write_rig_json(rig, path)
        elif path.suffix == ".csv":
            write_actorshq(rig, path)
        elif path.suffix == ".toml":
            write_toml(rig, path)
        elif path.name in (easymocap.INTRINSICS, easymocap.EXTRINSICS):
            easymocap.write_easymocap(rig, path.parent)
        elif path.suffix == "" or path.is_dir():
            write_colmap(rig, path)
        else:
            problem = f"cameras cannot be written as '{path.suffix}'"
            fix = "Use .json, .csv, .toml, intri.yml, or a folder for a COLMAP model."
            raise StudioError("camera_file.unknown_extension", problem, value=path.suffix, fix=fix)
