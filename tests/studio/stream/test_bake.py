"""Files of a baked group: determinism, layout, decoding with other libraries, and atomicity."""

import json
import os

import numpy as np
import pytest
import torch

from studio.errors import Cancelled
from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.layout import plane_side
from studio.stream.morton import morton_order
from tests.support.errors import refuses


def contents(folder):
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


PLANES = BakeSettings(profile="planes")


def bake(folder, frames, threads=0, **settings):
    settings = PLANES.replace(**settings)
    entry = bake_group(frames, folder, 0, 0, settings, threads=threads)
    return write_manifest(folder, [entry], 30, settings)


def test_same_input_gives_the_same_bytes(tmp_path, make_frames):
    frames = make_frames(5, 500)
    bake(tmp_path / "a", frames, quality=20, threads=1)
    bake(tmp_path / "b", frames, quality=20, threads=4)
    bake(tmp_path / "b", frames, quality=20)  # over what is there
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert 10 < len(contents(tmp_path / "a")) <= 18  # equal planes share a file


def test_iterator_gives_the_same_as_a_list(tmp_path, make_frames):
    frames = make_frames(3, 100)
    bake(tmp_path / "a", frames)
    bake(tmp_path / "b", iter(frames))
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_order_of_the_input_does_not_matter(tmp_path, make_frames):
    frames = make_frames(3, 100)
    shuffle = torch.randperm(100, generator=torch.Generator().manual_seed(1))
    bake(tmp_path / "a", frames)
    bake(tmp_path / "b", [frame[shuffle] for frame in frames])
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_videos_are_i_then_p_full_range_and_free_of_dates(tmp_path, make_frames):
    import av

    manifest = bake(tmp_path, make_frames(6, 100), quality=20)
    for plane in manifest.groups[0].best.videos:
        path = tmp_path / plane.path
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            assert stream.codec_context.codec.canonical_name == "h264"
            assert stream.codec_context.color_range == 2  # full
            types = [int(frame.pict_type) for frame in container.decode(stream)]
            assert types == [1] + [2] * 5  # AV_PICTURE_TYPE_I, then _P
            assert "creation_time" not in container.metadata
            assert "creation_time" not in stream.metadata
        assert b"Lavf" not in path.read_bytes()


def test_opencv_reads_the_planes_as_we_do(tmp_path, make_frames):
    """With an independent decoder and formula: means from high and low pictures."""
    import cv2

    frames = make_frames(4, 300)
    manifest = bake(tmp_path, frames, quality=20, mirror_low_bytes=False)
    group = manifest.groups[0].best

    def pictures(path):
        capture = cv2.VideoCapture(str(tmp_path / path))
        found = []
        while True:
            ok, picture = capture.read()
            if not ok:
                return found
            found.append(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).reshape(-1)[:300].astype(np.float64))

    decoded = {component.name: [pictures(plane.path) for plane in component.planes] for component in group.components}
    ranges = {component.name: (component.min, component.max) for component in group.components}
    with StreamReader.open(tmp_path) as reader:
        for index, gaussians in enumerate(reader.iterate()):
            for i, axis in enumerate("xyz"):
                low, high = ranges[f"mean_{axis}"]
                high_byte, low_byte = (part[index] for part in decoded[f"mean_{axis}"])
                wanted = low + (high_byte * 256 + low_byte) / 65535 * (high - low)
                assert np.abs(wanted - gaussians.means[:, i].numpy()).max() < 1e-5
            for i in range(3):
                low, high = ranges[f"log_scale_{i}"]
                wanted = low + decoded[f"log_scale_{i}"][0][index] / 255 * (high - low)
                assert np.abs(wanted - gaussians.log_scales[:, i].numpy()).max() < 1e-5
    assert all(len(part) == 4 for parts in decoded.values() for part in parts)


def test_plane_holds_splats_row_by_row(tmp_path, make_frames):
    import cv2

    frames = make_frames(1, 70)
    bake(tmp_path, frames, quality=0)
    opacities = frames[0].opacities[torch.from_numpy(morton_order(frames[0].means.numpy()))].numpy()
    _, picture = cv2.VideoCapture(str(tmp_path / "group_000/opacity.mp4")).read()
    plane = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    assert plane.shape == (16, 16)
    codes = np.rint((opacities - opacities.min()) / (opacities.max() - opacities.min()) * 255)
    assert np.abs(plane.reshape(-1)[:70] - codes).max() <= 1  # ties of rounding
    assert plane[3, 5] == plane.reshape(-1)[3 * 16 + 5]


@pytest.mark.parametrize(("splats", "side"), [(1, 8), (64, 8), (65, 16), (256, 16), (257, 24), (60_000, 248)])
def test_plane_side(splats, side):
    assert plane_side(splats) == side


def test_total_bytes_are_those_on_disk(make_stream):
    folder, _ = make_stream((2, 2, 2))
    values = json.loads((folder / "manifest.json").read_text())
    assert values["total_bytes"] == sum(len(data) for data in contents(folder).values())
    assert values["frame_count"] == 6
    assert values["fps"] == 25.0
    assert [group["first_frame"] for group in values["groups"]] == [0, 2, 4]


def test_bounding_box_holds_all_centers(make_stream):
    folder, groups = make_stream((3, 3))
    means = torch.cat([frame.means for frames in groups for frame in frames]).double()
    with StreamReader.open(folder) as reader:
        box = reader.manifest.bounding_box
    assert list(box.min) == means.amin(0).tolist()
    assert list(box.max) == means.amax(0).tolist()


def test_cancelled_bake_leaves_what_was_there(tmp_path, make_frames):
    frames = make_frames(3, 100)
    bake(tmp_path, frames)
    before = contents(tmp_path)

    def stop(done, total, **figures):
        if done == 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        bake_group(make_frames(3, 100, seed=5), tmp_path, 0, 0, PLANES, progress=stop)
    assert contents(tmp_path) == before


def test_progress_counts_frames(tmp_path, make_frames):
    calls = []
    bake_group(
        make_frames(3, 50),
        tmp_path,
        0,
        0,
        PLANES,
        progress=lambda done, total, **f: calls.append((done, total)),
    )
    assert calls[-3:] == [(1, 3), (2, 3), (3, 3)]


def test_bad_frames_are_refused(tmp_path, make_frames):
    frames = make_frames(3, 100)
    with refuses("bake.no_frames", group=0):
        bake_group([], tmp_path, 0, 0, PLANES)
    with refuses("bake.no_splats"):
        bake_group([frames[0][:0]], tmp_path, 0, 0, PLANES)
    with refuses("bake.mixed_frames", frame=1, value=(99, 0), expected=(100, 0)):
        bake_group([frames[0], frames[1][:99]], tmp_path, 0, 0, PLANES)
    with refuses("bake.mixed_frames", frame=1, value=(100, 1), expected=(100, 0)):
        bake_group([frames[0], frames[1].with_sh_degree(1)], tmp_path, 0, 0, PLANES)
    frames[2].sh[4, 0, 1] = float("nan")
    with refuses("gaussians.not_finite", frame=2, attribute="sh"):
        bake_group(frames, tmp_path, 0, 0, PLANES)
    assert contents(tmp_path) == {}


def test_folder_that_cannot_be_made(tmp_path, make_frames):
    (tmp_path / "file").write_text("no folder")
    with refuses("bake.write_failed", file=tmp_path / "file" / "group_000"):
        bake_group(make_frames(1, 50), tmp_path / "file", 0, 0, PLANES)


def test_groups_must_follow_each_other(tmp_path, make_frames):
    one = bake_group(make_frames(2, 50), tmp_path, 0, 0, PLANES)
    two = bake_group(make_frames(2, 50), tmp_path, 1, 3, PLANES)  # a gap
    with refuses("bake.manifest_invalid", file=tmp_path / "manifest.json") as caught:
        write_manifest(tmp_path, [one, two], 30, PLANES)
    assert "group 1 has index 1 and starts at frame 3" in str(caught.value)
    with refuses("bake.no_groups", file=tmp_path / "manifest.json"):
        write_manifest(tmp_path, [], 30, PLANES)
    with refuses("bake.manifest_invalid", file=tmp_path / "manifest.json") as caught:
        write_manifest(tmp_path, [one], float("nan"), PLANES)
    assert "fps" in str(caught.value)
    (tmp_path / "group_000" / "opacity.mp4").write_bytes(b"short")
    with refuses("bake.group_changed", file=tmp_path / "group_000" / "opacity.mp4", value=5, group=0):
        write_manifest(tmp_path, [one], 30, PLANES)


@pytest.mark.parametrize("version", [2, 3])
def test_a_power_cut_leaves_no_manifest_of_lost_files(make_stream, make_ladder, monkeypatch, version):
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
    folder = make_stream((2, 1))[0] if version == 2 else make_ladder((2, 1))
    files = {str(path) for path in folder.rglob("*") if path.is_file()}
    assert len(files) > 2
    assert files == {path for path, was in at_the_name.items() if was}
