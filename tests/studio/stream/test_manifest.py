"""Damaged manifests and files of the profile `planes` are refused with a clear error."""

import hashlib
import json
import re
import shutil
import time
from pathlib import Path

import pytest
import torch
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from studio.errors import StudioError
from studio.stream import BakeSettings, GroupEntry, StreamReader, bake_group, ladder_models, manifest_models
from studio.stream.manifest import parse_manifest, seal
from tests.support.errors import refuses
from tests.support.splats import assert_drawable
from tests.support.streams import set_at

ROOT = Path(__file__).parents[3]


def swap(values):
    values["groups"].reverse()


def drop_component(values):
    values["groups"][0]["components"].pop()


PLANES = BakeSettings(profile="planes", stream_version=2)
PLANE = ("groups", 0, "components", 3, "planes", 0)
# change, then location and violated rule, or another code than manifest.invalid
DAMAGE = {
    "newer version": (set_at(("version",), 4), "manifest.newer_version"),
    "version that is no number": (set_at(("version",), "1"), ("version", "literal_error")),
    "other format": (set_at(("format",), "something"), "manifest.wrong_format"),
    "other profile": (set_at(("profile",), "gaussian"), "manifest.unknown_profile"),
    "profile of other groups": (set_at(("profile",), "motion"), ("scan", "literal_error")),
    "path outside": (set_at((*PLANE, "path"), "../secret.mp4"), ("groups.0.components.3.planes.0", "unsafe_path")),
    "absolute path": (set_at((*PLANE, "path"), "/etc/passwd"), ("groups.0.components.3.planes.0", "unsafe_path")),
    "hidden path outside": (
        set_at((*PLANE, "path"), "group_000/../../secret.mp4"),
        ("groups.0.components.3.planes.0", "unsafe_path"),
    ),
    "backslash path": (set_at((*PLANE, "path"), "..\\secret.mp4"), ("groups.0.components.3.planes.0", "unsafe_path")),
    "path with a line break": (
        set_at((*PLANE, "path"), "group_000/opacity.mp4\n"),
        ("groups.0.components.3.planes.0", "unsafe_path"),
    ),
    "path used twice": (set_at((*PLANE, "path"), "group_000/opacity.mp4"), ("", "duplicate_path")),
    "manifest as a plane": (set_at((*PLANE, "path"), "manifest.json"), ("", "duplicate_path")),
    "a billion splats": (set_at(("groups", 0, "splats"), 10**9), ("groups.0.splats", "less_than_equal")),
    "side that does not fit": (set_at(("groups", 0, "side"), 8000), ("groups.0", "plane_side")),
    "no splats": (set_at(("groups", 0, "splats"), 0), ("groups.0.splats", "greater_than_equal")),
    "a billion frames": (set_at(("frame_count",), 10**9), ("frame_count", "less_than_equal")),
    "more frames than there are": (set_at(("frame_count",), 8), ("", "frame_count")),
    "a billion frames in a group": (
        set_at(("groups", 0, "frame_count"), 10**9),
        ("groups.0.frame_count", "less_than_equal"),
    ),
    "frames as text": (set_at(("frame_count",), "7"), ("frame_count", "int_type")),
    "range that is not a number": (
        set_at(("groups", 0, "components", 3, "min"), float("nan")),
        ("groups.0.components.3.min", "finite_number"),
    ),
    "infinite range": (
        set_at(("groups", 0, "components", 3, "max"), float("inf")),
        ("groups.0.components.3.max", "finite_number"),
    ),
    "huge range": (
        set_at(("groups", 0, "components", 3, "max"), 1e300),
        ("groups.0.components.3.max", "less_than_equal"),
    ),
    "range the wrong way": (
        set_at(("groups", 0, "components", 3, "min"), 1e6),
        ("groups.0.components.3", "range_order"),
    ),
    "scales without end": (
        set_at(("groups", 0, "components", 7, "max"), 90.0),
        ("groups.0.components.7", "value_range"),
    ),
    "a rate of zero": (set_at(("fps",), 0), ("fps", "greater_than")),
    "a rate that is not a number": (set_at(("fps",), float("nan")), ("fps", "finite_number")),
    "file of a petabyte": (
        set_at((*PLANE, "bytes"), 10**15),
        ("groups.0.components.3.planes.0.bytes", "less_than_equal"),
    ),
    "negative size": (set_at((*PLANE, "bytes"), -5), ("groups.0.components.3.planes.0.bytes", "greater_than_equal")),
    "checksum that is none": (
        set_at((*PLANE, "sha256"), "xyz"),
        ("groups.0.components.3.planes.0.sha256", "string_pattern_mismatch"),
    ),
    "other part": (set_at((*PLANE, "part"), "high"), ("groups.0", "parts")),
    "groups in the wrong order": (swap, ("", "group_order")),
    "a component missing": (drop_component, ("groups.0", "components")),
    "no groups": (set_at(("groups",), []), ("groups", "too_short")),
    "groups as a number": (set_at(("groups",), 3), ("groups", "tuple_type")),
    "SH degree that does not fit": (set_at(("sh_degree",), 1), ("", "sh_degree")),
}


@pytest.fixture
def stream(make_stream):
    return make_stream((4, 3), splats=80)[0]


def test_edit_alone_is_no_damage(stream, edit_manifest):
    edit_manifest(stream, lambda values: values.update(later_addition={"x": 1}))
    with StreamReader.open(stream) as reader:
        assert reader.frame_count == 7


def test_streams_of_version_1_are_read(stream, edit_manifest):
    with StreamReader.open(stream) as reader:
        ours = list(reader.iterate())
    edit_manifest(stream, lambda values: values.update(version=1))
    with StreamReader.open(stream) as reader:
        theirs = list(reader.iterate())
    assert all(torch.equal(a.means, b.means) for a, b in zip(ours, theirs, strict=True))


@pytest.mark.parametrize("kind", DAMAGE)
def test_damaged_manifest_is_refused(stream, edit_manifest, kind):
    change, expected = DAMAGE[kind]
    code, location, rule = (expected, None, None) if isinstance(expected, str) else ("manifest.invalid", *expected)
    try:
        edit_manifest(stream, change)
    except TypeError:  # no sizes to add up any more
        values = json.loads((stream / "manifest.json").read_bytes())
        change(values)
        (stream / "manifest.json").write_text(json.dumps(values))
    began = time.process_time()
    with refuses(code, file=stream / "manifest.json", location=location, rule=rule) as caught:
        StreamReader.open(stream)
    assert time.process_time() - began < 1
    text = str(caught.value)
    assert str(stream) in text
    assert len(text) < 600
    assert "\n" not in text


def test_sentences_name_file_value_and_fix(stream, edit_manifest):
    path = stream / "manifest.json"
    edit_manifest(stream, set_at((*PLANE, "path"), "../secret.mp4"))
    with pytest.raises(StudioError) as caught:
        StreamReader.open(stream)
    assert str(caught.value) == (
        f"{path}: groups.0.components.3.planes.0: '../secret.mp4' is not a plain relative path below the manifest's "
        "folder. Bake the stream again, or copy it again."
    )


@pytest.mark.parametrize(
    "data", [b"", b"{", b"null", b"[]", b"\xff\xfe\x00", b'{"format": "v3studio-stream"}', b"[" * 99999]
)
def test_what_is_no_manifest(stream, data):
    (stream / "manifest.json").write_bytes(data)
    with pytest.raises(StudioError) as caught:
        StreamReader.open(stream)
    assert caught.value.code in ("manifest.not_json", "manifest.wrong_format", "manifest.unknown_profile")
    assert caught.value.file == str(stream / "manifest.json")


@pytest.mark.parametrize("text", [b"[],", b"1,", b'{"a":1},'])
def test_60_megabytes_of_small_values_are_refused_before_they_are_parsed(stream, text, monkeypatch):
    """They would take gigabytes."""
    parsed = []
    monkeypatch.setattr(json, "loads", lambda *_, **__: parsed.append(1))
    (stream / "manifest.json").write_bytes(b'{"groups": [' + text * (60_000_000 // len(text)) + b"0]}")
    with refuses("manifest.not_json", file=stream / "manifest.json"):
        StreamReader.open(stream)
    assert parsed == []


def test_every_flipped_byte_of_the_manifest_is_noticed(stream):
    data = (stream / "manifest.json").read_bytes()
    for position in range(0, len(data), 37):
        broken = bytearray(data)
        broken[position] ^= 1
        with pytest.raises(StudioError):
            parse_manifest(bytes(broken), "manifest.json")


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), signed=st.booleans())
def test_any_value_anywhere_ends_in_a_sentence_or_in_frames(stream, edit_manifest, data, signed):
    """Any value at any place, with and without a valid checksum: a StudioError or frames, in bounded time."""
    path = stream / "manifest.json"
    original = path.read_bytes()
    values = json.loads(original)
    keys = []
    at = values
    while True:
        keys.append(data.draw(st.sampled_from(list(at) if isinstance(at, dict) else list(range(len(at))))))
        if not isinstance(at[keys[-1]], dict | list) or not at[keys[-1]] or data.draw(st.booleans()):
            break
        at = at[keys[-1]]
    value = data.draw(
        st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.just([]), st.just({}))
    )
    change = set_at(keys, value)
    try:
        edit_manifest(stream, change) if signed else path.write_text(json.dumps(change(values) or values))
    except (TypeError, KeyError):
        path.write_bytes(original)
        assume(False)  # no groups left whose sizes could be added up
    began = time.process_time()
    message = None
    try:
        with StreamReader.open(stream) as reader:
            assert len(list(reader.iterate())) == reader.frame_count == 7
    except StudioError as error:
        message = str(error)
    finally:
        path.write_bytes(original)
    assert time.process_time() - began < 5
    assert message is None or str(stream) in message


def test_rotations_of_nothing_are_not_seen(stream, edit_manifest):
    """All four numbers of the quaternions are 0: no rotation can be told."""

    def change(values):
        for component in values["groups"][0]["components"][-4:]:
            component.update(min=0.0, max=0.0)

    edit_manifest(stream, change)
    with StreamReader.open(stream) as reader:
        frame = reader.gaussians(0)
        assert_drawable(frame)
        assert (frame.opacities < 1 / 255).all()
        assert (reader.gaussians(5).opacities > 1 / 255).any()


def test_group_entry_goes_through_json(stream):
    with StreamReader.open(stream) as reader:
        for group in reader.manifest.groups:
            assert GroupEntry.from_dict(json.loads(json.dumps(group.to_dict()))) == group
    with refuses("manifest.invalid", file="entry.json", location="index", rule="missing"):
        GroupEntry.from_dict({}, "entry.json")


def test_sizes_on_a_change_of_digits(stream):
    """`total_bytes` includes its own digits: totals around powers of ten."""
    with StreamReader.open(stream) as reader:
        manifest = reader.manifest
    for metadata_length in range(40):
        _, data = seal(manifest.model_copy(update={"metadata": {"x": "y" * metadata_length}}))
        own = len(data)
        for files in (10**6 - own, 10**6 - own - 1, 10**6 - own + 1, 10**7 - own):
            group = manifest.groups[0].model_copy(update={"bytes": files})
            draft = manifest.model_copy(update={"groups": (group,), "metadata": {"x": "y" * metadata_length}})
            sealed, written = seal(draft)
            assert sealed.total_bytes == files + len(written)


class TestFiles:
    """Damaged videos are detected when their group is opened."""

    @pytest.fixture
    def plane(self, stream):
        return stream / "group_001" / "opacity.mp4"

    def refuses(self, stream, code, **expected):
        file = stream / "group_001" / "opacity.mp4"
        with StreamReader.open(stream) as reader:
            reader.gaussians(0)  # the first group is intact and stays readable
            with refuses(code, file=file, **expected):
                reader.gaussians(5)
            reader.gaussians(1)
            with refuses(code, file=file, **expected):
                reader.verify()

    def test_truncated(self, stream, plane):
        plane.write_bytes(plane.read_bytes()[:-10])
        self.refuses(stream, "stream.wrong_size", value=len(plane.read_bytes()))

    def test_longer(self, stream, plane):
        plane.write_bytes(plane.read_bytes() + b"more")
        self.refuses(stream, "source.file_too_long", expected=len(plane.read_bytes()) - 4)

    def test_flipped(self, stream, plane):
        data = bytearray(plane.read_bytes())
        data[len(data) // 2] ^= 4
        plane.write_bytes(bytes(data))
        self.refuses(stream, "stream.wrong_checksum")

    def test_missing(self, stream, plane):
        plane.unlink()
        self.refuses(stream, "source.file_missing")

    def test_a_folder_in_its_place(self, stream, plane):
        plane.unlink()
        plane.mkdir()
        self.refuses(stream, "source.file_unreadable")

    def test_link_out_of_the_folder(self, stream, plane, tmp_path):
        shutil.move(plane, tmp_path / "elsewhere.mp4")
        plane.symlink_to(tmp_path / "elsewhere.mp4")
        self.refuses(stream, "source.outside_folder")

    def replace(self, stream, edit_manifest, plane, data):
        """Replace the bytes and update the checksums, as a faulty or malicious writer would."""
        plane.write_bytes(data)

        def change(values):
            group = values["groups"][1]
            entry = next(c for c in group["components"] if c["name"] == "opacity")["planes"][0]
            group["bytes"] += len(data) - entry["bytes"]
            entry["bytes"], entry["sha256"] = len(data), hashlib.sha256(data).hexdigest()

        edit_manifest(stream, change)

    def refuses_group(self, stream, code, **expected):
        file = stream / "group_001" / "opacity.mp4"
        with StreamReader.open(stream) as reader, refuses(code, file=file, **expected):
            list(reader.iterate(4))

    def test_signed_rubbish(self, stream, edit_manifest, plane):
        self.replace(stream, edit_manifest, plane, b"rubbish" * 100)
        self.refuses_group(stream, "stream.video_unreadable")

    def test_signed_video_with_too_few_frames(self, stream, edit_manifest, plane, make_frames, tmp_path):
        bake_group(make_frames(2, 85), tmp_path / "short", 0, 0, PLANES)
        self.replace(stream, edit_manifest, plane, (tmp_path / "short/group_000/opacity.mp4").read_bytes())
        self.refuses_group(stream, "stream.video_too_short")

    def test_signed_video_with_too_many_frames(self, stream, edit_manifest, plane, make_frames, tmp_path):
        bake_group(make_frames(50, 85), tmp_path / "long", 0, 0, PLANES)
        self.replace(stream, edit_manifest, plane, (tmp_path / "long/group_000/opacity.mp4").read_bytes())
        self.refuses_group(stream, "stream.video_too_long", value=50, expected=3)

    def test_signed_video_of_another_size(self, stream, edit_manifest, plane, make_frames, tmp_path):
        bake_group(make_frames(3, 600), tmp_path / "large", 0, 0, PLANES)
        self.replace(stream, edit_manifest, plane, (tmp_path / "large/group_000/opacity.mp4").read_bytes())
        self.refuses_group(stream, "stream.wrong_video", value=("h264", 32, 32), expected=("h264", 16, 16))

    @pytest.mark.parametrize("position", [0.1, 0.4, 0.5, 0.6, 0.7, 0.8, 0.95])
    def test_signed_flips_end_in_a_sentence_or_a_frame(self, stream, edit_manifest, plane, position):
        data = bytearray(plane.read_bytes())
        for k in range(8):
            data[min(int(position * len(data)) + k, len(data) - 1)] ^= 0x5A
        self.replace(stream, edit_manifest, plane, bytes(data))
        with StreamReader.open(stream) as reader:
            try:
                frames = len(list(reader.iterate(4)))
            except StudioError as error:
                message = str(error)
            else:
                message = f"opacity.mp4 gave {frames} frames"
        assert "opacity.mp4" in message
        assert "gave" not in message or frames == 3


def test_the_bounds_are_those_of_the_player() -> None:
    """Two readers that refuse different streams would contradict docs/STREAM.md."""
    lines = (ROOT / "web/src/stream/manifest.ts").read_text(encoding="utf-8")
    theirs = dict(re.findall(r"^(?:export )?const (MAX_\w+) = ([\d_e]+(?: (?:<<|\*\*) \d+)?);$", lines, re.MULTILINE))
    ours = {name: value for module in (manifest_models, ladder_models) for name, value in vars(module).items()}
    common = theirs.keys() & ours.keys()
    assert len(common) > 10
    assert {name: eval(theirs[name]) for name in common} == {name: ours[name] for name in common}
