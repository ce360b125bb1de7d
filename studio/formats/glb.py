"""GLB (binary glTF 2.0) with the ratified extension KHR_gaussian_splatting, uncompressed.

Sources: specifications of glTF 2.0 and KHR_gaussian_splatting. A splat is a point with rotation (xyzw), linear scale,
opacity from 0 to 1, and SH with one accessor per coefficient. COLOR_0 is for viewers that only draw points.
"""

import json
import math
import struct
from pathlib import Path

import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.formats.checks import to_arrays
from v3studio.studio.gaussians import SH_C0, Gaussians
from v3studio.studio.json_types import JsonObject

NAME = "KHR_gaussian_splatting"
_FLOAT, _BYTE = 5126, 5121  # glTF component types
_ARRAY_BUFFER = 34962
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def write(path: Path, gaussians: Gaussians, offset: np.ndarray | None = None) -> None:
    """Write a GLB file with one node, mesh and primitive; `offset`, (3,) float64: translation of the node."""
    arrays = to_arrays(path, gaussians)
    opacities = 1 / (1 + np.exp(-arrays["logit_opacities"].astype(np.float64)))
    sh = arrays["sh"]
    rgba = np.concatenate([SH_C0 * sh[:, 0] + 0.5, opacities[:, None]], axis=1)
    attributes: dict[str, np.ndarray] = {
        "POSITION": arrays["means"],
        "COLOR_0": np.rint(np.clip(rgba, 0, 1) * 255).astype(np.uint8),
        f"{NAME}:ROTATION": arrays["quats"][:, [1, 2, 3, 0]],
        f"{NAME}:SCALE": np.exp(arrays["log_scales"]),
        f"{NAME}:OPACITY": opacities[:, None].astype(np.float32),
    }
    for index in range(sh.shape[1]):
        degree = math.isqrt(index)
        attributes[f"{NAME}:SH_DEGREE_{degree}_COEF_{index - degree**2}"] = sh[:, index]

    views: list[JsonObject] = []
    accessors: list[JsonObject] = []
    chunks: list[bytes] = []
    length = 0
    for name, values in attributes.items():
        data = np.ascontiguousarray(values).tobytes()  # lengths are already multiples of 4
        views.append({"buffer": 0, "byteOffset": length, "byteLength": len(data), "target": _ARRAY_BUFFER})
        accessor: JsonObject = {
            "bufferView": len(accessors),
            "componentType": _BYTE if values.dtype == np.uint8 else _FLOAT,
            "count": len(values),
            "type": _TYPES[values.shape[1]],
        }
        if values.dtype == np.uint8:
            accessor["normalized"] = True
        if name == "POSITION":
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        accessors.append(accessor)
        chunks.append(data)
        length += len(data)
    extension = {
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    }
    primitive = {
        "attributes": {name: index for index, name in enumerate(attributes)},
        "mode": 0,
        "extensions": {NAME: extension},
    }
    content = {
        "asset": {"version": "2.0", "generator": "V3 Studio"},
        "extensionsUsed": [NAME],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0} if offset is None else {"mesh": 0, "translation": offset.tolist()}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": length}],
    }
    head = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
    head += b" " * (-len(head) % 4)
    total = 12 + 8 + len(head) + 8 + length
    if total >= 1 << 32:
        problem = f"{len(gaussians)} splats need {total} bytes; a GLB file is limited to 2^32 - 1"
        raise StudioError("splat_file.too_large", problem, file=path, value=total)
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, total))
        file.write(struct.pack("<I4s", len(head), b"JSON") + head)
        file.write(struct.pack("<I4s", length, b"BIN\0"))
        for chunk in chunks:
            file.write(chunk)
