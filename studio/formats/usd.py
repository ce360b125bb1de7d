"""OpenUSD: a performance in one file, as `ParticleField3DGaussianSplat` prims with time samples, read and written with
`usd-core` (26.03 or newer, the first release with that schema).

Sources: the schema UsdVol, the specifications of UsdGeomCamera, UsdMediaSpatialAudio and USDZ. An exported stage has y
up, meters as units, one time code per frame of the footage, and one prim per group, which is visible during its frames:

    /Performance                an Xform with the translation of a take that is far from zero
    /Performance/Group_000      the splats: float positions, and halves where they are accurate to half a level of color
    /Performance/Cameras/NAME   the cameras of the footage, without lens distortion
    /Performance/Sound          a SpatialAudio that is heard everywhere

What does not change within a group is stored once. Colors are spherical harmonics in sRGB, as trained.
"""

import re
import wave
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from v3studio.studio.audio.pcm import Pcm
from v3studio.studio.cameras import OPENGL_AXES, Camera
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import USD_SUFFIXES, ignore
from v3studio.studio.formats.checks import Note, to_arrays
from v3studio.studio.formats.placing import new_file
from v3studio.studio.formats.rigid_motion import scaled, turned
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.torch_rotations import align_axes

_SCHEMA = "ParticleField3DGaussianSplat"
_SH = "radiance:sphericalHarmonicsCoefficients"
_GREATEST_HALF = 65504.0
_APERTURE = 36.0  # horizontal, in the tenths of a unit in which USD measures films
_SAMPLES = 48_000  # of sound written at once


def usd() -> Any:
    """The package `pxr`; untyped."""
    try:
        import pxr
        from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdMedia, UsdUtils, UsdVol, Vt  # noqa: F401  # loads them
    except ImportError as error:
        problem = f"USD files need usd-core ({error})"
        raise StudioError("usd.missing", problem, fix="Install it: pip install 'usd-core>=26.3'.") from None
    if not hasattr(UsdVol, _SCHEMA):
        release = ".".join(str(part) for part in Usd.GetVersion())
        fix = "Install a newer one: pip install 'usd-core>=26.3'."
        raise StudioError("usd.too_old", f"usd-core {release} has no {_SCHEMA}", value=release, fix=fix)
    return pxr


class _Attribute:
    """Writes values in the order of time, without those that repeat: one that never changes has no time sample."""

    def __init__(self, attribute: Any, make: Callable[[np.ndarray], Any]) -> None:
        self._attribute, self._make = attribute, make
        self._first: tuple[float, np.ndarray] | None = None
        self._last: tuple[float, np.ndarray] | None = None
        self._sampled = False

    def add(self, time: float, values: np.ndarray) -> None:
        """Add the values at a time code later than the last one."""
        if self._first is None or self._last is None:
            self._first = self._last = time, values
            return
        before, last = self._last
        if np.array_equal(values, last):
            self._last = time, last
            return
        if not self._sampled:
            self._write(*self._first)
            self._sampled = True
        if before != self._first[0]:
            self._write(before, last)  # or values would be interpolated since the last change
        self._write(time, values)
        self._last = time, values

    def close(self) -> None:
        """Write the value that has not changed."""
        if not self._sampled and self._first is not None:
            self._attribute.Set(self._make(self._first[1]))

    def _write(self, time: float, values: np.ndarray) -> None:
        self._attribute.Set(self._make(values), time)


def export_usd(
    video: SplatVideo,
    path: Path,
    rotation: np.ndarray | None = None,
    cameras: Sequence[Camera] = (),
    progress: ProgressFn = no_progress,
) -> None:
    """Write a video to one file; its sound goes into a .usdz, or into a .wav beside the others.

    Args:
        video: the frames; their numbers are the time codes.
        path: a new file that ends with .usdc (binary), .usdz (a package) or .usda (text).
        rotation: (3, 3) to y up, see `studio.formats.sequence.axes_of`; None: the axes and the place of the capture.
        cameras: of the footage, in the world of the splats.

    Raises:
        StudioError: usd-core cannot be used (see `usd`), the extension is another one, a frame cannot be read or
            represented, or the file exists or cannot be written.
    """
    pxr = usd()
    if path.suffix.lower() not in USD_SUFFIXES[:3]:
        problem = f"a USD file ends with {', '.join(USD_SUFFIXES[:3])}, not with '{path.suffix}'"
        fix = "Choose .usdc for film tools, or .usdz for one file with its sound."
        raise StudioError("usd.extension", problem, file=path, value=path.suffix, fix=fix)
    package = path.suffix.lower() == ".usdz"
    with ExitStack() as stack:
        temporary = stack.enter_context(new_file(path))
        stage_file = temporary.with_suffix(".usdc") if package else temporary
        sound_file = path.with_suffix(".wav")
        written = temporary.with_suffix(".wav")
        if package:
            stack.callback(stage_file.unlink, missing_ok=True)
            stack.callback(written.unlink, missing_ok=True)
        elif video.sound is not None:
            written = stack.enter_context(new_file(sound_file))
        stage = pxr.Usd.Stage.CreateNew(str(stage_file))
        _write_stage(pxr, stage, video, path, rotation, cameras, progress)
        if video.sound is not None:
            _write_wave(written, video.sound)
            _add_sound(pxr, stage, written.name if package else sound_file.name, _times(video)[0])
        try:
            stage.GetRootLayer().Save()
        except pxr.Tf.ErrorException as error:
            reason = re.search(r": '(.*)'", str(error))  # its first line; before it, places in USD's own code
            problem = f"cannot be written ({reason[1] if reason else error})"
            raise StudioError("export.write_failed", problem, file=path) from None
        del stage
        if package and not pxr.UsdUtils.CreateNewUsdzPackage(str(stage_file), str(temporary)):
            raise StudioError("export.write_failed", "cannot be packed", file=path)


def _times(video: SplatVideo) -> list[float]:
    return [float(video.number(index)) for index in range(video.frame_count)]


def _write_stage(
    pxr: Any,
    stage: Any,
    video: SplatVideo,
    path: Path,
    rotation: np.ndarray | None,
    cameras: Sequence[Camera],
    progress: ProgressFn,
) -> None:
    times = _times(video)
    step = times[1] - times[0] if len(times) > 1 else 1.0
    geometry = pxr.UsdGeom
    geometry.SetStageUpAxis(stage, geometry.Tokens.y)
    geometry.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(video.fps * step)
    stage.SetFramesPerSecond(video.fps)
    stage.SetStartTimeCode(times[0])
    stage.SetEndTimeCode(times[-1])
    stage.GetRootLayer().comment = "V3 Studio"
    root = geometry.Xform.Define(stage, "/Performance")
    stage.SetDefaultPrim(root.GetPrim())
    pxr.Usd.ModelAPI(root.GetPrim()).SetKind(pxr.Kind.Tokens.component)
    if rotation is None and video.original.translation.any():
        root.AddTranslateOp(geometry.XformOp.PrecisionDouble).Set(pxr.Gf.Vec3d(*video.original.translation.tolist()))
    for number, frames in enumerate(video.groups):
        prim = pxr.UsdVol.ParticleField3DGaussianSplat.Define(stage, f"/Performance/Group_{number:03d}")
        pxr.Usd.ColorSpaceAPI.Apply(prim.GetPrim()).CreateColorSpaceNameAttr(pxr.Gf.ColorSpaceNames.SRGBRec709)
        prim.CreateSortingModeHintAttr(pxr.UsdVol.Tokens.cameraDistance)
        attributes: dict[str, _Attribute] = {}
        before: Gaussians | None = None
        for index in frames:
            progress(index, video.frame_count)
            splats = scaled(video.read(index), video.original.scale)
            splats = splats if rotation is None else turned(splats, rotation)
            if before is not None:  # readers interpolate between time samples
                quats, log_scales = align_axes(splats.unit_quats, splats.log_scales, before.unit_quats)
                splats = replace(splats, quats=quats, log_scales=log_scales)
            before = splats
            if not attributes:
                attributes = _attributes(pxr, prim, splats.sh_degree)
            for name, values in _values(path, splats).items():
                attributes[name].add(times[index], values)
        for attribute in attributes.values():
            attribute.close()
        if len(video.groups) > 1:
            _show_during(pxr, prim, frames, times)
    progress(video.frame_count, video.frame_count)
    world = Similarity(video.original.scale, np.eye(3) if rotation is None else rotation)
    for camera in cameras:
        _add_camera(pxr, stage, world.camera(camera))


def _attributes(pxr: Any, prim: Any, degree: int) -> dict[str, _Attribute]:
    """Writers of the attributes in `_values`."""
    prim.CreateRadianceSphericalHarmonicsDegreeAttr(degree)
    made = {
        "positions": (prim.CreatePositionsAttr, pxr.Vt.Vec3fArray),
        "orientationsh": (prim.CreateOrientationshAttr, pxr.Vt.QuathArray),
        "scalesh": (prim.CreateScaleshAttr, pxr.Vt.Vec3hArray),
        "opacitiesh": (prim.CreateOpacitieshAttr, pxr.Vt.HalfArray),
        f"{_SH}h": (prim.CreateRadianceSphericalHarmonicsCoefficientshAttr, pxr.Vt.Vec3hArray),
        "extent": (prim.CreateExtentAttr, pxr.Vt.Vec3fArray),
    }
    return {name: _Attribute(create(), kind.FromNumpy) for name, (create, kind) in made.items()}


def _values(path: Path, splats: Gaussians) -> dict[str, np.ndarray]:
    """The attributes of a frame. Quaternions are xyzw, as USD's arrays have them in memory."""
    arrays = to_arrays(path, splats)
    scales = np.exp(arrays["log_scales"])
    values = {
        "positions": arrays["means"],
        "orientationsh": arrays["quats"][:, [1, 2, 3, 0]].astype(np.float16),
        "scalesh": np.clip(scales, 0, _GREATEST_HALF).astype(np.float16),
        "opacitiesh": splats.opacities.detach().cpu().numpy().astype(np.float16),
        f"{_SH}h": np.clip(arrays["sh"].reshape(-1, 3), -_GREATEST_HALF, _GREATEST_HALF).astype(np.float16),
    }
    reach = 3 * scales.max(axis=1, keepdims=True)
    corners = (arrays["means"] - reach).min(axis=0), (arrays["means"] + reach).max(axis=0)
    values["extent"] = np.stack(corners).astype(np.float32)
    return {name: np.ascontiguousarray(array) for name, array in values.items()}


def _show_during(pxr: Any, prim: Any, frames: range, times: Sequence[float]) -> None:
    tokens = pxr.UsdGeom.Tokens
    visibility = prim.CreateVisibilityAttr()
    if frames.start > 0:
        visibility.Set(tokens.invisible, times[0])
    visibility.Set(tokens.inherited, times[frames.start])
    if frames.stop < len(times):
        visibility.Set(tokens.invisible, times[frames.stop])


def _add_camera(pxr: Any, stage: Any, camera: Camera) -> None:
    """A camera of the footage, as UsdGeomCamera: looking down -z, with y up. Lens distortion has no place there."""
    name = pxr.Tf.MakeValidIdentifier(camera.name)
    pxr.UsdGeom.Scope.Define(stage, "/Performance/Cameras")
    made = pxr.UsdGeom.Camera.Define(stage, f"/Performance/Cameras/{name}")
    pose = np.linalg.inv(camera.world_to_camera) @ OPENGL_AXES
    made.AddTransformOp().Set(pxr.Gf.Matrix4d(pose.T.tolist()))
    (fx, _, cx), (_, fy, cy) = camera.K[:2].tolist()
    focal, height = _APERTURE * fx / camera.width, _APERTURE * fx / camera.width * camera.height / fy
    made.CreateFocalLengthAttr(focal)
    made.CreateHorizontalApertureAttr(_APERTURE)
    made.CreateVerticalApertureAttr(height)
    made.CreateHorizontalApertureOffsetAttr(_APERTURE * (0.5 - cx / camera.width))
    made.CreateVerticalApertureOffsetAttr(height * (cy / camera.height - 0.5))
    made.CreateClippingRangeAttr(pxr.Gf.Vec2f(0.01, 10000.0))


def _write_wave(path: Path, sound: Pcm) -> None:
    with wave.open(str(path), "wb") as out:
        out.setnchannels(sound.channels)
        out.setsampwidth(2)
        out.setframerate(sound.sample_rate)
        for first in range(0, sound.samples, _SAMPLES):
            samples = sound.read(first, min(_SAMPLES, sound.samples - first))
            out.writeframes(np.rint(np.clip(samples, -1, 1) * 32767).astype("<i2").tobytes())


def _add_sound(pxr: Any, stage: Any, name: str, start: float) -> None:
    sound = pxr.UsdMedia.SpatialAudio.Define(stage, "/Performance/Sound")
    sound.CreateFilePathAttr(pxr.Sdf.AssetPath(f"./{name}"))
    sound.CreateAuralModeAttr(pxr.UsdMedia.Tokens.nonSpatial)
    sound.CreatePlaybackModeAttr(pxr.UsdMedia.Tokens.onceFromStart)
    sound.CreateStartTimeAttr(pxr.Sdf.TimeCode(start))


def opened_stage(pxr: Any, path: Path) -> Any:
    """The stage of a USD file. Raises StudioError (usd.unsupported) if it is not one."""
    try:
        return pxr.Usd.Stage.Open(str(path))
    except pxr.Tf.ErrorException as error:
        reason = str(error).strip().splitlines()[-1].rsplit(" : ", 1)[-1].strip(" '")
        problem = f"this is not a USD file ({reason})"
        raise StudioError("usd.unsupported", problem, file=path) from None


class UsdFrames:
    """The splats of a USD file, frame by frame. Raises StudioError: damaged, no splats, or unsupported."""

    def __init__(self, path: Path) -> None:
        self.path, self._pxr = path, usd()
        self._stage = opened_stage(self._pxr, path)
        geometry = self._pxr.UsdGeom
        shown = [
            prim
            for prim in self._stage.Traverse()
            if prim.IsA(geometry.Gprim)
            and geometry.Imageable(prim).ComputePurpose() not in (geometry.Tokens.guide, geometry.Tokens.proxy)
        ]
        self._prims = [prim for prim in shown if prim.GetTypeName() == _SCHEMA]
        others = ", ".join(sorted({str(prim.GetTypeName()) for prim in shown if prim.GetTypeName() != _SCHEMA}))
        if not self._prims:
            raise self._error(f"there must be prims of the type {_SCHEMA}; it has {others or 'none'}")
        self.notes = [f"left out: prims of the type {others}"] if others else []
        unknown = sorted({name for prim in self._prims for name in _unknown(prim)})
        if unknown:
            self.notes.append(f"attributes that splats do not have are ignored: {', '.join(unknown)}")
        times = self._time_codes()
        self.times = [time for time in times if self._visible(time)]
        if not self.times:
            raise self._error("there are no visible splats")
        if len(self.times) < len(times):
            hidden = counted(len(times) - len(self.times), "time code")
            self.notes.append(f"left out: {hidden} without visible splats")
        self.fps = float(self._stage.GetTimeCodesPerSecond())
        if len(self.times) > 1:
            self.fps /= min(np.diff(self.times))
        axis = str(self._pxr.UsdGeom.GetStageUpAxis(self._stage))
        self.up = {"Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}[axis]

    def _error(self, problem: str, prim: Any = None, fix: str = "") -> StudioError:
        at = "" if prim is None else f"{prim.GetPath()}: "
        return StudioError("usd.unsupported", f"{at}{problem}", file=self.path, fix=fix)

    def _time_codes(self) -> list[float]:
        """Time codes at which splats, their transforms or their visibility change."""
        codes: set[float] = set()
        for prim in self._prims:
            for attribute in prim.GetAttributes():
                codes |= set(attribute.GetTimeSamples())
            while not prim.IsPseudoRoot():
                codes |= set(self._pxr.UsdGeom.Xformable(prim).GetTimeSamples())
                codes |= set(self._pxr.UsdGeom.Imageable(prim).GetVisibilityAttr().GetTimeSamples())
                prim = prim.GetParent()
        return sorted(codes) if codes else [self._stage.GetStartTimeCode()]

    def _visible(self, time: float) -> list[Any]:
        geometry = self._pxr.UsdGeom
        return [
            prim
            for prim in self._prims
            if geometry.Imageable(prim).ComputeVisibility(time) != geometry.Tokens.invisible
            and len(self._array(prim, "positions", time))
        ]

    def size(self, time: float) -> tuple[int, int]:
        """Number of splats and SH degree at one of `times`."""
        shown = self._visible(time)
        count = sum(len(self._array(prim, "positions", time)) for prim in shown)
        return count, max(self._degree(prim) for prim in shown)

    def read(self, time: float, note: Note = ignore) -> Gaussians:
        """The splats that are visible at one of `times`, float64 if they were moved; `note` takes what was ignored."""
        for text in self.notes:
            note(text)
        parts = [self._splats(prim, time) for prim in self._visible(time)]
        degree = max(part.sh_degree for part in parts)
        return parts[0] if len(parts) == 1 else Gaussians.cat(*(part.with_sh_degree(degree) for part in parts))

    def _array(self, prim: Any, name: str, time: float) -> np.ndarray:
        """The float array of an attribute; the half array, if only that has values."""
        for kind in (name, f"{name}h"):
            values = prim.GetAttribute(kind).Get(time)
            if values is not None and len(values):
                return np.array(values, np.float32)
        if name == "positions":
            return np.zeros((0, 3), np.float32)
        raise self._error(f"{name} has no values at time code {time:g}", prim)

    def _degree(self, prim: Any) -> int:
        degree: int = prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get()
        if degree not in range(4):
            raise self._error(f"its spherical harmonics have degree {degree}; 0 to 3 are supported", prim)
        return degree

    def _splats(self, prim: Any, time: float) -> Gaussians:
        means = self._array(prim, "positions", time)
        degree = self._degree(prim)
        coefficients = (degree + 1) ** 2
        quats = self._array(prim, "orientations", time)[:, [3, 0, 1, 2]]
        sh = self._array(prim, _SH, time)
        counts = {
            "orientations": (len(quats), len(means)),
            "scales": (len(scales := self._array(prim, "scales", time)), len(means)),
            "opacities": (len(opacities := self._array(prim, "opacities", time)), len(means)),
            _SH: (len(sh), coefficients * len(means)),
        }
        for name, (count, expected) in counts.items():
            if count != expected:
                raise self._error(f"{name} has {count} values; {len(means)} positions need {expected}", prim)
        with np.errstate(divide="ignore", invalid="ignore"):
            logits, logs = np.log(opacities) - np.log1p(-opacities), np.log(scales)
        splats = Gaussians(
            means=torch.from_numpy(means),
            quats=torch.from_numpy(np.ascontiguousarray(quats)),
            log_scales=torch.from_numpy(logs),
            logit_opacities=torch.from_numpy(np.clip(logits, -30, 30)),  # opaque and transparent ones; NaN stays
            sh=torch.from_numpy(sh.reshape(-1, coefficients, 3)),
        )
        return self._in_world(prim, time, splats)

    def _in_world(self, prim: Any, time: float, splats: Gaussians) -> Gaussians:
        matrix = np.array(self._pxr.UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time)).T
        if np.array_equal(matrix, np.eye(4)):
            return splats
        linear = matrix[:3, :3]
        scale = abs(np.linalg.det(linear)) ** (1 / 3)
        if scale == 0 or not np.allclose(linear @ linear.T, scale**2 * np.eye(3), atol=1e-5 * scale**2):
            raise self._error(
                "its transform stretches or shears; splats can be moved, rotated and scaled evenly",
                prim,
                "Apply the transform to the splats, or make its scale the same on all axes.",
            )
        placed = scaled(turned(splats, linear / scale), scale) if not np.array_equal(linear, np.eye(3)) else splats
        if not matrix[:3, 3].any():
            return placed
        return replace(placed.to(torch.float64), means=placed.means.double() + torch.from_numpy(matrix[:3, 3]))


def _unknown(prim: Any) -> list[str]:
    """Names of the attributes with values that are neither of its schemas nor a transform."""
    known = set(prim.GetPrimDefinition().GetPropertyNames())
    names = [attribute.GetName() for attribute in prim.GetAuthoredAttributes()]
    return [name for name in names if name not in known and not name.startswith("xformOp:")]
