"""Cameras as named values, as in JSON, TOML and OpenCV's FileStorage: one table of the keys that programs use.

A key that is not in the table may be another program's name for the lens. It is therefore rejected if it looks like
that, or if it has numbers as a lens has and the camera has no distortion under a known key; otherwise it is ignored,
and the rig's notes name it.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.camera_files.common import check_pose, no_cameras, rigid_inverse, wrong_shape
from v3studio.studio.camera_files.common.nearby import size_nearby
from v3studio.studio.cameras import Camera, Rig, duplicate_name
from v3studio.studio.counts import cameras_listed, listed
from v3studio.studio.errors import StudioError
from v3studio.studio.lenses import THIN_PRISM
from v3studio.studio.validation import array, camera_error, check_finite, missing_key, number, whole

KEYS = {
    "K": ("cameramatrix", "intrinsicmatrix", "intrinsics", "intrinsic", "k", "mtx", "m", "matrix"),
    "fx": ("fx", "flx", "focalx"),
    "fy": ("fy", "fly", "focaly"),
    "cx": ("cx", "ppx", "principalx"),
    "cy": ("cy", "ppy", "principaly"),
    "angle_x": ("cameraanglex",),
    "angle_y": ("cameraangley",),
    "distortion": (
        "distortioncoefficients", "distortioncoeffs", "distortioncoeff", "distortionvector", "distortions",
        "distortion", "distcoefficients", "distcoeffs", "distcoeff", "distcoefs", "distcoef", "dist", "d", "kc",
    ),
    "rotation": ("rotationvalues", "rotationmatrix", "rotationvector", "rotation", "rvec", "rot", "r"),
    "translation": ("translationvalues", "translationvector", "translation", "tvec", "trans", "t"),
    "world_to_camera": ("extrinsicmatrix", "extrinsics", "extrinsic", "worldtocamera", "worldtocam", "w2c", "rt"),
    "camera_to_world": ("cameratoworld", "camtoworld", "c2w"),
    "width": ("imagewidth", "imgwidth", "width", "w"),
    "height": ("imageheight", "imgheight", "height", "h"),
    "size": ("imagesize", "imgsize", "size", "resolution"),
    "type": ("type", "cameratype", "lens"),
    "model": ("cameramodel", "model", "distortionmodel", "distortiontype", "lensmodel", "projection"),
    "fisheye": ("fisheye", "isfisheye", "fisheyelens", "fisheyemodel", "rdist"),
}  # fmt: skip
"""Canonical key to the spellings in lower case without `_`, `-` and spaces; the first one found wins."""
TERMS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # OpenCV's order; a camera may have them as separate keys
_FISHEYE_TERMS = ("k1", "k2", "k3", "k4", "p1", "p2", "sx1", "sy1")  # in the order of a `Camera`
_ALL_TERMS = (*TERMS, "sx1", "sy1")
HARMLESS = frozenset({
    "name", "camera", "cameraname", "camid", "cameraid", "id", "index", "port", "serial", "serialnumber", "label",
    "comment", "description", "fps", "framerate", "frame", "frames", "nframes", "nrofframes", "framecount", "time",
    "date", "calibrationtime", "calibrationdate", "exposure", "gain", "whitebalance", "colorcorrection", "ccm",
    "gridcount", "rotationcount", "ignore", "error", "rmse", "rms", "adjusted", "reprojectionerror",
    "avgreprojectionerror", "meanreprojectionerror", "perviewreprojectionerrors", "boardwidth", "boardheight",
    "boardsize", "squaresize", "flags", "flag", "flagvalue", "extrinsicparameters", "imagepoints", "gridpoints",
    "objectpoints", "near", "far", "bounds", "group", "panel", "node", "rectifyalpha", "projectionmatrix",
    "fundamental", "essential",
})  # fmt: skip
"""Keys that do not change how a camera projects."""
_CHANGES_THE_CAMERA = re.compile(
    r"dist|fish|lens|model|omni|equi|project|skew|scale|unit|flip|mirror|crop|shift|offset|rolling|pose|radial|tangent"
    r"|axis|axes|coord|convention|handed|transform|kappa|decenter|ftheta|latlong|spher|pano"
    r"|^(xi|alpha|beta|gamma|cc|fc|[kps]\d+|tau[xy])$"
)
_ABOUT_FILES = re.compile(r"^(time|frame)|(id|index|indices|path|count|version)$")
_ABOUT_LENSES = re.compile(r"dist|fish|lens|model|radial|tangent")
_NOT_PINHOLE = re.compile(r"fish|omni|equi|spher|cylind|pano|ortho")
MODELS = frozenset({
    "pinhole", "simplepinhole", "perspective", "standard", "opencv", "fullopencv", "brown", "brownconrady",
    "plumbbob", "radtan", "radial", "simpleradial", "rational", "rationalpolynomial", "thinprism", "tilted", "none",
})  # fmt: skip
"""Lens models whose coefficients are OpenCV's, in its order."""
FISHEYE_MODELS = frozenset({"fisheye", "opencvfisheye", "equidistant", "kannalabrandt", "thinprismfisheye"})
"""Lens models whose coefficients are those of OpenCV's fisheye, or of COLMAP's THIN_PRISM_FISHEYE."""


_RENAME = (
    "Give its value under a known key such as 'distortion', 'K', 'R', 't' or 'width', or delete it if it does not say "
    "where points are in the image."
)
_SKEW = 1e-6  # pixels
NO_DISTORTION = "The camera file has no lens distortion: the images are taken as undistorted."


def normal_key(key: str, camera: str = "") -> str:
    """A key in the spelling of `KEYS`."""
    return re.sub(r"[_\- .]", "", key).lower()


@dataclass(frozen=True)
class KeyedForm:
    """The form in which a program writes a camera."""

    corner: bool = False  # whether the pixel origin is the image corner, not the center of the first pixel as in OpenCV
    centered: bool = False  # whether the principal point is the image center, and pixels are square, unless given
    unit: float = 1.0  # length of its unit in the rig's unit
    harmless: Collection[str] = ()  # keys, in addition to `HARMLESS`, that do not change how a camera projects
    spelling: Callable[[str, str], str] = normal_key  # (key, camera) -> the key as in `KEYS`
    # (name) -> width and height in pixels of a camera without them; None: from the footage next to the file
    size_of: Callable[[str], tuple[int, int]] | None = None


@dataclass
class FileNotes:
    """Ignored keys of a camera file with their cameras, and the cameras with (`bent`) and without distortion."""

    ignored: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    decided: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))  # the same for what was assumed
    bent: list[str] = field(default_factory=list)
    straight: list[str] = field(default_factory=list)

    def check_unknown(self, camera: str, entry: Mapping[str, Any], missing: str) -> None:
        """Reject keys that may belong to the lens or stand for what a camera lacks (`missing`), and record others."""
        for key, value in entry.items():
            spelling = normal_key(key)
            if spelling in HARMLESS or _is_empty(value):
                continue
            may_be_it = bool(missing) and _is_of_numbers(value, fractions=missing == "lens distortion")
            if may_be_it or _changes_the_camera(spelling):
                why = f"there is no {missing} under a known key" if missing else "it may change how the camera projects"
                problem = f"the key '{key}' is not known, and {why}"
                raise camera_error("camera.unknown_key", camera, problem, value=key, fix=_RENAME, key=key)
            self.ignored[key].append(camera)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The sentences for `Rig.notes`."""
        straight = (NO_DISTORTION,) if self.straight else ()
        assumed = (f"{words} ({cameras_listed(own)})." for words, own in self.decided.items())
        ignored = (f"Ignored in the camera file: '{key}' ({cameras_listed(own)})." for key, own in self.ignored.items())
        return *straight, *assumed, *ignored


def _changes_the_camera(spelling: str) -> bool:
    """Return whether a key says how a camera projects, or how the files do that say so."""
    if _ABOUT_FILES.search(spelling) and not _ABOUT_LENSES.search(spelling):
        return False
    return _CHANGES_THE_CAMERA.search(spelling) is not None


def _is_of_numbers(value: Any, fractions: bool) -> bool:
    """Return whether a value has numbers; if `fractions`, only such in lists count, as a lens has them."""
    if isinstance(value, Mapping):
        return any(
            _changes_the_camera(normal_key(str(key))) or _is_of_numbers(part, fractions) for key, part in value.items()
        )
    if isinstance(value, list):
        return any(
            _is_of_numbers(part, fractions)
            if isinstance(part, list | Mapping)
            else _is_number(part) and (not fractions or part != round(part))
            for part in value
        )
    return not fractions and _is_number(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)


def ignored_in_file(content: Mapping[str, Any], known: Collection[str]) -> tuple[str, ...]:
    """Notes on the keys beside the cameras of a file."""
    harmless = HARMLESS | {"unit", "units", "up"}  # the world is in the unit of the poses
    unknown = [
        key
        for key, value in content.items()
        if key not in known and normal_key(key) not in harmless and not _is_empty(value) and not _is_opencv(value)
    ]
    for key in unknown:
        if _changes_the_camera(normal_key(key)):
            problem = f"the key '{key}' beside the cameras is not known, and it may change all of them"
            fix = "Delete it if the cameras have OpenCV's axes (x right, y down, z forward), else convert them."
            raise StudioError("camera.unknown_key", problem, value=key, fix=fix, key=key)
    return (f"Ignored in the camera file: {listed([repr(key) for key in unknown])}.",) if unknown else ()


def _is_opencv(value: Any) -> bool:
    return isinstance(value, str) and normal_key(value).startswith(("opencv", "colmap"))


def is_camera(entry: object) -> bool:
    """Return whether a value is an object with intrinsics or a pose under one of the keys."""
    wanted = {spelling for key in ("K", "rotation", "translation", "distortion") for spelling in KEYS[key]}
    return isinstance(entry, Mapping) and bool(wanted & {normal_key(str(key)) for key in entry})


def keyed_rig(folder: Path, entries: Sequence[tuple[str, Mapping[str, Any]]], form: KeyedForm = KeyedForm()) -> Rig:
    """A rig from (name, values) of its cameras; cameras that have intrinsics but no pose are in its `left_out`. Image
    sizes may come from footage in `folder`, in which the file is."""
    notes = FileNotes()
    names = [name for name, _ in entries]
    for name in names:
        if names.count(name) > 1:
            raise duplicate_name(name)
    cameras = [(name, keyed_camera(folder, name, entry, form, notes)) for name, entry in entries]
    without = [name for name, camera in cameras if camera is None]
    if len(without) == len(cameras):
        raise no_cameras("no camera has a pose (rotation and translation)")
    if notes.bent and notes.straight:
        raise missing_key("distortion", notes.straight[0])
    return Rig(tuple(camera for _, camera in cameras if camera is not None), notes.sentences, tuple(without))


def pose_of(entry: Mapping[str, Any], rotation: str, translation: str, camera: str) -> np.ndarray:
    """(4, 4) from the matrix and the vector under these keys."""
    pose = np.eye(4)
    for key, place in ((rotation, pose[:3, :3]), (translation, pose[:3, 3])):
        if key not in entry:
            raise missing_key(key, camera)
        value = array(entry[key], key, camera)
        if value.size != place.size:
            raise wrong_shape(key, camera, value.shape, (place.shape,))
        check_finite(value, key, camera)
        place[:] = value.reshape(place.shape)
    return pose


def keyed_camera(folder: Path, name: str, entry: Mapping[str, Any], form: KeyedForm, notes: FileNotes) -> Camera | None:
    """The camera that `entry` describes, as in `keyed_rig`; None if it has no pose."""
    given = _known(name, entry, form, notes)
    fisheye = _is_fisheye(name, given)
    pose = _pose(name, given, form.unit)
    if pose is None:
        return None
    distortion = _distortion(name, given, fisheye)
    # read before the size, for which footage may be missing, so that an error names a wrong key
    matrices = [(key, value[:3, :3]) for key, value in _arrays(name, given, "K", ((3, 3), (3, 4), (4, 4)))]
    width, height = _size(name, given) or (form.size_of(name) if form.size_of else size_nearby(folder, name, name))
    K = _K(name, given, matrices, (width, height), form.centered, notes)
    if abs(K[0, 1]) > _SKEW:
        notes.decided["The skew of K is removed from the images, as lens distortion is"].append(name)
    if not form.corner:
        K[:2, 2] += 0.5
    (notes.bent if distortion is not None or fisheye else notes.straight).append(name)
    coefficients = np.zeros(0) if distortion is None or not distortion.any() else distortion
    return Camera(name, width, height, K, pose, coefficients, fisheye)


_Given = dict[str, list[tuple[str, Any]]]
"""Canonical key to the keys of the file and their values, in the order of `KEYS`."""


def _known(name: str, entry: Mapping[str, Any], form: KeyedForm, notes: FileNotes) -> _Given:
    """The values under known keys; null and empty ones count as missing."""
    by_spelling: dict[str, list[str]] = defaultdict(list)
    for key, value in entry.items():
        spelling = form.spelling(str(key), name)
        if not _is_empty(value) or spelling in KEYS["distortion"]:  # an empty list says that there is none
            by_spelling[spelling].append(key)
    given: _Given = {}
    for canonical, spellings in [*KEYS.items(), *((term, (term,)) for term in _ALL_TERMS)]:
        own = [(key, entry[key]) for spelling in spellings for key in by_spelling.pop(spelling, ())]
        if own:
            given[canonical] = own
    harmless = {normal_key(key) for key in form.harmless}
    unknown = {key: entry[key] for spelling, keys in by_spelling.items() if spelling not in harmless for key in keys}
    notes.check_unknown(name, unknown, _missing(given, form.centered))
    return given


_NEEDED: tuple[tuple[str, tuple[set[str], ...]], ...] = (
    ("lens distortion", ({"distortion"}, *({term} for term in _ALL_TERMS))),
    ("intrinsic matrix", ({"K"}, {"fx", "fy", "cx", "cy"})),
    ("pose", ({"rotation", "translation"}, {"world_to_camera"}, {"camera_to_world"})),
    ("image size", ({"size"}, {"width", "height"})),
)
"""The parts that a camera needs, each with the sets of canonical keys of which any gives it."""


def _missing(given: _Given, centered: bool) -> str:
    """The part that a camera needs and does not have; "" if it has everything."""
    known = set(given)
    if centered:
        known |= {"K"} if known & {"fx", "angle_x"} else set()
        known |= {"size"} if not known & {"width", "height"} else set()  # from the footage
    return " and no ".join(what for what, ways in _NEEDED if not any(way <= known for way in ways))


def _is_empty(value: Any) -> bool:
    return value is None or (isinstance(value, str) and value in ("", "null")) or value in ([], {}, [[]])


def _is_fisheye(name: str, given: _Given) -> bool:
    """Tell whether the lens is a fisheye. Raises StudioError (camera.lens_model) for a model that is not known."""
    fisheye = False
    fix = "Undistort the images to a pinhole camera first."
    for key, value in given.get("fisheye", ()):
        if isinstance(value, list) and np.any(array(value, key, name)):  # EasyVolcap's, which may be 0
            problem = f"the lens model of '{key}' is not known"
            raise camera_error("camera.lens_model", name, problem, value=value, fix=fix, key=key)
        fisheye |= not isinstance(value, list) and value not in (False, 0, "false", "False")
    models = given.get("model", [])
    models += [pair for pair in given.get("type", ()) if _NOT_PINHOLE.search(normal_key(str(pair[1])))]
    for key, model in models:
        if normal_key(str(model)) in FISHEYE_MODELS:
            fisheye = True
        elif normal_key(str(model)) not in MODELS:
            problem = f"'{key}' is {model!r}; only pinhole and fisheye cameras with OpenCV's distortion are supported"
            raise camera_error("camera.lens_model", name, problem, value=model, fix=fix, key=key)
    return fisheye


def agreeing(name: str, parsed: Sequence[tuple[str, np.ndarray]]) -> np.ndarray:
    """The first of several values by key, which must be equal up to the digits of the file."""
    first_key, first = parsed[0]
    for key, value in parsed[1:]:
        size = max(first.size, value.size)
        padded_first, padded_value = (np.pad(part.ravel(), (0, size - part.size)) for part in (first, value))
        if not np.allclose(padded_first, padded_value, rtol=1e-3, atol=1e-3):
            problem = f"'{first_key}' and '{key}' differ: {_short(first)} and {_short(value)}"
            fix = "Delete the wrong one from the camera file."
            raise camera_error("camera.conflict", name, problem, fix=fix, key=key, other=first_key)
    return first


def _short(value: np.ndarray) -> str:
    return ", ".join(f"{number:.6g}" for number in value.ravel())


def _arrays(
    name: str, given: _Given, canonical: str, shapes: tuple[tuple[int, ...], ...] = ()
) -> list[tuple[str, np.ndarray]]:
    """The finite values of a canonical key; each has one of the shapes, or of their counts if it is flat."""
    matrices = []
    for key, value in given.get(canonical, ()):
        matrix = array([] if value is None else value, key, name)
        flat = matrix.size if matrix.ndim == 1 else None
        if shapes and matrix.shape not in shapes:
            fitting = [shape for shape in shapes if len(shape) == 2 and flat == shape[0] * shape[1]]
            if not fitting:
                raise wrong_shape(key, name, matrix.shape, shapes)
            matrix = matrix.reshape(fitting[0])
        check_finite(matrix, key, name)
        matrices.append((key, matrix))
    return matrices


def _K(
    name: str,
    given: _Given,
    matrices: list[tuple[str, np.ndarray]],
    size: tuple[int, int],
    centered: bool,
    notes: FileNotes,
) -> np.ndarray:
    """(3, 3) with the pixel origin of the file. Values under several keys, also of `matrices`, must agree, except for
    fields of view: Blender's are those of its sensor, whose shape is not that of the images."""
    width, height = size
    parts = {key: _scalars(name, given, key) for key in ("fx", "fy", "cx", "cy")}
    by_angle: dict[str, list[tuple[str, float]]] = {"fx": [], "fy": []}
    for angle, focal, side in (("angle_x", "fx", width), ("angle_y", "fy", height)):
        for key, radians in _scalars(name, given, angle):
            if not 0 < radians < np.pi:
                problem = f"'{key}' is {radians:g}, expected a value between 0 and pi"
                fix = "Correct it in the camera file; angles are in radians."
                raise camera_error("camera.field_of_view", name, problem, value=radians, fix=fix, key=key)
            by_angle[focal].append((key, 0.5 * side / float(np.tan(0.5 * radians))))
    _use_angles(name, parts, by_angle, size, notes)
    if matrices:
        K = agreeing(name, matrices).copy()
        for part, value in zip(parts.values(), (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), strict=True):
            _agreeing_scalar(name, [(matrices[0][0], float(value)), *part])
        return K
    if centered:
        parts["fy"] = parts["fy"] or parts["fx"]
        parts["cx"], parts["cy"] = parts["cx"] or [("", width / 2)], parts["cy"] or [("", height / 2)]
    missing = [key for key, part in parts.items() if not part]
    if missing:
        raise missing_key("K" if len(missing) == len(parts) else missing[0], name)
    fx, fy, cx, cy = (_agreeing_scalar(name, part) for part in parts.values())
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def _use_angles(
    name: str,
    parts: dict[str, list[tuple[str, float]]],
    by_angle: Mapping[str, list[tuple[str, float]]],
    size: tuple[int, int],
    notes: FileNotes,
) -> None:
    """Add the focal lengths that fields of view give to `parts`, unless they are of a sensor of another shape."""
    given = [key for pairs in by_angle.values() for key, _ in pairs]
    known = {key: values[0][1] for key, values in parts.items() if values}
    focal = {key: values[0][1] for key, values in by_angle.items() if values}
    if any(not np.isclose(focal[key], known[key], rtol=1e-3) for key in focal.keys() & known.keys()):
        words = f"{listed(list(map(repr, given)))} do not agree with the focal lengths, which are used"
        notes.decided[words].append(name)
        return
    width, height = size
    if len(focal) == 2 and not known and np.isclose(focal["fx"] / width * height, 1 / 1.5 * focal["fy"], rtol=1e-3):
        if not np.isclose(width, 1.5 * height, rtol=1e-2):
            notes.decided["The fields of view are those of a sensor of 3:2, along the longer side"].append(name)
            value = focal["fx"] * max(width, height) / width
            by_angle = {"fx": [("", value)], "fy": [("", value)]}
    elif focal and not known and height > width and len(focal) == 1:
        notes.decided[f"'{given[0]}' is taken for the field of view of the shorter side"].append(name)
    for key, values in by_angle.items():
        parts[key] = parts[key] or values


def _scalars(name: str, given: _Given, canonical: str) -> list[tuple[str, float]]:
    """The finite numbers under a canonical key, by the keys of the file."""
    return [(key, number({key: value}, key, name)) for key, value in given.get(canonical, ())]


def _agreeing_scalar(name: str, parsed: Sequence[tuple[str, float]]) -> float:
    return float(agreeing(name, [(key, np.array([value])) for key, value in parsed])[0])


def _distortion(name: str, given: _Given, fisheye: bool) -> np.ndarray | None:
    """The coefficients of a `Camera`; None without a key for them."""
    lists = [(key, value.ravel()) for key, value in _arrays(name, given, "distortion")]
    if "thinprismfisheye" in {normal_key(str(model)) for _, model in given.get("model", ())}:
        lists = [(key, value[THIN_PRISM] if value.size == 8 else value) for key, value in lists]
    order = _FISHEYE_TERMS if fisheye else TERMS
    if any(term in given for term in order):
        terms = np.array([_agreeing_scalar(name, _scalars(name, given, term) or [("", 0.0)]) for term in order])
        count = 8 if terms[5:].any() or (fisheye and terms[4]) else 5 if terms[4] else 4
        lists.append((next(term for term in order if term in given), terms[:count]))
    distortion = agreeing(name, lists) if lists else None
    if fisheye and distortion is not None and 4 < len(distortion) < 8:  # with p1 and p2, or zeros
        return np.pad(distortion, (0, 8 - len(distortion))) if distortion[4:].any() else distortion[:4]
    return distortion


def _pose(name: str, given: _Given, unit: float) -> np.ndarray | None:
    """(3, 4) world to camera; None if the camera has neither a rotation nor a translation."""
    import cv2

    poses: list[tuple[str, np.ndarray]] = []
    has = [key in given for key in ("rotation", "translation")]
    if any(has) and not (all(has) or "world_to_camera" in given or "camera_to_world" in given):
        raise _half(name, given, *(("rotation", "translation") if has[0] else ("translation", "rotation")))
    if all(has):
        rotations = []
        given_rotations = _arrays(name, given, "rotation", ((3, 3), (3,), (3, 1), (1, 3)))
        # vectors first, as in EasyMocap: they have more digits than the matrices
        for key, value in sorted(given_rotations, key=lambda pair: pair[1].size):
            if value.size == 3:
                _check_angle(name, key, value)
            rotations.append((key, value if value.size == 9 else cv2.Rodrigues(value.reshape(3))[0]))
        translations = _arrays(name, given, "translation", ((3,), (3, 1), (1, 3)))
        pose = np.column_stack([agreeing(name, rotations), agreeing(name, translations).ravel()])
        poses.append((rotations[0][0], pose))
    for canonical in ("world_to_camera", "camera_to_world"):
        for key, value in _arrays(name, given, canonical, ((4, 4), (3, 4))):
            check_pose(value, key, name)
            poses.append((key, value[:3] if canonical == "world_to_camera" else rigid_inverse(value)[:3]))
    if not poses:
        return None
    result = agreeing(name, poses).copy()
    result[:, 3] *= unit
    return result


def _check_angle(name: str, key: str, vector: np.ndarray) -> None:
    """Check that a rotation vector is in radians. Raises StudioError (camera.rotation)."""
    angle = float(np.linalg.norm(vector))
    if angle > 2 * np.pi:
        problem = f"'{key}' would turn the camera by {angle:.4g} radians"
        fix = "Write it as OpenCV's rotation vector, in radians, or as a 3x3 matrix."
        raise camera_error("camera.rotation", name, problem, value=vector.ravel().tolist(), fix=fix, key=key)


def _half(name: str, given: _Given, has: str, lacks: str) -> StudioError:
    """The error for one of two values that belong together."""
    return camera_error("camera.missing_key", name, f"'{given[has][0][0]}' is given, but no {lacks}", key=lacks)


def _size(name: str, given: _Given) -> tuple[int, int] | None:
    """Width and height; None if they are missing or not positive, as programs write unknown ones."""
    sizes = []
    for key, value in _arrays(name, given, "size", ((2,),)):
        sizes.append((key, np.array([whole({key: part}, key, name) for part in value.tolist()])))
    if "width" in given or "height" in given:
        pair = []
        for canonical in ("width", "height"):
            if canonical not in given:
                raise _half(name, given, "height" if canonical == "width" else "width", canonical)
            sides = [(key, np.array([whole({key: value}, key, name)])) for key, value in given[canonical]]
            pair.append(int(agreeing(name, sides)[0]))
        sizes.append((given["width"][0][0], np.array(pair)))
    if not sizes:
        return None
    width, height = (int(side) for side in agreeing(name, sizes))
    return (width, height) if min(width, height) > 0 else None
