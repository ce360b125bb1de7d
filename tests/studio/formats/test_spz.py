"""SPZ: files from other programs, an independent reader, and errors within the format's steps."""

import gzip
import math
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.studio.formats.conftest import MakeSplats
from tests.studio.formats.test_damage import each_is_refused, with_record
from tests.support.errors import refuses
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import read_splats, splats_size, write_splats
from v3studio.studio.rasterizer.spherical_harmonics import sh_basis
from v3studio.studio.torch_rotations import quats_to_matrices

DATA = Path(__file__).parents[2] / "data" / "splats"


@pytest.mark.parametrize(
    ("name", "z", "dc", "quat"),
    [("minimal-raw", -1, 1.1111, 0.0039), ("minimal-v2", -1, 1.1111, 0.0039), ("minimal-v3", 1, 0.5882, 0.0)],
)
def test_files_of_other_programs(name: str, z: int, dc: float, quat: float) -> None:
    """Values as read by splat-transform 3.7 (which flips y and z to PLY axes; here they are as in the file)."""
    assert splats_size(DATA / f"{name}.spz") == (4, 0)
    splats = read_splats(DATA / f"{name}.spz")
    assert splats.means.tolist() == [[-1, 0, z], [0, 0, z], [-1, 0, 0], [0, 0, 0]]
    assert torch.allclose(splats.scales, torch.tensor(0.0990), atol=1e-4)
    assert torch.allclose(splats.opacities, torch.tensor(0.9020), atol=1e-4)
    assert torch.allclose(splats.quats, torch.tensor([1, quat, quat, quat]), atol=1e-4)
    signs = torch.tensor([[-1, -1], [1, -1], [-1, 1], [1, 1]])
    assert torch.allclose(splats.sh[:, 0, :2], dc * signs, atol=1e-4)
    assert torch.allclose(splats.sh[:, 0, 2], torch.tensor(0.0131), atol=1e-4)


def unpacked(data: bytes, version: int) -> bytes:
    """The 16 bytes of the header that all versions share, and the attributes one after the other."""
    if version == 3:
        return gzip.decompress(data)
    streams, table = data[15], struct.unpack_from("<I", data, 16)[0]
    assert (data[14], table, data[20:32]) == (0, 32, bytes(12))  # no extensions, nothing in the reserved bytes
    entries = [struct.unpack_from("<QQ", data, table + 16 * index) for index in range(streams)]
    position, body = table + 16 * streams, b""
    for stored, size in entries:
        body += zstandard.ZstdDecompressor().decompress(data[position : position + stored])
        position += stored
        assert size > 0
    assert position == len(data)
    assert len(body) == sum(size for _, size in entries)
    return data[:15] + bytes(1) + body


def by_the_description(data: bytes, expected_version: int) -> dict[str, np.ndarray]:
    """Splat by splat, as in the README of the format."""
    data = unpacked(data, expected_version)
    magic, version, count, degree, bits, flags, reserved = struct.unpack_from("<IIIBBBB", data)
    assert (magic, version, flags, reserved) == (0x5053474E, expected_version, 0, 0)
    rest = (degree + 1) ** 2 - 1
    starts = np.cumsum([16, 9 * count, count, 3 * count, 3 * count, 4 * count])
    assert len(data) == starts[-1] + 3 * rest * count
    out = {name: [] for name in ("means", "opacities", "dc", "log_scales", "quats", "sh")}
    for i in range(count):
        at = data[starts[0] + 9 * i :]
        out["means"].append([int.from_bytes(at[3 * k : 3 * k + 3], "little", signed=True) / 2**bits for k in range(3)])
        out["opacities"].append(data[starts[1] + i] / 255)
        out["dc"].append([(data[starts[2] + 3 * i + k] / 255 - 0.5) / 0.15 for k in range(3)])
        out["log_scales"].append([data[starts[3] + 3 * i + k] / 16 - 10 for k in range(3)])
        word = int.from_bytes(data[starts[4] + 4 * i :][:4], "little")
        largest = word >> 30
        xyzw, shift = [0.0] * 4, 20
        for k in range(4):
            if k != largest:
                part = word >> shift & 0x3FF
                xyzw[k] = (-1 if part & 512 else 1) * (part & 511) / 511 / math.sqrt(2)
                shift -= 10
        xyzw[largest] = math.sqrt(1 - sum(value * value for value in xyzw))
        out["quats"].append([xyzw[3], *xyzw[:3]])
        values = data[starts[5] + 3 * rest * i :][: 3 * rest]
        out["sh"].append([[(values[3 * k + c] - 128) / 128 for c in range(3)] for k in range(rest)])
    return {name: np.array(values) for name, values in out.items()}


@pytest.mark.parametrize("degree", [0, 1, 3])
@pytest.mark.parametrize("version", [3, 4])
def test_written_files_say_what_was_meant(tmp_path: Path, make_splats: MakeSplats, degree: int, version: int) -> None:
    splats = make_splats(120, degree)
    path = tmp_path / "a.spz"
    write_splats(splats, path, version=version)
    values = by_the_description(path.read_bytes(), version)
    np.testing.assert_allclose(values["means"], splats.means, atol=0.5 / 2**14 + 1e-7)
    np.testing.assert_allclose(values["opacities"], splats.opacities, atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(values["dc"], splats.sh[:, 0], atol=0.5 / 255 / 0.15 + 1e-6)
    np.testing.assert_allclose(values["log_scales"], splats.log_scales, atol=1 / 32 + 1e-6)
    theirs = Rotation.from_quat(values["quats"], scalar_first=True)
    turned = theirs.inv() * Rotation.from_quat(splats.quats.numpy(), scalar_first=True)
    assert np.degrees(turned.magnitude()).max() < 0.25
    if degree:
        np.testing.assert_allclose(values["sh"][:, :3], splats.sh[:, 1:4], atol=4.5 / 128 + 1e-6)
        np.testing.assert_allclose(values["sh"][:, 3:], splats.sh[:, 4:], atol=8.5 / 128 + 1e-6)
    assert splats_size(path) == (120, degree)
    mine = read_splats(path)
    for name in ("means", "quats", "opacities", "log_scales"):
        np.testing.assert_allclose(getattr(mine, name), values[name], atol=1e-6)
    np.testing.assert_allclose(mine.sh[:, 1:], values["sh"].reshape(120, -1, 3), atol=1e-6)


def test_version_4_is_the_default_and_2_is_not_written(tmp_path: Path, make_splats: MakeSplats) -> None:
    write_splats(make_splats(5), tmp_path / "a.spz")
    assert (tmp_path / "a.spz").read_bytes()[:5] == b"NGSP\x04"
    with refuses("splat_file.unsupported_version", file=tmp_path / "b.spz", value=2):
        write_splats(make_splats(5), tmp_path / "b.spz", version=2)


@pytest.mark.parametrize("size", [1e-4, 1.0, 300.0, 1e6])
def test_positions_of_any_size(tmp_path: Path, make_splats: MakeSplats, size: float) -> None:
    splats = make_splats(50)
    scaled = replace(splats, means=splats.means * size)
    write_splats(scaled, tmp_path / "a.spz")
    error = (read_splats(tmp_path / "a.spz").means - scaled.means).abs().max()
    farthest, extent = scaled.means.abs().max(), (scaled.means.max(0).values - scaled.means.min(0).values).max()
    step = max(min(extent / 2**16, 2**-12), 2**-20, 2 * farthest / 2**23)
    assert error <= 0.5 * step + 1e-7 * size


def test_too_far_out(tmp_path: Path, make_splats: MakeSplats) -> None:
    splats = make_splats(5)
    far = replace(splats, means=splats.means + 1e8)
    with refuses("splat_file.position_range", file=tmp_path / "a.spz"):
        write_splats(far, tmp_path / "a.spz")


def test_damage(tmp_path: Path, make_splats: MakeSplats) -> None:
    path = tmp_path / "a.spz"
    write_splats(make_splats(64), path, version=3)
    good = path.read_bytes()
    plain = gzip.decompress(good)

    def with_head(**changes) -> bytes:
        names = ("magic", "version", "count", "degree", "bits", "flags", "reserved")
        values = dict(zip(names, struct.unpack_from("<IIIBBBB", plain), strict=True))
        return gzip.compress(struct.pack("<IIIBBBB", *{**values, **changes}.values()) + plain[16:])

    cases = [
        (good[:-200], "truncated"),
        (good[:10] + b"\xff" + good[11:], "unreadable"),  # a block type that deflate does not have
        (b"", "unreadable"),
        (b"hello, this is text", "unreadable"),
        (with_head(version=5), "unsupported_version"),
        (with_head(version=4), "unreadable"),  # version 4 is not gzipped as a whole
        (with_head(count=65), "truncated"),
        (with_head(count=0), "invalid_header"),
        (with_head(count=4_000_000_000), "invalid_header"),
        (with_head(degree=4), "invalid_header"),
        (with_head(count=1 << 26), "expansion"),
    ]
    each_is_refused(path, cases)


LETTERS = {"R": (1, 0, 0), "L": (-1, 0, 0), "U": (0, 1, 0), "D": (0, -1, 0), "B": (0, 0, 1), "F": (0, 0, -1)}


@pytest.mark.parametrize(
    ("number", "axes"),
    [(0, "RUB"), (4, "RUB"), (1, "LDB"), (6, "RDF"), (7, "LUF"), (8, "RUF"), (9, "LFD"), (12, "RFU"), (16, "RBU")],
)
def test_other_axes_are_turned_to_the_formats(tmp_path: Path, make_splats: MakeSplats, number: int, axes: str) -> None:
    """Positions, covariances and colors of the record's axes, against the letters of its name."""
    splats = make_splats(degree=3)
    path = tmp_path / "a.spz"
    write_splats(splats, path)
    plain = read_splats(path)
    path.write_bytes(with_record(path.read_bytes(), 0xADBE0003, struct.pack("<I", number)))
    notes = []
    turned = read_splats(path, notes.append)
    matrix = torch.tensor([LETTERS[letter] for letter in axes], dtype=torch.float32).T
    torch.testing.assert_close(turned.means, plain.means @ matrix.T)
    axes_of = [quats_to_matrices(one.unit_quats) * one.scales[:, None] for one in (plain, turned)]
    before, after = (one @ one.mT for one in axes_of)
    torch.testing.assert_close(after, matrix @ before @ matrix.T, atol=1e-5, rtol=1e-3)
    direction = torch.nn.functional.normalize(torch.tensor([[0.3, -0.5, 0.8]]), dim=1)
    seen = [torch.einsum("k,nkc->nc", sh_basis(direction @ turn.T, 3)[0], one.sh) for turn, one in
            ((torch.eye(3), plain), (matrix, turned))]  # fmt: skip
    torch.testing.assert_close(seen[1], seen[0], atol=1e-4, rtol=1e-4)
    assert len(notes) == (axes != "RUB")


def test_extensions_after_the_attributes_of_version_3_and_damaged_ones(tmp_path: Path, make_splats: MakeSplats) -> None:
    path = tmp_path / "a.spz"
    write_splats(make_splats(), path, version=3)
    plain = bytearray(gzip.decompress(path.read_bytes()))
    plain[14] |= 2
    meant = read_splats(path)
    path.write_bytes(gzip.compress(bytes(plain) + struct.pack("<III", 0xADBE0003, 4, 6)))
    torch.testing.assert_close(read_splats(path).means, meant.means * torch.tensor([1.0, -1.0, -1.0]))
    damaged = (struct.pack("<III", 0xADBE0003, 4, 17), struct.pack("<III", 0xADBE0003, 40, 6), b"abc")
    each_is_refused(path, [(gzip.compress(bytes(plain) + record), "extensions") for record in damaged])


@given(
    kind=st.integers(0, 2**32 - 1) | st.integers(0xADBE0000, 0xADBE0008),
    body=st.binary(max_size=12),
    flags=st.integers(0, 255),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_other_records_and_flags_are_never_misread(
    tmp_path_factory: pytest.TempPathFactory, make_splats: MakeSplats, kind: int, body: bytes, flags: int
) -> None:
    """Either the splats are right and a note names what was ignored, or there is an error."""
    path = tmp_path_factory.mktemp("spz") / "a.spz"
    write_splats(make_splats(20), path)
    meant = read_splats(path)
    path.write_bytes(with_record(path.read_bytes(), kind, body, flags | 2))
    notes = []
    try:
        splats = read_splats(path, notes.append)
    except StudioError:
        assert kind in (0xADBE0001, 0xADBE0003)
        return
    if kind == 0xADBE0003:
        torch.testing.assert_close(splats.means.abs().sum(), meant.means.abs().sum())
    else:
        torch.testing.assert_close(splats.means, meant.means)
        assert any(f"{kind:08X}" in note for note in notes) == (kind != 0xADBE0002)
    assert any("flags" in note for note in notes) == bool(flags & 0xFC)
