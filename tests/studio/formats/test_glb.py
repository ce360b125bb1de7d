"""GLB files, parsed byte by byte as specified by glTF 2.0 and KHR_gaussian_splatting."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from tests.studio.formats.conftest import MakeSplats
from v3studio.studio.formats import write_splats

TYPES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
COMPONENTS = {5121: np.dtype("u1"), 5126: np.dtype("<f4")}


def read_glb(data: bytes):
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert (kind, size % 4) == (b"JSON", 0)
    content = json.loads(data[20 : 20 + size])
    binary_size, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0"
    binary = data[28 + size :]
    assert len(binary) == binary_size == content["buffers"][0]["byteLength"]
    (mesh,) = content["meshes"]
    (primitive,) = mesh["primitives"]
    arrays = {}
    covered = 0
    for name, index in primitive["attributes"].items():
        accessor = content["accessors"][index]
        view = content["bufferViews"][accessor["bufferView"]]
        columns, dtype = TYPES[accessor["type"]], COMPONENTS[accessor["componentType"]]
        assert view["byteOffset"] % 4 == 0
        assert view["byteLength"] == accessor["count"] * columns * dtype.itemsize
        values = np.frombuffer(binary, dtype, accessor["count"] * columns, view["byteOffset"])
        arrays[name] = values.reshape(-1, columns)
        covered += view["byteLength"]
    assert covered == len(binary)
    return content, primitive, arrays


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_against_the_specification(tmp_path: Path, make_splats: MakeSplats, degree: int) -> None:
    splats = make_splats(77, degree)
    write_splats(splats, tmp_path / "a.glb")
    content, primitive, arrays = read_glb((tmp_path / "a.glb").read_bytes())
    assert content["asset"]["version"] == "2.0"
    assert content["extensionsUsed"] == ["KHR_gaussian_splatting"]
    assert content["scenes"][content["scene"]]["nodes"] == [0]
    assert (content["nodes"][0]["mesh"], primitive["mode"]) == (0, 0)
    extension = primitive["extensions"]["KHR_gaussian_splatting"]
    assert (extension["kernel"], extension["colorSpace"]) == ("ellipse", "srgb_rec709_display")
    prefix = "KHR_gaussian_splatting:"
    np.testing.assert_array_equal(arrays["POSITION"], splats.means)
    accessor = content["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_array_equal(np.float32(accessor["min"]), splats.means.min(0).values)
    np.testing.assert_array_equal(np.float32(accessor["max"]), splats.means.max(0).values)
    rotation = arrays[prefix + "ROTATION"]
    np.testing.assert_allclose(rotation, splats.quats[:, [1, 2, 3, 0]], atol=2e-7)
    np.testing.assert_allclose(np.linalg.norm(rotation, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(arrays[prefix + "SCALE"], splats.scales, rtol=1e-6)
    np.testing.assert_allclose(arrays[prefix + "OPACITY"][:, 0], splats.opacities, rtol=1e-6)
    coefficients = [(level, order) for level in range(degree + 1) for order in range(2 * level + 1)]
    for index, (level, order) in enumerate(coefficients):
        np.testing.assert_array_equal(arrays[f"{prefix}SH_DEGREE_{level}_COEF_{order}"], splats.sh[:, index])
    assert len(arrays) == 5 + len(coefficients)
    assert content["accessors"][primitive["attributes"]["COLOR_0"]]["normalized"] is True
    color = 0.5 + 0.28209479 * splats.sh[:, 0].numpy()
    np.testing.assert_allclose(arrays["COLOR_0"][:, :3] / 255, color.clip(0, 1), atol=0.5 / 255 + 1e-6)
