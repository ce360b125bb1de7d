"""Files of a baked group: determinism, layout, decoding with other libraries, and atomicity."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests.studio.stream.conftest import MakeLadder, clouds
from tests.support.errors import refuses
from tests.support.streams import contents
from v3studio.studio.errors import Cancelled, StudioError
from v3studio.studio.stream import BakeSettings, bake_group, write_manifest
from v3studio.studio.stream.video import PlaneEncoder

FAST = BakeSettings(preset="ultrafast")


def test_a_cancelled_and_a_failed_bake_leave_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = FAST
    write_manifest(tmp_path, [bake_group(clouds(3, 100), tmp_path, 0, 0, settings)], 30, settings)
    before = contents(tmp_path)
    seen = []

    def stop(done, total, **figures):
        seen.append((done, total))
        if done == 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        bake_group(clouds(3, 100, seed=5), tmp_path, 0, 0, settings, progress=stop)
    assert seen[-1] == (2, 3)
    assert contents(tmp_path) == before

    def fail(self, plane):
        raise StudioError("video.encoder", "the encoder failed")

    monkeypatch.setattr(PlaneEncoder, "add", fail)
    with pytest.raises(StudioError, match="the encoder failed"):
        bake_group(clouds(3, 100, seed=5), tmp_path, 0, 0, settings)
    assert contents(tmp_path) == before


def test_bad_frames_are_refused(tmp_path: Path) -> None:
    frames, settings = clouds(3, 100), FAST
    with refuses("bake.no_frames", group=0):
        bake_group([], tmp_path, 0, 0, settings)
    with refuses("bake.no_splats"):
        bake_group([frames[0][:0]], tmp_path, 0, 0, settings)
    with refuses("bake.mixed_frames", frame=1, value=(99, 0), expected=(100, 0)):
        bake_group([frames[0], frames[1][:99]], tmp_path, 0, 0, settings)
    with refuses("bake.mixed_frames", frame=1, value=(100, 1), expected=(100, 0)):
        bake_group([frames[0], frames[1].with_sh_degree(1)], tmp_path, 0, 0, settings)
    frames[2].sh[4, 0, 1] = float("nan")
    with refuses("gaussians.not_finite", frame=2, attribute="sh"):
        bake_group(frames, tmp_path, 0, 0, settings)
    assert contents(tmp_path) == {}
    first, second = clouds(2, 60)
    with refuses("bake.mixed_dilations", value=0.1, expected=0.3, frame=1):
        bake_group([first, replace(second, dilation=0.1)], tmp_path, 0, 0, settings)


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with refuses("bake.write_failed", file=tmp_path / "file" / "group_000"):
        bake_group(clouds(1, 50), tmp_path / "file", 0, 0, FAST)


def test_groups_must_follow_each_other(tmp_path: Path) -> None:
    baked = bake_group(clouds(2, 50), tmp_path, 0, 0, FAST)
    two = bake_group(clouds(2, 50), tmp_path, 1, 3, FAST)  # a gap
    with refuses("bake.manifest_invalid", file=tmp_path / "manifest.json"):
        write_manifest(tmp_path, [baked, two], 30, FAST)
    with refuses("bake.no_groups", file=tmp_path / "manifest.json"):
        write_manifest(tmp_path, [], 30, FAST)
    with refuses("bake.manifest_invalid", file=tmp_path / "manifest.json") as caught:
        write_manifest(tmp_path, [baked], float("nan"), FAST)
    assert "fps" in str(caught.value)
    file = tmp_path / baked.files[0].path
    file.write_bytes(b"short")
    with refuses("bake.group_changed", file=file, value=5, group=0):
        write_manifest(tmp_path, [baked], 30, FAST)


def test_a_power_cut_leaves_no_manifest_of_lost_files(make_ladder: MakeLadder, monkeypatch: pytest.MonkeyPatch) -> None:
    """All that a manifest names, and the manifest, is on the disk before the manifest has its name."""
    synced, at_the_name = set(), {}
    fsync, replace = os.fsync, os.replace

    def watched_fsync(descriptor):
        fsync(descriptor)
        synced.add(os.fstat(descriptor).st_ino)

    def watched_replace(source, target):
        replace(source, target)
        if str(target).endswith("manifest.json"):
            folder = os.path.dirname(target)
            files = [os.path.join(root, name) for root, _, names in os.walk(folder) for name in names]
            at_the_name.update({path: os.stat(path).st_ino in synced for path in files})

    monkeypatch.setattr(os, "fsync", watched_fsync)
    monkeypatch.setattr(os, "replace", watched_replace)
    folder = make_ladder((2, 1))
    files = {str(path) for path in folder.rglob("*") if path.is_file()}
    assert len(files) > 2
    assert files == {path for path, was in at_the_name.items() if was}
