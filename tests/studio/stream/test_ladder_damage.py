"""Damaged streams of version 3: a clear error or frames, in bounded memory, whatever is wrong."""

import json
import shutil
import zlib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from studio.errors import StudioError
from studio.stream import StreamReader, write_ladder
from studio.stream.ladder_manifest import parse_ladder
from studio.stream.sidefile import deflate
from tests.studio.stream.conftest import write_stream
from tests.support.errors import refuses
from tests.support.streams import put_file, set_at, write_sealed

QUICK = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def intact(tmp_path_factory):
    """Three groups, two of them in a page, and sound."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(write_ladder, "INLINE_BYTES", 1)
        return write_stream(tmp_path_factory.mktemp("intact") / "stream", (3, 2, 2), splats=80, clicks=[0.1])


@pytest.fixture
def stream(intact, tmp_path):
    """A copy, to damage."""
    return shutil.copytree(intact, tmp_path / "stream")


def nested(depth):
    value = 1
    for _ in range(depth):
        value = [value]
    return value


def swap_names(values):
    first, second = values["groups"][0]["renditions"][:2]
    first["video"]["path"], second["video"]["path"] = second["video"]["path"], first["video"]["path"]


def same_ids(values):
    for one in (values, values["groups"][0]):
        one["renditions"][1]["id"] = one["renditions"][0]["id"]


GROUP = ("groups", 0)
FIRST = (*GROUP, "renditions", 0)
# change, then location and violated rule, or another code than manifest.invalid
DAMAGE = {
    "newer version": (set_at(("version",), 4), "manifest.newer_version"),
    "a profile that is none": (set_at(("profile",), 7), "manifest.unknown_profile"),
    "the other profile": (set_at(("profile",), "planes"), ("scan", "literal_error")),
    "renditions that disagree in frames": (set_at((*FIRST, "frame_count"), 2), ("groups.0", "rendition_frames")),
    "renditions that disagree in their first frame": (
        set_at((*FIRST, "first_frame"), 1),
        ("groups.0", "rendition_frames"),
    ),
    "a rendition missing": (lambda v: v["groups"][0]["renditions"].pop(), ("", "rendition_ids")),
    "renditions in another order": (lambda v: v["groups"][0]["renditions"].reverse(), ("", "rendition_ids")),
    "two renditions of one name": (same_ids, ("", "rendition_ids")),
    "an id that is none": (set_at(("renditions", 0, "id"), "../x"), ("renditions.0.id", "string_pattern_mismatch")),
    "no renditions": (set_at(("renditions",), []), ("renditions", "too_short")),
    "more splats than promised": (set_at(("renditions", 0, "splats"), 79), ("", "rendition_splats")),
    "another SH degree": (set_at(("renditions", 0, "sh_degree"), 0), ("", "sh_degree")),
    "a name that is not the content's": (swap_names, ("groups.0.renditions.0", "path_not_hash")),
    "a path outside": (set_at((*FIRST, "video", "path"), "../a.mp4"), ("groups.0.renditions.0.video", "unsafe_path")),
    "checks of no picture": (
        set_at((*FIRST, "video", "checks"), []),
        ("groups.0.renditions.0.video.checks", "too_short"),
    ),
    "checks beyond the end": (
        set_at((*FIRST, "video", "checks", 1, "picture"), 3),
        ("groups.0.renditions.0", "checks"),
    ),
    "a check of 33 bits": (
        set_at((*FIRST, "video", "checks", 0, "crc32"), 1 << 32),
        ("groups.0.renditions.0.video.checks.0.crc32", "less_than"),
    ),
    "groups that begin late": (set_at((*GROUP, "index"), 1), ("groups.0", "rendition_frames")),
    "no group in the manifest": (set_at(("groups",), []), ("groups", "too_short")),
    "a page of a petabyte": (set_at(("pages", 0, "bytes"), 10**15), ("pages.0.bytes", "less_than_equal")),
    "a page without groups": (set_at(("pages", 0, "frames"), []), ("pages.0.frames", "too_short")),
    "frames that are not in the pages": (set_at(("frame_count",), 8), ("", "frame_count")),
    "metadata without end": (set_at(("metadata", "x"), nested(17)), ("metadata", "free_form")),
    "two megabytes of metadata": (set_at(("metadata", "x"), "y" * (2 << 20)), ("metadata", "free_form")),
    "settings without end": (set_at(("settings", "x"), nested(40)), ("settings", "free_form")),
    "sound without a size": (set_at(("audio",), {"path": "files/a.m4a"}), ("audio.bytes", "missing")),
    "sound of another codec": (set_at(("audio", "codec"), "mp3"), ("audio.codec", "literal_error")),
    "sound before the frames": (set_at(("audio", "start"), -0.5), ("audio.start", "greater_than_equal")),
    "sound longer than the frames": (set_at(("audio", "samples"), 48_000), ("", "audio_length")),
    "sound that starts late": (set_at(("audio", "start"), 0.15), ("", "audio_length")),
    "sound without samples": (set_at(("audio", "samples"), 0), ("audio.samples", "greater_than_equal")),
    "sound of 50 channels": (set_at(("audio", "channels"), 50), ("audio.channels", "less_than_equal")),
    "sound of a gigabyte": (set_at(("audio", "bytes"), 1 << 30), ("audio.bytes", "less_than_equal")),
    "sound that is not named by its content": (
        set_at(("audio", "path"), f"files/{'0' * 32}.m4a"),
        ("audio", "path_not_hash"),
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damaged_manifest_is_refused(stream, edit_manifest, kind):
    change, expected = DAMAGE[kind]
    code, location, rule = (expected, None, None) if isinstance(expected, str) else ("manifest.invalid", *expected)
    edit_manifest(stream, change)
    with refuses(code, file=stream / "manifest.json", location=location, rule=rule) as caught:
        StreamReader.open(stream)
    assert len(str(caught.value)) < 600


def change_page(folder, change):
    """Change the page and store it under its new name."""
    path = folder / "manifest.json"
    values = json.loads(path.read_bytes())
    page = values["pages"][0]
    content = json.loads((folder / page["path"]).read_bytes())
    change(content)
    put_file(folder, page, json.dumps(content).encode())
    write_sealed(path, values)


PAGE_DAMAGE = {
    "other frames": (lambda v: v["groups"].pop(), "page_frames"),
    "another first group": (lambda v: v["groups"].reverse(), "group_order"),
    "no groups": (set_at(("groups",), []), "too_short"),
    "another format": (set_at(("format",), "x"), "literal_error"),
    "a rendition missing": (lambda v: v["groups"][1]["renditions"].pop(), "rendition_ids"),
    "renditions that disagree in frames": (
        set_at(("groups", 1, "renditions", 1, "frame_count"), 3),
        "rendition_frames",
    ),
    "another SH degree": (set_at(("groups", 0, "renditions", 0, "sh_degree"), 2), "channels"),
}


@pytest.mark.parametrize("kind", PAGE_DAMAGE)
def test_pages_that_lie(stream, kind):
    change, rule = PAGE_DAMAGE[kind]
    change_page(stream, change)
    with StreamReader.open(stream) as reader:
        assert len(reader.gaussians(2).means) == 80  # what is in the manifest plays
        with refuses("manifest.invalid", rule=rule):
            reader.gaussians(3)


def test_pages_that_are_damaged_or_missing(stream):
    path = stream / json.loads((stream / "manifest.json").read_bytes())["pages"][0]["path"]
    data = path.read_bytes()
    path.write_bytes(data.replace(b'"qp34"', b'"qp35"', 1))
    with StreamReader.open(stream) as reader, refuses("stream.wrong_checksum", file=str(path)):
        reader.gaussians(3)
    path.write_bytes(data + b" ")
    with StreamReader.open(stream) as reader, refuses("source.file_too_long"):
        reader.gaussians(3)
    path.unlink()
    with StreamReader.open(stream) as reader, refuses("source.file_missing"):
        reader.gaussians(3)


def test_a_total_that_is_wrong_is_found_by_verifying(stream, edit_manifest):
    edit_manifest(stream, lambda values: None)  # its total leaves out what is in the page
    with StreamReader.open(stream) as reader, refuses("manifest.wrong_total"):
        reader.verify()


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**60), 2**60),
    st.floats(allow_nan=True, allow_infinity=True),
    st.text(max_size=8),
    st.lists(st.integers(0, 3), max_size=3),
    st.dictionaries(st.sampled_from(["id", "path", "x"]), st.integers(), max_size=2),
)


def mutate(data, values):
    """Replace a value somewhere."""
    at = values
    for _ in range(12):
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        if not keys:
            return
        key = data.draw(st.sampled_from(keys))
        if isinstance(at[key], dict | list) and at[key] and data.draw(st.integers(0, 9)):
            at = at[key]
            continue
        at[key] = data.draw(VALUES)
        return


@given(st.data())
@QUICK
def test_any_manifest_gives_frames_or_a_clear_error(stream, data):
    path = stream / "manifest.json"
    kept = path.read_bytes()
    try:
        values = json.loads(kept)
        for _ in range(data.draw(st.integers(1, 3))):
            mutate(data, values)
        try:
            write_sealed(path, values)
            parse_ladder(path.read_bytes(), "m")
            with StreamReader.open(stream) as reader:
                reader.gaussians(0)
                read_sound(reader)
        except StudioError as error:
            assert len(str(error)) < 1000  # noqa: PT017
    finally:
        path.write_bytes(kept)


def read_sound(reader):
    """Decode the sound from its middle and from its start."""
    sound = reader.sound()
    if sound is not None:
        try:
            sound.read(sound.samples // 2, 2000)
            sound.read(0, 2000)
        finally:
            sound.close()


@given(st.data())
@QUICK
def test_any_sound_file_gives_samples_or_a_clear_error(stream, data):
    """Mutated under a name and checksum that fit, so that the mutation reaches the demuxer and the decoder."""
    kept = (stream / "manifest.json").read_bytes()
    try:
        values = json.loads(kept)
        content = bytearray((stream / values["audio"]["path"]).read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        put_file(stream, values["audio"], bytes(content[: data.draw(st.integers(1, len(content)))]))
        write_sealed(stream / "manifest.json", values)
        with StreamReader.open(stream) as reader:
            try:
                read_sound(reader)
            except StudioError as error:
                assert error.code in ("stream.sound_damaged", "stream.wrong_sound")  # noqa: PT017
    finally:
        (stream / "manifest.json").write_bytes(kept)


@given(st.data())
@QUICK
def test_any_page_gives_frames_or_a_clear_error(stream, data):
    kept = (stream / "manifest.json").read_bytes()
    try:
        change_page(stream, lambda values: mutate(data, values))
        with StreamReader.open(stream) as reader:
            try:
                reader.gaussians(3)
            except StudioError as error:
                assert len(str(error)) < 1000  # noqa: PT017
    finally:
        (stream / "manifest.json").write_bytes(kept)


@given(st.data())
@QUICK
def test_any_side_file_gives_frames_or_a_clear_error(stream, data):
    """Mutated before compression, so that the mutation reaches the parser."""
    kept = (stream / "manifest.json").read_bytes()
    try:
        values = json.loads(kept)
        side = values["groups"][0]["renditions"][0]["side"]
        raw = bytearray(zlib.decompress((stream / side["path"]).read_bytes(), wbits=-15))
        for _ in range(data.draw(st.integers(1, 4))):
            raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
        before = side["bytes"]
        put_file(stream, side, deflate([bytes(raw)]))
        values["groups"][0]["renditions"][0]["bytes"] += side["bytes"] - before
        write_sealed(stream / "manifest.json", values)
        with StreamReader.open(stream) as reader:
            try:
                reader.gaussians(0)
            except StudioError as error:
                assert error.code == "stream.side_file_damaged"  # noqa: PT017
    finally:
        (stream / "manifest.json").write_bytes(kept)
