"""3DGS PLY files (Kerbl et al. 2023, `save_ply`), which nearly all splat tools read.

One element `vertex` of float32 properties, little endian: x y z, nx ny nz (zeros), f_dc_0..2, f_rest_0.. (all
coefficients of red, then of green, then of blue), opacity (logit), scale_0..2 (logarithm), rot_0..3 (wxyz).
Compressed PLY has the same extension and is recognized by its elements; see `compressed_ply`.
Properties of other kinds of splats are those of the writers of Mip-Splatting, 2DGS, Spacetime Gaussians, 4D Gaussians,
Scaffold-GS, Deformable Beta Splatting and GES.
"""

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement, PlyListProperty, PlyParseError

from v3studio.studio.errors import StudioError
from v3studio.studio.formats.checks import LEAST_SCALE, Note, check_count, from_arrays, logits, to_arrays
from v3studio.studio.formats.compressed_ply import compressed_size, is_compressed, read_compressed, sh_degree
from v3studio.studio.gaussians import Gaussians

_HEADER_BYTES = 1 << 20
_SEVERAL = 100  # splats: of fewer, all values may be in a narrow range
_NEEDED = (
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3"),
)
_THIRD_SCALE = "scale_2"  # missing in files of 2DGS, whose splats are flat
_FILTER = "filter_3D"  # Mip-Splatting: standard deviation of the filter in space, merged into scales and opacities
_KNOWN = re.compile(r"f_rest_\d+|packed_(position|rotation|scale|color)")
_HARMLESS = re.compile(r"n[xyz]{1,2}|red|green|blue|alpha")  # normals, and colors for viewers of points
_CONVERT = "Export them as 3D Gaussians, if the program can."
_OTHERS = {
    "motion, or a time of their own": (
        r"(motion|omega|trbf|velocity|vel|rot_r|f_t|time|lifespan|duration)(_.*)?|t|scale_t|v_?[xyz]",
        "Export each moment as a PLY file of its own.",
    ),
    "anchors of a network": (r"f_offset.*|f_anchor.*", _CONVERT),
    "another model of color": (r"(sg|asg|f_asg|sb|beta)(_.*)?", _CONVERT),
    "another profile than a Gaussian": (r"(shape|nu|kernel|sharpness|gamma|negative)(_.*)?", _CONVERT),
    "more values of shape, opacity or color": (r"(scale|scaling|rot|rotation|quat|f_dc|opacity|filter).*", _CONVERT),
}


def write(path: Path, gaussians: Gaussians, offset: np.ndarray | None = None) -> None:
    """Write a 3DGS PLY file of float32. `offset`, (3,) float64, is added to the positions, which are then doubles: far
    from zero, float32 has not enough digits."""
    arrays = to_arrays(path, gaussians)
    count = len(gaussians)
    rest = arrays["sh"][:, 1:].transpose(0, 2, 1).reshape(count, -1)
    columns = {
        **_columns("", "xyz", arrays["means"] if offset is None else arrays["means"] + offset),
        **_columns("n", "xyz", np.zeros((count, 3), np.float32)),
        **_columns("f_dc_", range(3), arrays["sh"][:, 0]),
        **_columns("f_rest_", range(rest.shape[1]), rest),
        "opacity": arrays["logit_opacities"],
        **_columns("scale_", range(3), arrays["log_scales"]),
        **_columns("rot_", range(4), arrays["quats"]),
    }
    vertices = np.empty(count, dtype=[(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
    for name, values in columns.items():
        vertices[name] = values
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(path))


def _columns(prefix: str, names: str | range, values: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{prefix}{name}": values[:, column] for column, name in enumerate(names)}


def size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree from the header. Raises StudioError as `read`, except for invalid values."""
    ply = _opened(path)
    if is_compressed(ply):
        return compressed_size(path, ply)
    element = _vertices(path, ply, lambda note: None)
    return element.count, sh_degree(path, element)


def said_up(path: Path) -> tuple[float, float, float] | None:
    """Direction that points up, if a comment says so: `Vertical Axis: z` (Nerfstudio), or `Vertical axis: 0 1 0`. A
    plain y is not one: Brush writes it into files with y down."""
    for comment in _opened(path).comments:
        said = re.match(r"\s*(?:vertical|up)[ _-]?axis\s*[:=]?\s*(.*)", comment, re.IGNORECASE)
        if said is None:
            continue
        axis = re.match(r"([+-]?)([xyz])\b", said[1], re.IGNORECASE)
        if axis is not None and (axis[1] or axis[2].lower() != "y"):
            sign = -1.0 if axis[1] == "-" else 1.0
            x, y, z = (sign if letter == axis[2].lower() else 0.0 for letter in "xyz")
            return x, y, z
        numbers = re.findall(r"[-+]?\d+(?:\.\d*)?", said[1])
        if axis is None and len(numbers) == 3 and any(float(number) for number in numbers):
            x, y, z = map(float, numbers)
            length = (x * x + y * y + z * z) ** 0.5
            return x / length, y / length, z / length
    return None


def read(path: Path, note: Note) -> Gaussians:
    """Read a 3DGS PLY file or a compressed PLY file; `note` takes ignored elements and properties. The filter of
    Mip-Splatting is merged into scales and opacities; splats with two scales (2DGS) become flat."""
    ply = _opened(path)
    others = [element.name for element in ply.elements if element.name not in ("vertex", "chunk", "sh")]
    if others:
        note(f"elements that splats do not have are ignored: {', '.join(others)}")
    if is_compressed(ply):
        _check_properties(path, [prop.name for prop in ply["vertex"].properties], note)
        return read_compressed(path, ply)
    element = _vertices(path, ply, note)
    names = [prop.name for prop in element.properties]
    degree = sh_degree(path, element)
    rest = (degree + 1) ** 2 - 1
    data = element.data

    def stacked(names: list[str]) -> np.ndarray:
        return np.stack([np.asarray(data[name], np.float32) for name in names], axis=-1)

    sh = np.empty((element.count, rest + 1, 3), np.float32)
    sh[:, 0] = stacked(["f_dc_0", "f_dc_1", "f_dc_2"])
    if rest:
        channels = stacked([f"f_rest_{index}" for index in range(3 * rest)]).reshape(element.count, 3, rest)
        sh[:, 1:] = channels.transpose(0, 2, 1)
    log_scales = stacked([name for name in ("scale_0", "scale_1", _THIRD_SCALE) if name in names])
    if _THIRD_SCALE not in names:
        note("two scales a splat, as in 2DGS: the splats are flat")
        log_scales = np.pad(log_scales, ((0, 0), (0, 1)), constant_values=np.log(LEAST_SCALE))
    opacities = np.asarray(data["opacity"], np.float32)
    if len(log_scales) >= _SEVERAL and log_scales.min() > 0:
        note("all scales are above one unit, as if they were not stored as logarithms")
    if len(opacities) >= _SEVERAL and opacities.min() >= 0 and opacities.max() <= 1:
        note("all opacities are from 0 to 1, as if they were not stored as logits")
    if _FILTER in names:
        note(f"{_FILTER} of Mip-Splatting is merged into scales and opacities")
        log_scales, opacities = _filtered(log_scales, opacities, np.asarray(data[_FILTER], np.float64))
    doubles = any(np.asarray(data[name]).dtype.itemsize > 4 for name in "xyz")
    return from_arrays(
        {
            "means": np.stack([np.asarray(data[name], np.float64) for name in "xyz"], axis=-1),
            "quats": stacked([f"rot_{index}" for index in range(4)]),
            "log_scales": log_scales,
            "logit_opacities": opacities,
            "sh": sh,
        },
        np.float64 if doubles else np.float32,
    )


def _filtered(log_scales: np.ndarray, opacities: np.ndarray, filters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log scales and logits of splats convolved with Gaussians (Yu et al. 2024, Mip-Splatting, section 5.1)."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        before = np.exp(2 * log_scales.astype(np.float64))
        after = before + filters[:, None] ** 2
        opaque = 1 / (1 + np.exp(-opacities.astype(np.float64)))
        return np.log(after) / 2, logits(opaque * np.sqrt((before / after).prod(axis=1)))


def _opened(path: Path) -> PlyData:
    """The file, mapped into memory if it is binary."""
    try:
        with path.open("rb") as file:
            if re.search(rb"[\r\n]end_header[\r\n]", file.read(_HEADER_BYTES)) is None:
                raise ValueError(f"no end of the header in the first {_HEADER_BYTES:,} bytes")  # plyfile would go on
        return PlyData.read(str(path), mmap="r")
    except FileNotFoundError:
        raise StudioError("splat_file.not_found", "no such file", file=path) from None
    except (PlyParseError, OSError, ValueError, MemoryError, OverflowError) as error:
        problem = f"not a readable PLY file ({error})"
        raise StudioError("splat_file.unreadable", problem, file=path, fix="Export or copy it again.") from None


def _vertices(path: Path, ply: PlyData, note: Note) -> PlyElement:
    """The element with the splats, with validated properties."""
    if "vertex" not in [element.name for element in ply.elements]:
        problem = "the PLY file has no element 'vertex'"
        fix = "Choose a file with splats."
        raise StudioError("splat_file.not_splats", problem, file=path, fix=fix, missing="vertex")
    element = ply["vertex"]
    _check_properties(path, [prop.name for prop in element.properties], note)
    scalar = {prop.name for prop in element.properties if not isinstance(prop, PlyListProperty)}
    missing = [name for name in _NEEDED if name not in scalar]
    if missing:
        problem = f"the PLY file has no property '{missing[0]}', so it does not contain plain 3D splats"
        fix = "Choose a file written by 3DGS or a compatible tool."
        raise StudioError("splat_file.not_splats", problem, file=path, fix=fix, missing=missing[0])
    whole = [prop.name for prop in element.properties if prop.name in _NEEDED and prop.dtype()[-2] in "iu"]
    if whole:
        problem = f"the property '{whole[0]}' has integers, so it is not that of 3D splats"
        fix = "Export the file again as a PLY of 3D Gaussians."
        raise StudioError("splat_file.integers", problem, file=path, value=whole[0], fix=fix)
    check_count(path, element.count)
    return element


def _check_properties(path: Path, names: Iterable[str], note: Note) -> None:
    """Refuse properties that change what the others mean, and note those that are ignored."""
    unknown = [
        name
        for name in names
        if name not in (*_NEEDED, _THIRD_SCALE, _FILTER)
        and not _KNOWN.fullmatch(name)
        and not _HARMLESS.fullmatch(name)
    ]
    for what, (pattern, fix) in _OTHERS.items():
        matching = [name for name in unknown if re.fullmatch(pattern, name)]
        if matching:
            problem = f"its splats have {what} ({', '.join(matching)}), which would be lost"
            raise StudioError("splat_file.other_splats", problem, file=path, value=matching, fix=fix)
    if unknown:
        note(f"properties that Gaussians do not have are ignored: {', '.join(unknown)}")
