"""Files that are small, or only seem large, and want to become something enormous when they are read.

Each is read in a process with bounded memory, and must be refused with a sentence, in bounded time.
"""

from __future__ import annotations

import gzip
import io
import json
import multiprocessing
import os
import resource
import struct
import time
import traceback
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import zstandard
from outcome import Outcome

from pipelines.config.loading import load_config
from pipelines.takes.frame_files import read_frame
from pipelines.takes.marks import read_marks
from pipelines.takes.take import Take
from studio.audio import SoundFile
from studio.calibration.manual.file import read_tie_points
from studio.camera_files import read_rig
from studio.capture.images import read_image
from studio.errors import StudioError
from studio.formats import READ_SUFFIXES, read_splats
from studio.formats.sequence import open_import
from studio.stream import BakeSettings, StreamReader
from tests.support.hostile_streams import Files, Memory, read_stream, signed, with_file
from tests.support.streams import bake_numbered

MEMORY = 2 << 30
"""Bytes of address space beyond what the process has with all libraries loaded. An image may have 179 megapixels."""

PATIENCE = 120.0
"""Seconds for one bomb, on a busy machine."""

ZEROS = 100_000_000
HUGE = 1 << 40
"""Bytes of a file without content: a terabyte that takes no room on the disk."""

Read = Callable[[Path], object]


def attack(folder: Path, share: float, outcome: Outcome) -> None:
    """All of them; they are few, so that the share does not matter."""
    peaks: list[tuple[int, str]] = []
    for name, path, read in bombs(folder / "bombs"):
        outcome.count += 1
        try:
            grown, result = in_process(path, read)
        except TimeoutError as error:
            outcome.failed(f"{name}: {error}")
            continue
        peaks.append((grown, name))
        if not result.startswith("refused"):
            outcome.failed(f"{name}: {result}")
    grown, name = max(peaks)
    outcome.note(f"all refused; the most memory took {name}, {grown >> 20} MB")


def in_process(path: Path, read: Read) -> tuple[int, str]:
    """Read a file in a forked process with bounded memory.

    Returns:
        bytes by which its peak memory grew, and "refused CODE", or what else came of it.

    Raises:
        TimeoutError: it took more than `PATIENCE`.
    """
    receive, send = multiprocessing.Pipe(duplex=False)

    def run() -> None:
        receive.close()
        bound_process(MEMORY)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            read(path)
            result = "was read"
        except StudioError as error:
            try:
                result = checked_sentence(error)
            except ValueError as wrong:
                result = str(wrong)
        except BaseException:
            result = traceback.format_exc(limit=-4)
        send.send(((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) << 10, result))

    process = multiprocessing.get_context("fork").Process(target=run)
    began = time.monotonic()
    process.start()
    send.close()
    try:
        if not receive.poll(PATIENCE):
            raise TimeoutError(f"not refused within {PATIENCE:g} s")
        return receive.recv()
    except EOFError:
        process.join()
        return 0, f"the process ended with {process.exitcode} after {time.monotonic() - began:.0f} s"
    finally:
        process.kill()
        process.join()
        receive.close()


def bound_process(memory: int) -> None:
    """Let this process grow by this many bytes at most, without warnings."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGESIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
    warnings.simplefilter("ignore")


def checked_sentence(error: StudioError) -> str:
    """The code; raises ValueError for a sentence that is not bounded or has control characters."""
    text = str(error)
    if len(text) > 3000 or any(ord(letter) < 32 and letter not in "\n\t" for letter in text):
        raise ValueError(f"a sentence of {len(text)} characters, or with control characters: {text[:300]!r}")
    return f"refused {error.code}"


def all_sound(path: Path) -> None:
    """The sound of a file, at most a minute."""
    for number, _ in enumerate(SoundFile(path).blocks()):
        if number > 1000:
            break


def bombs(folder: Path) -> list[tuple[str, Path, Read]]:
    """All, as name, file and reader, written below a folder."""
    found: list[tuple[str, Path, Read]] = []

    def add(name: str, file: str, data: bytes, read: Read, size: int | None = None) -> None:
        path = folder / str(len(found)) / file
        path.parent.mkdir(parents=True)
        path.write_bytes(data)
        if size is not None:
            os.truncate(path, size)
        found.append((name, path, read))

    for name, data in splat_files().items():
        add(name, f"bomb{Path(name.split(':')[0]).suffix}", data, _splats)
    for ending in sorted(READ_SUFFIXES):
        start = b"ply\n" if ending == ".ply" else b"PK\x03\x04" if ending == ".sog" else b""
        add(f"a{ending} of a terabyte", f"bomb{ending}", start, _splats, HUGE)
    for file, read in TEXTS.items():
        add(f"{file} of a terabyte", file, b"{", read, HUGE)
        add(f"{file} of brackets", file, b"[" * 30_000_000, read)
    add(
        "a trained frame whose header claims 2^60 bytes",
        "a.safetensors",
        struct.pack("<Q", 1 << 60) + b"{}",
        read_frame,
    )
    add("a trained frame of a terabyte", "a.safetensors", struct.pack("<Q", 1 << 39) + b"{", read_frame, HUGE)
    add("a PNG of 60,000 x 60,000", "a.png", _png(60_000), read_image)
    add("a PNG of 2^31 x 2^31", "a.png", _png(2**31 - 1, rows=1), read_image)
    add("a WAV of a terabyte", "a.wav", _wav(), all_sound, HUGE)
    for name, info, frames in _videogs():
        place = folder / str(len(found))
        place.mkdir()
        (place / "viewer_min_max.json").write_bytes(frames)
        (place / "group_info.json").write_bytes(info)
        found.append((f"VideoGS: {name}", place, _videogs_frame))
    original = read_stream(bake_numbered(folder / "stream", (2,), 25, 40, BakeSettings(preset="ultrafast")))
    for name, files in _streams(original).items():
        found.append((f"stream: {name}", folder, lambda path, files=files: _first_frame(files)))
    return found


TEXTS: dict[str, Read] = {
    "ball.yaml": load_config,
    "cameras.json": read_rig,
    "Calib.toml": read_rig,
    "calibration.csv": read_rig,
    "tie_points.yaml": read_tie_points,
    "marks.json": read_marks,
    "take.json": lambda path: Take.open(path.parent),
}
"""Readers of texts, by the name of the file."""


def splat_files() -> dict[str, bytes]:
    """Bombs of each splat format, by name; the name begins with the ending."""
    head = struct.Struct("<IIIBBBB")
    spz = 0x5053474E
    zeros = gzip.compress(bytes(ZEROS))
    frame = zstandard.ZstdCompressor(level=1).compress(bytes(ZEROS))
    spz_4 = head.pack(spz, 4, 1 << 25, 3, 12, 0, 6) + struct.pack("<I12x", 32)
    ply = b"ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nend_header\n"
    found = {
        "x.spz: ten gigabytes of zeros": gzip.compress(head.pack(spz, 3, 1 << 26, 3, 12, 0, 0)) + zeros * 100,
        "x.spz: four billion splats, none there": gzip.compress(head.pack(spz, 3, (1 << 32) - 1, 3, 12, 0, 0)),
        "x.spz: plain, 2^26 splats, none there": head.pack(spz, 2, 1 << 26, 3, 12, 0, 0),
        "x.spz: Zstandard, frames larger than announced": spz_4 + struct.pack("<QQ", len(frame), 100) * 6 + frame * 6,
        "x.spz: Zstandard, announced 2^60 bytes": spz_4 + struct.pack("<QQ", len(frame), 1 << 60) * 6 + frame * 6,
        "x.ply: 10^15 splats, binary": ply % (b"binary_little_endian", 10**15),
        "x.ply: 10^15 splats, text": ply % (b"ascii", 10**15),
        "x.ply: 10^300 splats": (ply % (b"ascii", 1)).replace(b"vertex 1\n", b"vertex 1" + b"0" * 300 + b"\n"),
        "x.ply: a list of four billion": b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
        b"property list uint float x\nend_header\n\xff\xff\xff\xff",
        "x.ply: 200,000 properties": b"ply\nformat ascii 1.0\nelement vertex 1\n"
        + b"".join(b"property float f%d\n" % number for number in range(200_000))
        + b"end_header\n",
        "x.ply: 200,000 elements": b"ply\nformat ascii 1.0\n"
        + b"".join(b"element e%d 0\nproperty float x\n" % number for number in range(200_000))
        + b"end_header\n",
        "x.ply: a line of 100 MB": b"ply\nformat ascii 1.0\ncomment " + b"x" * ZEROS + b"\nend_header\n",
        "x.ksplat: 65,535 sections of four billion": b"\0\1\0\0"
        + struct.pack("<IIII", 65535, 65535, 2**32 - 1, 2**32 - 1) + b"\xff" * 4076,
    }  # fmt: skip
    for name, meta in (
        ("meta.json of a gigabyte of zeros", bytes(10 * ZEROS)),
        ("10^12 splats", _sog_meta(10**12)),
        ("2^26 splats in a picture of 30,000 x 30,000", _sog_meta(1 << 26)),
    ):
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("meta.json", meta)
            for part in ("means_l", "means_u", "scales", "quats", "sh0"):
                archive.writestr(f"{part}.webp", _png(30_000))
        found[f"x.sog: {name}"] = data.getvalue()
    many = io.BytesIO()
    with zipfile.ZipFile(many, "w") as archive:
        for number in range(50_000):
            archive.writestr(f"{number}", b"")
    found["x.sog: 50,000 members"] = many.getvalue()
    return found


def _sog_meta(count: int) -> bytes:
    book = {"codebook": [0.0] * 256}
    meta = {
        "version": 2,
        "count": count,
        "means": {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["means_l.webp", "means_u.webp"]},
        "scales": {**book, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {**book, "files": ["sh0.webp"]},
    }
    return json.dumps(meta).encode()


def _png(size: int, rows: int | None = None) -> bytes:
    """A black image of one bit per pixel."""
    packer = zlib.compressobj(9)
    row = bytes(1 + (size + 7) // 8) if size < 1 << 20 else b"\0"
    data = b"".join(packer.compress(row) for _ in range(rows or size)) + packer.flush()

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", size, size, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def _wav() -> bytes:
    rate = 48000
    return (
        b"RIFF\xff\xff\xff\xffWAVEfmt "
        + struct.pack("<IHHIIHH", 16, 1, 1000, rate, 2000 * rate, 2000, 16)
        + b"data\xff\xff\xff\xff"
    )


def _videogs() -> list[tuple[str, bytes, bytes]]:
    ranges = [0.0, 1.0] * 17
    frame = {"num": 4 << 20, "info": ranges}
    one = json.dumps({"0": frame}).encode()
    return [
        ("10^12 frames", json.dumps({"0": {"frame_index": [0, 10**12], "name_index": 0}}).encode(), one),
        ("four million splats, no video", json.dumps({"0": {"frame_index": [0, 0], "name_index": 0}}).encode(), one),
        ("brackets", b"[" * 30_000_000, one),
        ("a million frames", b"{}", json.dumps({str(number): {} for number in range(1_000_001)}).encode()),
    ]


def _streams(files: Files) -> dict[str, Files]:
    """Side files that inflate to far more than they say, or say that they do."""
    packer = zlib.compressobj(9, wbits=-15)
    zeros = b"".join(packer.compress(bytes(ZEROS)) for _ in range(10)) + packer.flush()
    found = {
        f"a side file of a gigabyte that announces {size:,} bytes": with_file(files, 0, "side", zeros, size)
        for size in (1000, 10 * ZEROS, 1 << 52)
    }
    for key, value in (("width", 1 << 20), ("height", 1 << 20), ("splats", 1 << 31), ("frame_count", 1 << 31)):
        values = json.loads(files["manifest.json"])
        for place in (
            values,
            values["groups"][0],
            values["groups"][0]["renditions"][0],
            values["groups"][0]["renditions"][0]["video"],
        ):
            if key in place:
                place[key] = value
                found[f"{key} of {value:,}"] = {**files, "manifest.json": signed(values, files)}
    return found


def _splats(path: Path) -> object:
    return read_splats(path)


def _videogs_frame(place: Path) -> object:
    return open_import(place).read(0)


def _first_frame(files: Files) -> object:
    with StreamReader.open(Memory(files), threads=1) as reader:
        return reader.gaussians(0)
