"""Damaged files of groups: a clear error or frames, in bounded time and memory, and the other groups stay readable."""

import json
import shutil
from pathlib import Path

import pytest

from tests.studio.stream.conftest import FindStream, turned_bodies
from tests.support.errors import refuses
from tests.support.splats import assert_drawable
from tests.support.streams import best_of, damage, edit_manifest, group_files, only, put_file, set_at
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, check_stream, write_manifest
from v3studio.studio.stream.encode.bake import luma_checks
from v3studio.studio.stream.sidefile import deflate

FIRST = ("groups", 0, "renditions", 0)


def entry_of(values, group, name):
    """The JSON of a group's `side` or `video`."""
    return best_of(values["groups"][group])[name]


def file_of(stream, group, name):
    return stream / entry_of(json.loads((stream / "manifest.json").read_bytes()), group, name)["path"]


def replaced(stream, group, name, data, checks=None):
    """Replace a file's content and update all names, sizes and checksums, as a faulty or malicious writer would."""

    def change(values):
        entry = entry_of(values, group, name)
        entry.update({} if checks is None else {"checks": checks})
        best_of(values["groups"][group])["bytes"] += len(data) - entry["bytes"]
        put_file(stream, entry, data)

    edit_manifest(stream, change)
    return file_of(stream, group, name)


CODES = {
    "truncated": "stream.wrong_size",
    "longer": "source.file_too_long",
    "flipped": "stream.wrong_checksum",
    "missing": "source.file_missing",
    "a folder": "source.file_unreadable",
    "a link": "source.outside_folder",
}


@pytest.mark.parametrize(("kind", "name"), [("motion", "side"), ("motion", "video")])
def test_damaged_files_leave_the_other_group(copy_of: FindStream, tmp_path: Path, kind: str, name: str) -> None:
    stream = copy_of(kind)
    file = file_of(stream, 1, name)
    kept = file.read_bytes()
    for how, code in CODES.items():
        if how == "longer":
            file.write_bytes(kept + b"more")
        elif how == "a folder":
            file.unlink()
            file.mkdir()
        elif how == "a link":
            shutil.move(file, tmp_path / "elsewhere")
            file.symlink_to(tmp_path / "elsewhere")
        else:
            damage(file, how)
        with StreamReader.open(stream) as reader:
            assert len(list(reader.iterate(0, 4))) == 4
            with refuses(code, file=file):
                reader.gaussians(5)
            (found,) = check_stream(reader).damage
            assert (stream / found.file, found.groups) == (file, (1,))
            reader.gaussians(1)
        file.rmdir() if file.is_dir() and not file.is_symlink() else file.unlink(missing_ok=True)
        file.write_bytes(kept)


def test_videos_that_are_not_those_of_the_manifest(copy_of: FindStream, tmp_path: Path) -> None:
    stream, name = copy_of("motion"), "video"
    chosen = BakeSettings(quality=24, preset="ultrafast")

    def other(frames, splats):
        folder = tmp_path / f"{frames}-{splats}"
        group = bake_group(turned_bodies(frames, splats, 1), folder, 0, 0, chosen)
        return (folder / entry_of({"groups": [group.model_dump(mode="json")]}, 0, name)["path"]).read_bytes()

    with StreamReader.open(stream) as reader:
        size = reader.groups[1].size
    for data, code, expected in (
        (b"rubbish" * 100, "stream.video_unreadable", {}),
        (other(2, 80), "stream.video_too_short", {}),
        (other(50, 80), "stream.video_too_long", {"value": 50, "expected": 3}),
        (other(3, 600), "stream.wrong_video", {"expected": ("h264", *size)}),
    ):
        checks = luma_checks(data, size, 2) if code == "stream.video_too_short" else None
        file = replaced(stream, 1, name, data, checks)
        with StreamReader.open(stream) as reader, refuses(code, file=file, **expected):
            list(reader.iterate(4))


def test_a_decoder_that_is_not_exact_is_found(copy_of: FindStream) -> None:
    stream = copy_of("ladder")
    edit_manifest(stream, set_at((*FIRST, "video", "checks", 1, "crc32"), 1))
    with StreamReader.open(stream) as reader:
        reader.gaussians(0)
        with refuses("stream.wrong_luma", picture=1):
            reader.gaussians(1)
    with only(StreamReader.open(stream), "qp34") as reader:
        assert len(list(reader.iterate(0, 3))) == 3


def test_a_bomb_is_not_unpacked(copy_of: FindStream) -> None:
    stream = copy_of("motion")
    file = replaced(stream, 0, "side", deflate([bytes(20_000_000)]))
    with StreamReader.open(stream) as reader, refuses("stream.side_file_damaged", file=file):
        reader.gaussians(0)


def test_motion_without_bounds_is_refused(copy_of: FindStream) -> None:
    """Motion that exceeds all bounds is detected when the group is opened."""
    stream = copy_of("motion")
    edit_manifest(stream, set_at((*FIRST, "blocks", "step"), 1e9))
    file = group_files(stream, 0)[0]
    with StreamReader.open(stream) as reader, refuses("stream.side_file_damaged", file=file) as caught:
        reader.gaussians(0)
    assert "a block moves by more than 1e+09" in str(caught.value)


@pytest.mark.parametrize("count", [1, 3])
def test_escapes_without_bounds_are_refused(tmp_path: Path, count: int) -> None:
    """The codes of escapes have 32 bits: a step that suits the pixels can take them anywhere."""
    frames = turned_bodies(count, 200)
    for frame in frames:
        frame.sh[9, 0, :] = 2000.0
    baking = BakeSettings(preset="ultrafast")
    write_manifest(tmp_path, [bake_group(frames, tmp_path, 0, 0, baking)], 25, baking)
    with StreamReader.open(tmp_path) as reader:
        assert_drawable(reader.gaussians(count - 1))
    edit_manifest(tmp_path, set_at((*FIRST, "channels", 10, "step"), 7e6))
    file = group_files(tmp_path, 0)[0]
    with StreamReader.open(tmp_path) as reader, refuses("stream.side_file_damaged", file=file) as caught:
        reader.gaussians(count - 1)
    assert "an escape in sh_0_y has the value" in str(caught.value)


EXTREMES = (5e-324, 1e-300, 1e-9, 1e5, 1e8, 1e9, -1e9)
PLACES = (
    ("positions", "min", 0),
    ("positions", "step"),
    *(("blocks", name) for name in ("radius", "step", "rotation_step")),
    *(("channels", channel, name) for channel in (0, 3, 6, 9, 10) for name in ("offset", "step")),
)


def test_all_that_is_rendered_is_finite(copy_of: FindStream) -> None:
    """An extreme number at any place of a group is refused, or all frames have finite centers, scales and rotations."""
    stream = copy_of("motion")
    path = stream / "manifest.json"
    original = path.read_bytes()
    shown = refused = 0
    for place in PLACES:
        for value in EXTREMES:
            path.write_bytes(original)
            edit_manifest(stream, set_at((*FIRST, *place), value))
            try:
                with StreamReader.open(stream) as reader:
                    for frame in reader.iterate(0, 4):
                        assert_drawable(frame)
                shown += 1
            except StudioError:
                refused += 1
    assert shown > 20
    assert refused > 20
