"""What the properties of a PLY file mean: those of splats, harmless ones, and those that other kinds of splats need.

Sources: the writers of 3DGS, Mip-Splatting, 2DGS, Spacetime Gaussians, 4D Gaussians, Scaffold-GS, Deformable Beta
Splatting and GES (their `save_ply`).
"""

import re
from collections.abc import Iterable
from pathlib import Path

from studio.errors import StudioError
from studio.formats.checks import Note

NEEDED = (
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3"),
)
THIRD_SCALE = "scale_2"  # missing in files of 2DGS, whose splats are flat
FILTER = "filter_3D"  # Mip-Splatting: standard deviation of the filter in space, to be merged into scales and opacities

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


def check_properties(path: Path, names: Iterable[str], note: Note) -> None:
    """Refuse properties that change what the others mean, and note those that are ignored."""
    unknown = [
        name
        for name in names
        if name not in (*NEEDED, THIRD_SCALE, FILTER) and not _KNOWN.fullmatch(name) and not _HARMLESS.fullmatch(name)
    ]
    for what, (pattern, fix) in _OTHERS.items():
        found = [name for name in unknown if re.fullmatch(pattern, name)]
        if found:
            problem = f"its splats have {what} ({', '.join(found)}), which would be lost"
            raise StudioError("splat_file.other_splats", problem, file=path, value=found, fix=fix)
    if unknown:
        note(f"properties that Gaussians do not have are ignored: {', '.join(unknown)}")


def said_up(comments: Iterable[str]) -> tuple[float, float, float] | None:
    """The direction in a comment such as `Vertical Axis: z` (Nerfstudio) or `Vertical axis: 0 1 0`.

    A plain y is not one: Brush writes it into files with y down.
    """
    for comment in comments:
        found = re.match(r"\s*(?:vertical|up)[ _-]?axis\s*[:=]?\s*(.*)", comment, re.IGNORECASE)
        if found is None:
            continue
        axis = re.match(r"([+-]?)([xyz])\b", found[1], re.IGNORECASE)
        if axis is not None and (axis[1] or axis[2].lower() != "y"):
            sign = -1.0 if axis[1] == "-" else 1.0
            x, y, z = (sign if letter == axis[2].lower() else 0.0 for letter in "xyz")
            return x, y, z
        numbers = re.findall(r"[-+]?\d+(?:\.\d*)?", found[1])
        if axis is None and len(numbers) == 3 and any(float(number) for number in numbers):
            x, y, z = map(float, numbers)
            length = (x * x + y * y + z * z) ** 0.5
            return x / length, y / length, z / length
    return None
