"""`.splat`, the flat file of the first web viewers of splats: read only.

Source: github.com/antimatter15/splat (MIT), `convert.py`. 32 bytes per splat and nothing else: position and linear
scale (three float32 each), color and opacity (RGBA, 8 bits each), rotation (wxyz, 8 bits each, 128 is 0). No higher
harmonics. Axes are those of PLY files.
"""

from pathlib import Path

import numpy as np

from v3studio.studio.formats import checks
from v3studio.studio.gaussians import SH_C0, Gaussians

_SPLAT = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("quat", "u1", 4)])


def size(path: Path) -> tuple[int, int]:
    """Number of splats, and 0 for the SH degree. Raises StudioError as `read`, except for invalid values."""
    with checks.opening(path):
        return _count(path, path.stat().st_size), 0


def read(path: Path, note: checks.Note) -> Gaussians:
    data = checks.read_bytes(path)
    _count(path, len(data))
    splats = np.frombuffer(data, _SPLAT)
    return checks.from_arrays(
        {
            "means": splats["mean"],
            "quats": (splats["quat"].astype(np.float32) - 128) / 128,
            "log_scales": checks.log_scales(splats["scale"].astype(np.float64)),
            "logit_opacities": checks.logits(splats["rgba"][:, 3] / 255),
            "sh": ((splats["rgba"][:, :3] / 255 - 0.5) / SH_C0)[:, None],
        }
    )


def _count(path: Path, size: int) -> int:
    count, left = divmod(size, _SPLAT.itemsize)
    if left:
        raise checks.damaged(
            "splat_file.unreadable", f"{size} bytes is not a multiple of {_SPLAT.itemsize}, the size of a splat", path
        )
    checks.check_count(path, count)
    return count
