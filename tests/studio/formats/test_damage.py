"""Damaged and hostile files of every format: one refusal, quickly, and without more memory than the file justifies."""

import contextlib
import io
import json
import struct
import tracemalloc
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from tests.support.errors import refuses
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import read_splats, splats_size

DATA = Path(__file__).parents[2] / "data" / "splats"
FILES = (
    "degree1.spz", "degree1-v3.spz", "degree1.compressed.ply", "degree3.sog", "degree0.splat",
)  # fmt: skip
REPEATED = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@contextlib.contextmanager
def at_most(peak: int) -> Iterator[None]:
    """Assert that the block does not take more bytes at a time."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < peak
    finally:
        tracemalloc.stop()


def refused_or_sound(path: Path) -> None:
    """Reading raises a StudioError about this file or gives finite splats, within bounded memory."""
    with at_most(256 << 20):
        try:
            splats = read_splats(path)
        except StudioError as error:
            file = Path(error.file or "")
            assert file.parent == path.parent
        else:
            assert len(splats) > 0
            assert all(values.isfinite().all() for _, values in splats.items())


def each_is_refused(path: Path, cases: list[tuple[bytes, str]]) -> None:
    """Reading any of these contents raises an error about the file with the code beside it."""
    for content, code in cases:
        path.write_bytes(content)
        with refuses(f"splat_file.{code}", file=path):
            read_splats(path)


def patched(data: bytes, start: int, content: bytes) -> bytes:
    return data[:start] + content + data[start + len(content) :]


def with_record(data: bytes, kind: int, body: bytes, flags: int = 2) -> bytes:
    """A file of SPZ 4 with an extension."""
    record = struct.pack("<II", kind, len(body)) + body
    head = patched(patched(data[:32], 14, bytes([flags])), 16, struct.pack("<I", 32 + len(record)))
    return head + record + data[32:]


@pytest.mark.parametrize("name", FILES)
@REPEATED
@given(data=st.data())
def test_changed_bytes(tmp_path: Path, name: str, data: st.DataObject) -> None:
    content = bytearray((DATA / name).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.one_of(st.integers(0, 64), st.integers(0, len(content) - 1)))
        content[start : start + 4] = data.draw(st.binary(min_size=4, max_size=4))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content))) :]
    path = tmp_path / name
    path.write_bytes(content)
    refused_or_sound(path)


@REPEATED
@given(data=st.data())
def test_changed_values_inside_spz_4(tmp_path: Path, data: st.DataObject) -> None:
    """Bytes change below the compression, so that the values are reached."""
    good = (DATA / "degree1.spz").read_bytes()
    streams, table = good[15], struct.unpack_from("<I", good, 16)[0]
    entries = [struct.unpack_from("<QQ", good, table + 16 * index) for index in range(streams)]
    position, bodies = table + 16 * streams, []
    for stored, _ in entries:
        body = bytearray(zstandard.decompress(good[position : position + stored]))
        position += stored
        start = data.draw(st.integers(0, len(body) - 1))
        body[start : start + 8] = data.draw(st.binary(min_size=8, max_size=8))
        bodies.append(bytes(body))
    frames = [zstandard.compress(body) for body in bodies]
    listed = b"".join(struct.pack("<QQ", len(f), len(b)) for f, b in zip(frames, bodies, strict=True))
    head = bytearray(good[:32])
    if data.draw(st.booleans()):
        head[data.draw(st.integers(4, 31))] = data.draw(st.integers(0, 255))
    path = tmp_path / "a.spz"
    path.write_bytes(bytes(head) + listed + b"".join(frames))
    refused_or_sound(path)


def sog_parts() -> dict[str, bytes]:
    with zipfile.ZipFile(DATA / "degree3.sog") as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write_sog(path: Path, parts: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return path


ODD = st.one_of(
    st.none(), st.booleans(), st.integers(-10, 10**12), st.floats(), st.text(max_size=4), st.just([]), st.just({}),
    st.just("../meta.json"), st.just("/etc/passwd"), st.just([None] * 256), st.just([1e400] * 256), st.just(["\0"]),
)  # fmt: skip


@REPEATED
@given(data=st.data())
def test_changed_values_inside_sog(tmp_path: Path, data: st.DataObject) -> None:
    parts = sog_parts()
    meta = json.loads(parts["meta.json"])
    place = meta
    key = data.draw(st.sampled_from(sorted(meta)))
    if isinstance(place[key], dict) and data.draw(st.booleans()):
        place = place[key]
        key = data.draw(st.sampled_from(sorted(place)))
    place[key] = data.draw(ODD)
    parts["meta.json"] = json.dumps(meta).encode()
    refused_or_sound(write_sog(tmp_path / "a.sog", parts))


def image(width: int, height: int, mode: str = "RGBA", value: int = 255, **options) -> bytes:
    out = io.BytesIO()
    Image.new(mode, (width, height), (value,) * len(mode)).save(out, **{"format": "WEBP", "lossless": True, **options})
    return out.getvalue()


def test_sog_parts_that_disagree(tmp_path: Path) -> None:
    good = sog_parts()
    meta = json.loads(good["meta.json"])
    path = tmp_path / "a.sog"

    def changed(**sections) -> bytes:
        return json.dumps({**meta, **sections}).encode()

    big = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBB", 13, b"IHDR", 16000, 16000, 8, 0, 0, 0, 0) + bytes(50)
    cases = [
        *(({"meta.json": text}, "sog_meta", {"name": "meta.json"}) for text in (b"{", b"[" * 100_000, b"[]")),
        ({"meta.json": changed(version=1)}, "unsupported_version", {"value": 1}),
        ({"meta.json": changed(count=0)}, "splat_count", {"value": 0}),
        ({"meta.json": changed(count=10**9)}, "splat_count", {"value": 10**9}),
        ({"meta.json": changed(count=100_000)}, "sog_image", {"name": "means_l.webp"}),
        ({"meta.json": changed(sh0=None)}, "sog_meta", {"name": "sh0"}),
        ({"meta.json": changed(quats={"files": ["../quats.webp"]})}, "sog_meta", {"name": "quats.files"}),
        ({"meta.json": changed(scales=meta["scales"] | {"codebook": [None] * 256})}, "sog_meta",
         {"name": "scales.codebook"}),
        ({"meta.json": changed(shN=meta["shN"] | {"bands": 4})}, "sog_meta", {"name": "shN.bands"}),
        ({"meta.json": changed(shN=meta["shN"] | {"bands": 2})}, "sog_image", {"name": "shN_centroids.webp"}),
        ({"meta.json": changed(shN=meta["shN"] | {"count": 2})}, "sog_meta", {"name": "shN.count"}),
        ({"quats.webp": image(20, 16, value=100)}, "sog_image", {"name": "quats.webp", "value": 100}),
        *(({"sh0.webp": content}, "sog_image", {"name": "sh0.webp"} | value) for content, value in (
            (good["sh0.webp"][:200], {}), (b"GIF89a" + bytes(50), {"value": None}), (big, {"value": (16000, 16000)}),
            (image(20, 16, lossless=False), {"value": None}), (image(8, 8), {"value": (8, 8)}),
            (image(600, 600), {"value": (600, 600)}),
        )),
    ]  # fmt: skip
    for parts, code, fields in cases:
        write_sog(path, {**good, **parts})
        with refuses(f"splat_file.{code}", file=path, **fields):
            read_splats(path)
    del good["scales.webp"]
    with refuses("splat_file.sog_part_missing", file=path, name="scales.webp"):
        read_splats(write_sog(path, good))
    each_is_refused(path, [(b"PK\3\4" + bytes(100), "unreadable"), (b"hello" * 100, "unreadable")])


def test_an_open_sog_with_a_part_missing(tmp_path: Path) -> None:
    for part in (DATA / "sog" / "degree1").iterdir():
        if part.name != "quats.webp":
            (tmp_path / part.name).write_bytes(part.read_bytes())
    with refuses("splat_file.not_found", file=tmp_path / "quats.webp"):
        read_splats(tmp_path / "meta.json")
    with refuses("splat_file.not_found", file=tmp_path / "none" / "meta.json"):
        splats_size(tmp_path / "none" / "meta.json")


def test_small_files_that_claim_much(tmp_path: Path) -> None:
    """Bombs: refused before they are unpacked."""
    huge = (1 << 26) - 1
    zeros = zstandard.compress(bytes(9 * 10_000_000))
    entries = b"".join(struct.pack("<QQ", len(zeros), huge * size) for size in (9, 1, 3, 3, 4))
    spz = struct.pack("<IIIBBBBI12x", 0x5053474E, 4, huge, 0, 12, 0, 5, 32) + entries + zeros * 5
    sog = {**sog_parts(), "meta.json": b" " * (20 << 20)}
    out = tmp_path / "a.sog"
    write_sog(out, sog, zipfile.ZIP_DEFLATED)
    (tmp_path / "a.spz").write_bytes(spz)
    for path in (tmp_path / "a.spz", out):
        with at_most(16 << 20), refuses("splat_file.expansion", file=path):
            read_splats(path)


def test_zstandard_frames_that_give_more_than_listed(tmp_path: Path) -> None:
    good = (DATA / "degree0.spz").read_bytes()
    first, listed = struct.unpack_from("<QQ", good, 32)
    frame = zstandard.compress(bytes(100_000_000))
    path = tmp_path / "a.spz"
    content = good[:32] + struct.pack("<QQ", len(frame), listed) + good[48:112] + frame + good[112 + first :]
    with at_most(64 << 20):
        each_is_refused(path, [(content, "unreadable")])


def test_spz_4_containers(tmp_path: Path) -> None:
    good = (DATA / "degree0.spz").read_bytes()
    path = tmp_path / "a.spz"
    cases = [
        *((good[:length], "truncated") for length in (20, 100, -1)),
        *((patched(good, 4, version), "unsupported_version") for version in (b"\x05", b"\x01")),
        (patched(good, 12, b"\x04"), "invalid_header"),
        (patched(good, 12, b"\x01"), "invalid_header"),  # degree 1 needs a sixth attribute
        (patched(good, 16, struct.pack("<I", 16)), "invalid_header"),
        (patched(good, 16, struct.pack("<I", 10**9)), "truncated"),
        (patched(good, 40, struct.pack("<Q", 10**15)), "unreadable"),
        (patched(good, 32, struct.pack("<Q", 2**63)), "truncated"),
        (patched(good, 112, b"\0\0\0\0"), "unreadable"),
        (with_record(good, 0xADBE0001, bytes(12)), "extensions"),
    ]
    each_is_refused(path, cases)
    for kind, skipped in ((0xADBE0002, 0), (0x12340001, 1)):  # camera limits, and another program's
        notes = []
        path.write_bytes(with_record(good, kind, bytes(12)))
        assert read_splats(path, notes.append).means.equal(read_splats(DATA / "degree0.spz").means)
        assert len(notes) == skipped


def test_splat_files_of_odd_sizes_and_values(tmp_path: Path) -> None:
    path = tmp_path / "a.splat"
    good = np.frombuffer((DATA / "degree0.splat").read_bytes(), np.uint8).copy()
    for size, code in ((0, "splat_file.splat_count"), (31, "splat_file.unreadable"), (33, "splat_file.unreadable")):
        path.write_bytes(good[:size].tobytes())
        for reader in (read_splats, splats_size):
            with refuses(code, file=path):
                reader(path)
    whole = read_splats(DATA / "degree0.splat")
    for start, value in ((0, np.nan), (12, -1.0)):  # a position; a scale, which cannot be negative
        wrong = good.copy()
        wrong[start : start + 4] = np.frombuffer(np.float32(value).tobytes(), np.uint8)
        path.write_bytes(wrong.tobytes())
        notes = []
        assert read_splats(path, notes.append).means.equal(whole.means[1:])
        assert [note.split()[0] for note in notes] == ["1"]
    flat = good.copy()
    flat[12:16] = 0  # a scale of 0: as thin as can be stored
    path.write_bytes(flat.tobytes())
    assert read_splats(path).scales[0, 0] < 1e-11


def test_compressed_ply_headers(tmp_path: Path) -> None:
    good = (DATA / "degree1.compressed.ply").read_bytes()
    path = tmp_path / "a.ply"
    cases = [
        (b"element chunk 2", b"element chunk 1", "invalid_header"),
        (b"uint packed_scale", b"uint packed_size", "not_splats"),
        (b"float min_x", b"uint min_x", "not_splats"),
        (b"property uchar f_rest_8", b"property uchar f_rest_9", "sh_properties"),
        (b"property uchar f_rest_8", b"property char f_rest_8", "not_splats"),
        (b"element vertex 260", b"element vertex 0", "splat_count"),
        (b"element vertex 260", b"element vertex 99999999999", "unreadable"),
    ]
    assert all(before in good for before, _, _ in cases)
    changed = [(good.replace(before, after, 1), code) for before, after, code in cases]
    each_is_refused(path, [*changed, (good[:-1], "unreadable")])
    head = good.index(b"end_header\n") + len(b"end_header\n")
    path.write_bytes(good[:head] + np.float32(np.nan).tobytes() + good[head + 4 :])
    assert len(read_splats(path)) == 260 - 256  # without those of the first chunk
