"""Renditions, files named by content, pages of the index, checks of decoders."""

import hashlib
import json
import zlib
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np
import pytest
import torch

from tests.studio.stream.conftest import MakeLadder, turned_bodies
from tests.support.errors import refuses
from tests.support.streams import best_of, contents, only
from v3studio.studio.stream import BakeSettings, Rung, StreamReader, bake_group, check_stream
from v3studio.studio.stream.encode import write_manifest as manifest_writer
from v3studio.studio.stream.sources.source import FolderSource


def manifest_of(folder):
    return json.loads((folder / "manifest.json").read_bytes())


def test_every_rendition_has_all_frames(make_ladder: MakeLadder) -> None:
    folder = make_ladder((4, 3))
    with StreamReader.open(folder) as reader:
        assert [rendition.id for rendition in reader.manifest.renditions] == ["qp24", "qp34", "qp34-splats50-sh0"]
        assert [rendition.pruning for rendition in reader.manifest.renditions] == ["none", "none", "importance"]
        best, middle, phone = reader.manifest.renditions
        assert best.bytes > middle.bytes > phone.bytes
        assert (best.splats, phone.splats, best.sh_degree, phone.sh_degree) == (120, 60, 1, 0)
        assert reader.played_bytes < reader.manifest.total_bytes
        means = torch.cat([frame.means for frame in turned_bodies(7, 120)])
        box = reader.manifest.bounding_box
        assert torch.equal(torch.tensor([box.min, box.max]), torch.stack([means.amin(0), means.amax(0)]))
        assert not check_stream(reader).damage
    frames = {}
    for one in ("qp24", "qp34", "qp34-splats50-sh0"):
        with only(StreamReader.open(folder), one) as reader:
            frames[one] = list(reader.iterate())
    assert [len(played) for played in frames.values()] == [7, 7, 7]
    for fine, coarse, phone in zip(*frames.values(), strict=True):
        assert (fine.means - coarse.means).abs().mean() < 0.02
        assert len(phone) == 60
        assert phone.sh.shape[1] == 1


def test_fewer_splats_need_to_know_what_they_contribute(tmp_path: Path) -> None:
    settings = BakeSettings(ladder=(Rung(qp=20, splats=0.5, finetune_iterations=0),))
    with refuses("bake.no_contribution", group=0):
        bake_group(turned_bodies(2, 80), tmp_path, 0, 0, settings)
    with refuses("bake.invalid_contribution", value=(79,), expected=(80,)):
        bake_group(turned_bodies(2, 80), tmp_path, 0, 0, settings, contribution=lambda: np.ones(79))
    assert contents(tmp_path) == {}


def test_fine_tuned_frames_are_baked_in_place_of_cut_ones(tmp_path: Path) -> None:
    settings = BakeSettings(ladder=(Rung(qp=20), Rung(qp=10, splats=0.5, sh_degree=0)))
    frames = turned_bodies(2, 80)
    with refuses("bake.no_finetuning", group=0):
        bake_group(frames, tmp_path, 0, 0, settings)
    asked = []

    def finetuned(rung):
        asked.append(rung.id)
        return [frame[torch.arange(30)].with_sh_degree(0) for frame in frames]

    entry = bake_group(frames, tmp_path, 0, 0, settings, finetuned=finetuned)
    assert asked == ["qp10-splats50-sh0"]
    assert [(rung.splats, rung.pruning) for rung in entry.renditions] == [(80, "none"), (30, "fine-tuned")]


def test_files_are_named_by_their_content(make_ladder: MakeLadder) -> None:
    files = contents(make_ladder())
    assert json.loads(files["manifest.json"])["total_bytes"] == sum(map(len, files.values()))
    del files["manifest.json"]
    for name, data in files.items():
        assert name.startswith(f"files/{hashlib.sha256(data).hexdigest()[:32]}.")


def test_baking_again_changes_only_what_changed(make_ladder: MakeLadder) -> None:
    folder = make_ladder()
    before = contents(folder).keys()
    make_ladder(ladder=(Rung(qp=24), Rung(qp=30)))
    after = contents(folder).keys()
    manifest = manifest_of(folder)
    assert [rendition["id"] for rendition in manifest["renditions"]] == ["qp24", "qp30"]
    kept = {best_of(group)[key]["path"] for group in manifest["groups"] for key in ("side", "video")}
    assert kept <= before & after
    assert len(after) == 1 + 8  # what only the old ladder used is gone
    with StreamReader.open(folder) as reader:
        assert not check_stream(reader).damage


def test_checks_are_of_what_another_decoder_sees(make_ladder: MakeLadder) -> None:
    """OpenCV's luma and zlib's CRC-32."""
    folder = make_ladder((5, 1))
    for group in manifest_of(folder)["groups"]:
        for rendition in group["renditions"]:
            capture = cv2.VideoCapture(str(folder / rendition["video"]["path"]))
            lumas = []
            while (found := capture.read())[0]:
                lumas.append(cv2.cvtColor(found[1], cv2.COLOR_BGR2GRAY))
            wanted = [0] if group["frame_count"] == 1 else [0, 2]
            assert [check["picture"] for check in rendition["video"]["checks"]] == wanted
            for check in rendition["video"]["checks"]:
                assert zlib.crc32(lumas[check["picture"]].tobytes()) == check["crc32"]


def test_level_is_that_of_the_rate_and_range_is_in_a_box(tmp_path: Path) -> None:
    def video(fps):
        settings = BakeSettings(quality=24)
        folder = tmp_path / f"{fps}"
        entry = bake_group(turned_bodies(2, 9000, 3), folder, 0, 0, settings, fps=fps)
        return next((folder / file.path).read_bytes() for file in entry.files if file.path.endswith(".mp4"))

    def level(data):
        at = data.index(b"avcC")
        assert data[at + 5] == 100  # High
        return data[at + 7]

    slow, fast = video(12.0), video(240.0)
    assert level(slow) < level(fast)
    at = slow.index(b"colr")
    assert slow[at + 4 : at + 15] == b"nclx" + bytes([0, 1, 0, 1, 0, 1, 0x80])


def test_a_long_stream_starts_without_its_pages(make_ladder: MakeLadder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(manifest_writer, "PAGE_BYTES", 1)  # every group after the first one in a page of its own
    folder = make_ladder((2,) * 6, paged=True)
    manifest = manifest_of(folder)
    assert len(manifest["groups"]) == 1
    assert [page["frames"] for page in manifest["pages"]] == [[2]] * 5
    source = FolderSource(folder)
    with patch.object(source, "read", wraps=source.read) as read, StreamReader.open(source) as reader:
        reader.gaussians(0)
        assert read.call_count == 3  # manifest, side file, video
        reader.gaussians(9)
        assert read.call_args_list[3].args[0] == manifest["pages"][3]["path"]
        assert read.call_count == 6
        assert len(reader.groups) == 6
        assert reader.group_of(11).index == 5
        assert [group.first_frame for group in reader.groups] == [0, 2, 4, 6, 8, 10]
        assert not check_stream(reader).damage
