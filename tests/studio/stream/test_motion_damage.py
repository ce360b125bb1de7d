"""Damaged streams of the profile `motion`: a clear error or frames, in bounded time and memory."""

import hashlib
import json
import time
import zlib

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from studio.errors import StudioError
from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.sidefile import deflate
from tests.support.errors import refuses
from tests.support.splats import assert_drawable
from tests.support.streams import damage, replace_file, set_at

QUICK = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def stream(make_stream):
    return make_stream((4, 3), splats=80, settings=BakeSettings(qp=24, preset="ultrafast", stream_version=2))[0]


def swap_entries(values):
    group = values["groups"][0]
    for key in ("path", "bytes", "sha256"):
        group["side"][key], group["video"][key] = group["video"][key], group["side"][key]


def swap_groups(values):
    first, second = values["groups"]
    first["side"], second["side"] = second["side"], first["side"]
    for group in (first, second):
        group["bytes"] = group["side"]["bytes"] + group["video"]["bytes"]


def widen(values):
    """64 columns of tiles of 272 pixels: a picture 17,408 pixels wide."""
    values["groups"][0].update(splats=70_000, tile=272, columns=64)


GROUP = ("groups", 0)
# change, then location and violated rule, or another code than manifest.invalid
DAMAGE = {
    "newer version": (set_at(("version",), 4), "manifest.newer_version"),
    "older version": (set_at(("version",), 1), ("version", "literal_error")),
    "the other profile": (set_at(("profile",), "planes"), ("scan", "literal_error")),
    "other codec": (set_at(("codec", "name"), "mjpeg"), ("codec.name", "literal_error")),
    "path outside": (set_at((*GROUP, "side", "path"), "../secret.bin"), ("groups.0.side", "unsafe_path")),
    "one file twice": (set_at((*GROUP, "side", "path"), "group_000/video.mp4"), ("", "duplicate_path")),
    "a billion splats": (set_at((*GROUP, "splats"), 10**9), ("groups.0.splats", "less_than_equal")),
    "more splats than tiles hold": (set_at((*GROUP, "splats"), 257), ("groups.0", "tile_side")),
    "a billion frames": (set_at((*GROUP, "frame_count"), 10**9), ("groups.0.frame_count", "less_than_equal")),
    "a tile of another size": (set_at((*GROUP, "tile"), 4096), ("groups.0", "tile_side")),
    "too few tiles": (set_at((*GROUP, "rows"), 1), ("groups.0", "tile_count")),
    "a picture that decoders do not take": (widen, ("groups.0", "picture_size")),
    "a million columns": (set_at((*GROUP, "columns"), 10**6), ("groups.0.columns", "less_than_equal")),
    "a petabyte once decompressed": (
        set_at((*GROUP, "side", "raw_bytes"), 10**15),
        ("groups.0.side.raw_bytes", "less_than_equal"),
    ),
    "more blocks than splats": (set_at((*GROUP, "blocks", "count"), 81), ("groups.0", "block_count")),
    "no blocks": (set_at((*GROUP, "blocks", "count"), 0), ("groups.0.blocks.count", "greater_than_equal")),
    "40 bits": (set_at((*GROUP, "positions", "bits"), 40), ("groups.0.positions.bits", "less_than_equal")),
    "a step of nothing": (set_at((*GROUP, "channels", 3, "step"), 0.0), ("groups.0.channels.3.step", "greater_than")),
    "a step that is no number": (
        set_at((*GROUP, "channels", 3, "step"), float("nan")),
        ("groups.0.channels.3.step", "finite_number"),
    ),
    "an offset without end": (
        set_at((*GROUP, "channels", 3, "offset"), float("inf")),
        ("groups.0.channels.3.offset", "finite_number"),
    ),
    "a channel of another name": (set_at((*GROUP, "channels", 3, "name"), "mean_x"), ("groups.0", "channels")),
    "a position far away": (set_at((*GROUP, "positions", "step"), 1e9), ("groups.0", "position_range")),
    "bytes that do not add up": (set_at((*GROUP, "bytes"), 12), ("groups.0", "bytes_sum")),
    "a radius of almost nothing": (set_at((*GROUP, "blocks", "radius"), 1e-300), ("groups.0", "block_radius")),
    "scales without end": (
        set_at((*GROUP, "channels", 6, "offset"), 90.0),
        ("groups.0.channels.6", "value_range"),
    ),
    "a step that takes scales too far": (
        set_at((*GROUP, "channels", 7, "step"), 0.5),
        ("groups.0.channels.7", "value_range"),
    ),
    "colors without end": (set_at((*GROUP, "channels", 10, "step"), 1e9), ("groups.0.channels.10", "value_range")),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damaged_manifest_is_refused(stream, edit_manifest, kind):
    change, expected = DAMAGE[kind]
    code, location, rule = (expected, None, None) if isinstance(expected, str) else ("manifest.invalid", *expected)
    edit_manifest(stream, change)
    began = time.process_time()
    with refuses(code, file=stream / "manifest.json", location=location, rule=rule) as caught:
        StreamReader.open(stream)
    assert time.process_time() - began < 1
    assert str(stream) in str(caught.value)
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("change", "code", "file"),
    [
        (swap_entries, "stream.video_unreadable", "group_000/motion.bin"),
        (swap_groups, "stream.side_file_damaged", "group_001/motion.bin"),
    ],
)
def test_swapped_files(stream, edit_manifest, change, code, file):
    edit_manifest(stream, change)
    with StreamReader.open(stream) as reader, refuses(code, file=stream / file):
        list(reader.iterate())


@pytest.mark.parametrize("name", ["motion.bin", "video.mp4"])
@pytest.mark.parametrize("how", ["truncated", "flipped", "missing"])
def test_damaged_files_leave_the_other_group(stream, name, how):
    file = stream / "group_001" / name
    damage(file, how)
    with StreamReader.open(stream) as reader:
        reader.gaussians(0)
        code = {"truncated": "stream.wrong_size", "flipped": "stream.wrong_checksum", "missing": "source.file_missing"}
        with refuses(code[how], file=file):
            reader.gaussians(5)
        assert len(list(reader.iterate(1, 4))) == 3


def outcome(stream):
    """Reading gives valid frames or an error about the first group; the second group stays readable."""
    began = time.process_time()
    with StreamReader.open(stream) as reader:
        try:
            frames = list(reader.iterate(0, 4))
        except StudioError as error:
            message, frames = str(error), []
        assert len(list(reader.iterate(4))) == 3
    assert frames or "group_000/" in message
    assert time.process_time() - began < 5
    for frame in frames:
        assert len(frame) == 80
        assert_drawable(frame)


@QUICK
@given(data=st.data())
def test_signed_changes_of_the_side_files_content(stream, edit_manifest, data):
    """Arbitrary bytes at arbitrary places of the decompressed side file."""
    manifest = (stream / "manifest.json").read_bytes()
    file = stream / "group_000" / "motion.bin"
    original = file.read_bytes()
    raw = bytearray(zlib.decompress(original, wbits=-15))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(raw) - 1))
        raw[at : at + 1] = data.draw(st.binary(max_size=3))
    try:
        replace_file(stream, 0, "side", deflate([bytes(raw)]), len(raw))
        outcome(stream)
    finally:
        file.write_bytes(original)
        (stream / "manifest.json").write_bytes(manifest)


@QUICK
@given(data=st.data(), key=st.sampled_from(["side", "video"]))
def test_signed_changes_of_the_files(stream, edit_manifest, data, key):
    manifest = (stream / "manifest.json").read_bytes()
    file = stream / "group_000" / {"side": "motion.bin", "video": "video.mp4"}[key]
    original = file.read_bytes()
    broken = bytearray(original)
    at = data.draw(st.integers(0, len(broken) - 1))
    broken[at : at + data.draw(st.integers(0, 20))] = data.draw(st.binary(max_size=20))
    assume(broken)
    try:
        replace_file(stream, 0, key, bytes(broken))
        outcome(stream)
    finally:
        file.write_bytes(original)
        (stream / "manifest.json").write_bytes(manifest)


@QUICK
@given(data=st.data())
def test_any_value_anywhere_in_the_manifest(stream, edit_manifest, data):
    path = stream / "manifest.json"
    original = path.read_bytes()
    at = json.loads(original)
    keys = []
    while True:
        keys.append(data.draw(st.sampled_from(list(at) if isinstance(at, dict) else list(range(len(at))))))
        if not isinstance(at[keys[-1]], dict | list) or not at[keys[-1]] or data.draw(st.booleans()):
            break
        at = at[keys[-1]]
    value = data.draw(
        st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.just([]), st.just({}))
    )
    began, message = time.process_time(), None
    try:
        edit_manifest(stream, set_at(keys, value))
        with StreamReader.open(stream) as reader:
            assert len(list(reader.iterate())) == 7
    except StudioError as error:
        message = str(error)
    except (TypeError, KeyError):
        assume(False)  # no groups left whose sizes could be added up
    finally:
        path.write_bytes(original)
    assert message is None or str(stream) in message
    assert time.process_time() - began < 5


def test_more_pictures_than_frames_in_a_group(stream, edit_manifest, make_frames, tmp_path):
    """Decoding them would take longer than the manifest promises."""
    settings = BakeSettings(qp=24, preset="ultrafast", stream_version=2)
    bake_group(make_frames(20, 80), tmp_path / "long", 0, 0, settings)
    data = (tmp_path / "long" / "group_000" / "video.mp4").read_bytes()

    def change(values):
        group = values["groups"][0]
        group["bytes"] += len(data) - group["video"]["bytes"]
        group["video"].update(bytes=len(data), sha256=hashlib.sha256(data).hexdigest())

    (stream / "group_000" / "video.mp4").write_bytes(data)
    edit_manifest(stream, change)
    with StreamReader.open(stream) as reader:
        with refuses("stream.video_too_long", file=stream / "group_000" / "video.mp4", value=20, expected=4):
            reader.gaussians(0)
        assert len(list(reader.iterate(4))) == 3


def test_a_bomb_is_not_unpacked(stream):
    bomb = deflate([bytes(20_000_000)])
    replace_file(stream, 0, "side", bomb)
    began = time.process_time()
    with (
        StreamReader.open(stream) as reader,
        refuses("stream.side_file_damaged", file=stream / "group_000" / "motion.bin"),
    ):
        reader.gaussians(0)
    assert time.process_time() - began < 1


def test_motion_without_bounds_is_refused(tmp_path, turning_bodies, edit_manifest):
    """Motion that exceeds all bounds is detected when the group is opened."""
    baking = BakeSettings(preset="ultrafast", stream_version=2)
    write_manifest(tmp_path, [bake_group(turning_bodies(3, 200), tmp_path, 0, 0, baking)], 25, baking)
    edit_manifest(tmp_path, set_at(("groups", 0, "blocks", "step"), 1e9))
    file = tmp_path / "group_000" / "motion.bin"
    with StreamReader.open(tmp_path) as reader, refuses("stream.side_file_damaged", file=file) as caught:
        reader.gaussians(0)
    assert str(caught.value) == (
        f"{file}: the side file is damaged: a block moves by more than 1e+09. Bake the stream again, or copy it again."
    )


EXTREMES = (5e-324, 1e-300, 1e-9, 1e5, 1e8, 1e9, -1e9)
PLACES = (
    *(("positions", "min", axis) for axis in range(3)),
    ("positions", "step"),
    *(("blocks", name) for name in ("radius", "step", "rotation_step")),
    *(("channels", channel, name) for channel in (0, 3, 6, 9, 10) for name in ("offset", "step")),
)


def test_all_that_is_drawn_is_finite(stream, edit_manifest):
    """An extreme number at any place of a group is refused, or all frames have finite centers, scales and rotations."""
    path = stream / "manifest.json"
    original = path.read_bytes()
    drawn = refused = 0
    for place in PLACES:
        for value in EXTREMES:
            path.write_bytes(original)
            edit_manifest(stream, set_at((*GROUP, *place), value))
            try:
                with StreamReader.open(stream) as reader:
                    for frame in reader.iterate(0, 4):
                        assert_drawable(frame)
                drawn += 1
            except StudioError:
                refused += 1
    assert drawn > 20
    assert refused > 20


def test_escapes_without_bounds_are_refused(tmp_path, turning_bodies, edit_manifest):
    """The codes of escapes have 32 bits: a step that suits the pixels can take them anywhere."""
    frames = turning_bodies(3, 200)
    for frame in frames:
        frame.sh[9, 0, :] = 2000.0
    baking = BakeSettings(preset="ultrafast", stream_version=2)
    write_manifest(tmp_path, [bake_group(frames, tmp_path, 0, 0, baking)], 25, baking)
    with StreamReader.open(tmp_path) as reader:
        assert_drawable(reader.gaussians(1))
    edit_manifest(tmp_path, set_at(("groups", 0, "channels", 10, "step"), 7e6))
    file = tmp_path / "group_000" / "motion.bin"
    with StreamReader.open(tmp_path) as reader, refuses("stream.side_file_damaged", file=file) as caught:
        reader.gaussians(1)
    assert "an escape in sh_0_y has the value" in str(caught.value)
