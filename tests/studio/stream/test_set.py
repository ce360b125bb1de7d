"""The set behind the performer: baked, read back, carried with the stream, and refused where it is not what it says."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from tests.studio.stream.conftest import clouds
from tests.support.errors import refuses
from tests.support.rigs import ring
from tests.support.streams import contents, edit_manifest, set_at
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.metrics import psnr
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, bake_set, check_stream, write_manifest
from v3studio.studio.stream.publish import publish
from v3studio.studio.stream.write_archive import write_archive

SETTINGS = BakeSettings(preset="ultrafast")


@pytest.fixture
def behind() -> Gaussians:
    """Splats of very different sizes."""
    splats = clouds(1, 1500)[0]
    splats.log_scales[:40] += 3.0
    return splats


@pytest.fixture
def stream(tmp_path: Path, behind: Gaussians) -> Path:
    folder = tmp_path / "stream"
    entries = [bake_group(clouds(2, 50, seed=group), folder, group, 2 * group, SETTINGS) for group in range(2)]
    write_manifest(folder, entries, 25.0, SETTINGS, behind=bake_set(behind, folder, SETTINGS))
    return folder


def test_it_comes_back_the_coarsest_first(stream: Path, behind: Gaussians) -> None:
    with StreamReader.open(stream) as reader:
        decoded, parts = reader.set_splats(), reader.manifest.set
        first = [file.path for file in reader.index.files(0)]
        assert [file.path for file in reader.files][: len(first) + 4] == [
            *first,
            *(f.path for p in parts for f in p.files),
        ]
        frame = reader.gaussians(0)
    assert decoded is not None
    assert len(decoded) == sum(part.splats for part in parts) == len(behind)
    sizes = decoded.scales.amax(dim=1)
    assert sizes[: parts[0].splats].median() > 2 * sizes[parts[0].splats :].median()
    for camera in ring(2, radius=4.0):
        one, two = (rasterize(splats, camera).image for splats in (behind, decoded))
        assert psnr(one, two) > 40
    together = frame.before(decoded)
    assert torch.equal(together.means, torch.cat([frame.means, decoded.means]))
    assert frame.before(None) is frame


def test_it_goes_where_the_stream_goes(stream: Path, tmp_path: Path) -> None:
    with StreamReader.open(stream) as reader:
        assert check_stream(reader).damage == ()
        publish(reader, str(tmp_path / "published"))
        write_archive(reader, tmp_path / "one.v3s")
        own = [file for part in reader.manifest.set for file in part.files]
        assert reader.played_bytes <= reader.manifest.total_bytes - sum(file.bytes for file in own)
    assert contents(tmp_path / "published") == contents(stream)
    with StreamReader.open(tmp_path / "one.v3s") as reader:
        assert len(reader.set_splats() or ()) == 1500
    (stream / own[0].path).write_bytes(b"damaged")
    with StreamReader.open(stream) as reader:
        assert len(list(reader.iterate())) == 4
        with refuses("stream.wrong_size"):
            reader.set_splats()
        assert [damage.file for damage in check_stream(reader).damage] == [own[0].path]


@pytest.mark.parametrize(
    ("place", "value", "rule"),
    [
        (("set", 0, "frame_count"), 2, "set_part"),
        (("set", 1, "index"), 0, "set_part"),
        (("set", 0, "bytes"), 5, "bytes_sum"),
        (("set", 0, "sh_degree"), 1, "channels"),
        (("set",), None, "tuple_type"),
    ],
)
def test_what_is_no_set_is_refused(stream: Path, place: tuple[Any, ...], value: object, rule: str) -> None:
    edit_manifest(stream, set_at(place, value))
    with refuses("manifest.invalid", rule=rule):
        StreamReader.open(stream)


def test_streams_without_one_have_none(stream: Path) -> None:
    edit_manifest(stream, lambda values: values.pop("set"))
    with StreamReader.open(stream) as reader:
        assert reader.set_splats() is None


def test_zeros_in_texts_are_no_checksum(tmp_path: Path) -> None:
    entry = bake_group(clouds(1, 50), tmp_path, 0, 0, SETTINGS)
    write_manifest(tmp_path, [entry], 25.0, SETTINGS, {"description": "0" * 64})
    with StreamReader.open(tmp_path) as reader:
        assert reader.manifest.metadata == json.loads((tmp_path / "manifest.json").read_bytes())["metadata"]
