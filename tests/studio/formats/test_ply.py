"""3DGS PLY: our files read by Open3D and byte by byte, and files of other programs read by us."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
import torch

from tests.studio.formats.conftest import MakeSplats
from tests.support.errors import refuses
from v3studio.studio.formats import FRAME_FILES, read_splats, splats_size, write_splats


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_round_trip_is_exact(tmp_path: Path, make_splats: MakeSplats, degree: int) -> None:
    splats = make_splats(degree=degree)
    path = tmp_path / "frame_0000.ply"
    write_splats(splats, path)
    assert splats_size(path) == (300, degree)
    splats_read = read_splats(path)
    for (name, mine), (_, theirs) in zip(splats.items(), splats_read.items(), strict=True):
        if name == "quats":
            assert torch.allclose(mine, theirs, atol=2e-7)
        else:
            assert torch.equal(mine, theirs), name


def test_the_head_and_the_order_are_those_of_3dgs(tmp_path: Path, make_splats: MakeSplats) -> None:
    """Parsed by hand: the property list of the released trainer, little-endian floats, SH by channel."""
    splats = make_splats(5, degree=1)
    path = tmp_path / "a.ply"
    write_splats(splats, path)
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    assert lines[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 5"]
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(9))]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert lines[3:] == [f"property float {name}" for name in names]
    assert len(body) == 5 * 4 * len(names)
    third = dict(zip(names, struct.unpack_from(f"<{len(names)}f", body, 2 * 4 * len(names)), strict=True))
    assert third["y"] == splats.means[2, 1]
    assert third["nx"] == 0
    assert third["f_dc_2"] == splats.sh[2, 0, 2]
    assert [third[f"f_rest_{i}"] for i in range(9)] == [splats.sh[2, 1 + i % 3, i // 3] for i in range(9)]
    assert third["opacity"] == splats.logit_opacities[2]
    assert third["scale_1"] == splats.log_scales[2, 1]
    assert third["rot_0"] == pytest.approx(splats.quats[2, 0].item())


def test_open3d_reads_it(tmp_path: Path, make_splats: MakeSplats) -> None:
    splats = make_splats(degree=2)
    write_splats(splats, tmp_path / "a.ply")
    cloud = o3d.t.io.read_point_cloud(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(cloud.point.positions.numpy(), splats.means.numpy())
    # activated, unlike opacity
    np.testing.assert_allclose(cloud.point["scale"].numpy(), splats.scales.numpy(), rtol=1e-6)
    np.testing.assert_array_equal(cloud.point["opacity"].numpy()[:, 0], splats.logit_opacities.numpy())
    np.testing.assert_array_equal(cloud.point["f_dc"].numpy(), splats.sh[:, 0].numpy())
    np.testing.assert_array_equal(cloud.point["f_rest"].numpy(), splats.sh[:, 1:].numpy())
    np.testing.assert_allclose(cloud.point["rot"].numpy(), splats.quats.numpy(), atol=2e-7)


def test_other_programs_files(tmp_path: Path) -> None:
    """ASCII, doubles, another order, extra properties, no normals; an opacity of exactly 1 is an infinite logit."""
    names = ["opacity", "z", "y", "x", "temperature", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += ["rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2"]
    head = ["ply", "format ascii 1.0", "comment made elsewhere", "element vertex 2"]
    head += [f"property double {name}" for name in names]
    rows = ["inf 3 2 1 99 .1 .2 .3 2 0 0 0 -1 -2 -3", "-inf 6 5 4 99 .1 .2 .3 0 0 0 -3 -1 -2 -3"]
    path = tmp_path / "a.ply"
    path.write_text("\n".join([*head, "end_header", *rows]) + "\n")
    splats = read_splats(path)
    assert splats.means.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert splats.log_scales[0].tolist() == [-1, -2, -3]
    assert splats.quats.tolist() == [[2, 0, 0, 0], [0, 0, 0, -3]]
    assert torch.allclose(splats.opacities, torch.tensor([1.0, 0.0]), atol=2e-6)


def write_raw(path, replaced=("", ""), body=None, count=2):
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
    names += ["rot_0", "rot_1", "rot_2", "rot_3"]
    rows = np.zeros((2, len(names)), "<f4")
    rows[:, names.index("rot_0")] = 1
    head = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {count}\n"
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    path.write_bytes(head.replace(*replaced, 1).encode() + (rows.tobytes() if body is None else body))


def test_damage_and_other_things_than_splats(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    write_raw(path)
    assert len(read_splats(path)) == 2
    cases = [
        ({"replaced": ("ply", "nonsense")}, "unreadable", {}),
        ({"replaced": ("float opacity", "float color")}, "not_splats", {"missing": "opacity"}),
        ({"replaced": ("vertex", "point")}, "not_splats", {"missing": "vertex"}),
        ({"body": bytes(40)}, "unreadable", {}),
        ({"count": 10**12}, "unreadable", {}),
        ({"count": 0}, "splat_count", {"value": 0}),
        ({"replaced": ("float z\n", "float z\nproperty float f_rest_0\n"), "body": bytes(120)}, "sh_properties",
         {"value": 1}),
    ]  # fmt: skip
    for arguments, code, fields in cases:
        write_raw(path, **arguments)
        with refuses(f"splat_file.{code}", file=path, **fields):
            read_splats(path)
    with refuses("splat_file.not_found", file=tmp_path / "none.ply"):
        read_splats(tmp_path / "none.ply")
    with refuses("splat_file.unsupported_format", value=".obj", expected=[".ply", ".spz", ".sog", ".splat"]):
        read_splats(tmp_path / "a.obj")


def test_what_cannot_be_written(tmp_path: Path, make_splats: MakeSplats) -> None:
    splats = make_splats(3)
    broken = replace(splats, means=splats.means * torch.nan)
    flat = replace(splats, quats=splats.quats * torch.tensor([[1.0], [0.0], [1.0]]))
    for wrong, code, fields in (
        (splats[:0], "splat_file.no_splats", {}),
        (broken, "gaussians.not_finite", {"attribute": "means"}),
        (flat, "gaussians.zero_quaternion", {"splat": 1}),
    ):
        for ending in ("ply", "spz", "glb"):
            with refuses(code, file=tmp_path / f"a.{ending}", **fields):
                write_splats(wrong, tmp_path / f"a.{ending}")
    assert list(tmp_path.iterdir()) == []
    written = [suffix for suffix, kind in FRAME_FILES.items() if kind.written]
    with refuses("splat_file.unsupported_format", value=".txt", expected=written):
        write_splats(splats, tmp_path / "a.txt")
