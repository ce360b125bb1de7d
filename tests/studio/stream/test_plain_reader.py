"""A second reader of the profile `motion`, written from docs/STREAM.md alone: OpenCV, zlib and plain arithmetic, one
splat at a time. The reader shares no code with the product."""

import hashlib
import json
import re
import zlib
from pathlib import Path

import cv2
import numpy as np
import torch

from studio.stream import BakeSettings, StreamReader, bake_group, write_ladder, write_manifest


class Bytes:
    """The unread rest of the side file."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def byte(self, count):
        part = self.data[self.at : self.at + count]
        assert len(part) == count
        self.at += count
        return list(part)

    def signed(self, count, width):
        planes = [self.byte(count) for _ in range(width)]
        result = []
        for digits in zip(*planes, strict=True):
            code = sum(digit << (8 * k) for k, digit in enumerate(digits))
            result.append(code // 2 if code % 2 == 0 else -(code + 1) // 2)
        return result


def running(values):
    total, result = 0, []
    for value in values:
        total += value
        result.append(total)
    return result


def octree(data, bits, splats):
    """Integer cells (x, y, z) of the keyframe."""
    cells = [(0, 0, 0)]
    for _ in range(bits):
        below = []
        for (x, y, z), occupancy in zip(cells, data.byte(len(cells)), strict=True):
            for child in range(8):
                if occupancy >> child & 1:
                    below.append((2 * x + (child & 1), 2 * y + (child >> 1 & 1), 2 * z + (child >> 2 & 1)))
        cells = below
    result = []
    for cell, more in zip(cells, data.signed(len(cells), 4), strict=True):
        result += [cell] * (1 + more)
    assert len(result) == splats
    return result


def quaternion(p):
    square = sum(v * v for v in p)
    return np.array([1 - square, *(2 * v for v in p)]) / (1 + square)


def product(a, b):
    return np.array(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    )


def scan(tile, splats):
    def code(pixel):
        row, column = pixel
        return sum((column >> i & 1) << (2 * i) | (row >> i & 1) << (2 * i + 1) for i in range(16))

    pixels = sorted(((r, c) for r in range(tile) for c in range(tile)), key=code)
    return pixels[:splats]


def read_stream(folder: Path, rendition=None):
    """Yields per frame a list of splats: dicts of mean, quat, log_scale, opacity, sh (K, 3)."""
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["profile"] == "motion"
    if manifest["version"] == 2:
        for group in manifest["groups"]:
            yield from read_group(folder, group)
        return
    groups = list(manifest["groups"])
    for page in manifest["pages"]:
        values = json.loads(content(folder, page))
        assert values["format"] == "v3studio-stream-page"
        assert [group["frame_count"] for group in values["groups"]] == page["frames"]
        groups += values["groups"]
    ids = [one["id"] for one in manifest["renditions"]]
    for number, group in enumerate(groups):
        assert group["index"] == number
        assert [one["id"] for one in group["renditions"]] == ids
        one = group["renditions"][ids.index(rendition or ids[0])]
        assert (one["first_frame"], one["frame_count"]) == (group["first_frame"], group["frame_count"])
        yield from read_group(folder, one)


def content(folder, entry):
    """A file of version 3, named by its content."""
    data = (folder / entry["path"]).read_bytes()
    assert len(data) == entry["bytes"]
    digest = hashlib.sha256(data).hexdigest()
    assert digest == entry["sha256"]
    assert re.fullmatch(r"files/[0-9a-f]{32}\.[a-z0-9]{1,8}", entry["path"])
    assert entry["path"][6:38] == digest[:32]
    return data


def read_group(folder, group):
    splats, frames = group["splats"], group["frame_count"]
    blocks, lattice = group["blocks"], group["positions"]
    raw = zlib.decompress((folder / group["side"]["path"]).read_bytes(), wbits=-15)
    assert len(raw) == group["side"]["raw_bytes"]
    data = Bytes(raw)
    cells = octree(data, lattice["bits"], splats)
    labels = running(data.signed(splats, 2))
    classes = data.byte(splats)

    def motions(numbers):
        flat = data.signed((frames - 1) * numbers * blocks["count"], 4)
        table = np.array(flat, dtype=np.int64).reshape(frames - 1, numbers, blocks["count"])
        before, twice = np.zeros_like(table[:1]), np.zeros_like(table[:1])
        result = []
        for change in table:
            now = change + 2 * before - twice
            before, twice = now, before
            result.append(now[0])
        return result

    affine, turns = motions(12), motions(3)
    count = data.signed(1, 4)[0]
    where = zip(
        data.byte(count), running(data.signed(count, 4)), running(data.signed(count, 4)), data.signed(count, 4),
        strict=True,
    )  # fmt: skip
    escapes = {(c, s, f): v if v < 0 else v + 255 for c, s, f, v in where}
    assert data.at == len(raw)

    step = lattice["step"]
    key = [[lattice["min"][i] + (cell[i] + 0.5) * step for i in range(3)] for cell in cells]
    members = [[cells[s] for s in range(splats) if labels[s] == b] for b in range(blocks["count"])]
    centers = [[sum(cell[i] for cell in block) // len(block) for i in range(3)] for block in members]
    pixels = scan(group["tile"], splats)
    names = [channel["name"] for channel in group["channels"]]

    video = cv2.VideoCapture(str(folder / group["video"]["path"]))
    for frame in range(frames):
        ok, picture = video.read()
        assert ok
        luma = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        for check in group["video"].get("checks", ()):
            assert check["picture"] != frame or zlib.crc32(luma.tobytes()) == check["crc32"]
        result = []
        for s in range(splats):
            value = {}
            for c, channel in enumerate(group["channels"]):
                row = c // group["columns"] * group["tile"] + pixels[s][0]
                column = c % group["columns"] * group["tile"] + pixels[s][1]
                code = escapes.get((c, s, frame), int(luma[row, column]))
                value[names[c]] = channel["offset"] + (code - 128) * channel["step"]
            mean = np.array(key[s])
            turn = np.array([1.0, 0.0, 0.0, 0.0])
            if frame > 0:
                b = labels[s]
                local = [(cells[s][i] - centers[b][i]) * step / blocks["radius"] for i in range(3)] + [1]
                mean = mean + [
                    sum(local[i] * affine[frame - 1][3 * i + k][b] * blocks["step"] for i in range(4)) for k in range(3)
                ]
                turn = quaternion([turns[frame - 1][k][b] * blocks["rotation_step"] for k in range(3)])
            mean = mean + [value[f"residual_{axis}"] * 2 ** classes[s] for axis in "xyz"]
            sh = []
            for k in range((group["sh_degree"] + 1) ** 2):
                y, co, cg = (value[f"sh_{k}_{part}"] for part in ("y", "co", "cg"))
                sh.append([y + co - cg, y + cg, y - co - cg])
            result.append(
                {
                    "mean": mean,
                    "quat": product(turn, quaternion([value[f"rotation_{i}"] for i in range(3)])),
                    "log_scale": [value[f"log_scale_{i}"] for i in range(3)],
                    "opacity": value["opacity"],
                    "sh": sh,
                }
            )
        yield result


def test_a_reader_written_from_the_description_agrees(tmp_path, turning_bodies):
    """OpenCV's decoder and plain arithmetic, at a lossy QP, with escapes, several groups and turning blocks."""
    settings = BakeSettings(qp=24)
    groups, first = [], 0
    for number, count in enumerate((3, 2)):
        frames = turning_bodies(count, splats=60 + 10 * number, degree=1)
        frames[1].means[7] += torch.tensor([3.0, 0.0, 0.0])  # far off in one frame
        frames[1].logit_opacities[:] += 0.1
        groups.append(bake_group(frames, tmp_path, number, first, settings))
        first += count
    write_manifest(tmp_path, groups, 25, settings)
    compare(tmp_path)


def test_it_agrees_on_version_3(tmp_path, make_ladder, monkeypatch):
    """Two renditions, one of them with fewer splats, and groups in pages."""
    monkeypatch.setattr(write_ladder, "INLINE_BYTES", 1)
    folder = make_ladder((3, 1, 2), splats=70)
    assert len(json.loads((folder / "manifest.json").read_text())["pages"]) == 1
    compare(folder, "qp24")
    compare(folder, "qp34-splats50-sh0")


def compare(folder, rendition=None):
    """Both readers give the same frames."""
    with StreamReader.open(folder, rendition=rendition) as reader:
        ours = list(reader.iterate())
    plain = list(read_stream(folder, rendition))
    assert len(ours) == len(plain) > 4
    for frame, splats in zip(ours, plain, strict=True):
        for name, ours_ in (
            ("mean", frame.means),
            ("quat", frame.quats),
            ("log_scale", frame.log_scales),
            ("sh", frame.sh),
            ("opacity", frame.opacities),
        ):
            theirs = np.array([splat[name] for splat in splats])
            limits = (1e-6, 1 - 1e-6) if name == "opacity" else (-np.inf, np.inf)
            assert np.abs(ours_.numpy() - np.clip(theirs, *limits)).max() < 2e-5, name
