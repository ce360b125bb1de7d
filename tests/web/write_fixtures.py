"""Writes the reference data of the player's unit tests (web/tests): arrays computed in Python.

PYTHONPATH=. python tests/web/write_fixtures.py FOLDER
"""

import json
import shutil
import struct
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any
from unittest import mock

import av
import numpy as np
import support


def video_index(path: Path) -> dict[str, Any]:
    """The index of a video as FFmpeg reads it: [offset, bytes, key, seconds] of each packet."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        packets = [packet for packet in container.demux(stream) if packet.size]
        return {
            "width": stream.width,
            "height": stream.height,
            "packets": [[one.pos, one.size, one.is_keyframe, float(one.pts * one.time_base)] for one in packets],
        }


def write_videos(folder: Path, temporary: Path) -> None:
    stream = support.bake(temporary / "video", lengths=(9,), splats=1500, qp=30)
    best = json.loads((stream / "manifest.json").read_bytes())["groups"][0]["renditions"][0]
    video = stream / best["video"]["path"]
    shutil.copyfile(video, folder / "video.mp4")
    (folder / "video.json").write_text(json.dumps(video_index(video)))


def write_archives(folder: Path) -> None:
    """Streams in one file: plain, with ZIP64 records, with a long extra field, compressed, with another first file."""
    numbers = bytes(7 * i % 256 for i in range(200_000))
    files = {"manifest.json": bytes([1, 2, 3]), "files/a.bin": numbers, "files/b.mp4": b""}
    for kind in ("plain", "wide", "extra", "compressed", "other"):
        limit = mock.patch.object(zipfile, "ZIP64_LIMIT", 10 if kind == "wide" else 1 << 31)
        method = zipfile.ZIP_DEFLATED if kind == "compressed" else zipfile.ZIP_STORED
        file = folder / f"{kind}.zip"
        with limit, zipfile.ZipFile(file, "w") as archive:
            for path, data in {"other.txt": b"first", **files}.items() if kind == "other" else files.items():
                entry = zipfile.ZipInfo(path)
                entry.extra = struct.pack("<HH396x", 0x7777, 396) if kind == "extra" else b""
                archive.writestr(entry, data, method)
        if kind == "wide":  # the last record is for 32 bits; if they suffice, Python writes its numbers nevertheless
            file.write_bytes(file.read_bytes()[:-14] + b"\xff" * 12 + bytes(2))


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        # QP 4 has escapes; the figure has few of them.
        stream = support.bake(Path(temporary) / "stream", lengths=(5, 3), splats=700, degree=1, qp=4)
        (folder / "motion.json").write_bytes((stream / "manifest.json").read_bytes())
        luma = support.luma(stream, 0)
        np.stack(luma).tofile(folder / "motion.luma")
        positions = np.stack([one.means.numpy() for one in support.decoded(stream, *range(len(luma)))])
        positions.astype(np.float32).tofile(folder / "motion.positions")
        write_videos(folder, Path(temporary))
        side = json.loads((stream / "manifest.json").read_bytes())["groups"][0]["renditions"][0]["side"]
        (folder / "motion.bin").write_bytes((stream / side["path"]).read_bytes())
        (folder / "side.json").write_text(json.dumps(support.side_arrays(stream, 0)))
        options = {"lengths": (3, 2), "splats": 300, "ladder": (20, 34), "paged": True, "clicks": [0.1]}
        ladder = support.bake(Path(temporary) / "ladder", **options)
        manifest = (ladder / "manifest.json").read_bytes()
        (folder / "ladder.json").write_bytes(manifest)
        (folder / "page.json").write_bytes((ladder / json.loads(manifest)["pages"][0]["path"]).read_bytes())
        np.stack(support.luma(ladder, 0)).tofile(folder / "ladder.luma")
    write_archives(folder)
    shutil.copy(Path(__file__).parents[1] / "data" / "rate_rule.json", folder / "rule.json")
    tiles = [(16, 256), (16, 7), (48, 2304), (80, 6001), (176, 30976), (1040, 1_081_600)]
    orders = {f"{tile} {count}": support.morton_pixels(tile, count) for tile, count in tiles}
    sums = {key: [sum(pixels), *pixels[:50], *pixels[-50:]] for key, pixels in orders.items()}
    (folder / "morton.json").write_text(json.dumps(sums))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
