"""The manifest and the pages of its index: what is refused, its bytes, its schema."""

import functools
import json
import random
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tests.studio.formats.test_damage import at_most
from tests.studio.stream.conftest import FindStream
from tests.support.errors import refuses
from tests.support.hostile_streams import changed_manifest
from tests.support.streams import edit_manifest, put_file, set_at, write_sealed
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import StreamReader, check_stream, manifest
from v3studio.studio.stream.manifest_file import VERSION, manifest_schema, parse_manifest

ROOT = Path(__file__).parents[3]
SCHEMA = ROOT / "docs" / "stream.schema.json"


def test_the_published_schema_is_the_programs() -> None:
    """A change needs this: write `manifest_schema()` to docs/stream.schema.json, indent 1, and describe it in
    STREAM.md."""
    assert json.loads(SCHEMA.read_text()) == manifest_schema()


def test_a_written_manifest_has_the_keys_of_the_schema(intact: FindStream) -> None:
    definitions = json.loads(SCHEMA.read_text())["$defs"]
    values = json.loads((intact("ladder") / "manifest.json").read_text())
    group = values["groups"][0]
    for name, found in (("Manifest", values), ("GroupEntry", group), ("Rendition", group["renditions"][0])):
        known, needed = set(definitions[name]["properties"]), set(definitions[name]["required"])
        assert needed <= set(found) == known - {"dilation"}  # left out where it is the usual one


def test_the_bounds_are_those_of_the_player() -> None:
    """Two readers that refuse different streams would contradict docs/STREAM.md."""
    lines = (ROOT / "web/src/stream/manifest.ts").read_text(encoding="utf-8")
    constant = r"^(?:export )?const (MAX_\w+) = ([\d_e]+(?: (?:<<|\*\*) \d+)?);(?: //.*)?$"
    theirs = dict(re.findall(constant, lines, re.MULTILINE))
    ours = vars(manifest)
    common = theirs.keys() & ours.keys()
    assert len(common) >= 4  # the others come from the schema
    assert {name: eval(theirs[name]) for name in common} == {name: ours[name] for name in common}


def swap_names(values):
    first, second = values["groups"][0]["renditions"][:2]
    first["video"]["path"], second["video"]["path"] = second["video"]["path"], first["video"]["path"]


def same_ids(values):
    for part in (values, values["groups"][0]):
        part["renditions"][1]["id"] = part["renditions"][0]["id"]


def wide(values):
    """64 columns of tiles of 272 pixels: a picture 17,408 pixels wide."""
    values["groups"][0]["renditions"][0].update(splats=70_000, tile=272, columns=64)


def group(*keys):
    return ("groups", 0, *keys)


def first(*keys):
    return group("renditions", 0, *keys)


NAN, INFINITY = float("nan"), float("inf")
PATHS = (
    "../secret.mp4",
    "/etc/passwd",
    "files/../secret.mp4",
    "..\\secret.mp4",
    "manifest.json",
    f"files/{'0' * 32}.mp4\n",
)
# path and value, or a change and a location; then the violated rule, or another code than manifest.invalid
DAMAGE = {
    "motion": [
        *((("version",), value, "manifest.wrong_version") for value in (VERSION + 1, VERSION - 1, str(VERSION), True)),
        (("format",), "something", "manifest.wrong_format"),
        (("fps",), 0, "greater_than"),
        (("fps",), NAN, "finite_number"),
        (("frame_count",), 10**9, "less_than_equal"),
        (("frame_count",), "7", "int_type"),
        (set_at(("frame_count",), 8), (), "frame_count"),
        (("groups",), [], "too_short"),
        (("groups",), 3, "tuple_type"),
        (lambda values: values["groups"].reverse(), (), "group_order"),
        (first("splats"), 10**9, "less_than_equal"),
        (first("splats"), 0, "greater_than_equal"),
        (set_at(first("splats"), 257), first(), "tile_side"),
        (first("frame_count"), 10**9, "less_than_equal"),
        (set_at(first("tile"), 4096), first(), "tile_side"),
        (set_at(first("rows"), 1), first(), "tile_count"),
        (wide, first(), "picture_size"),
        (first("columns"), 10**6, "less_than_equal"),
        (first("side", "raw_bytes"), 10**15, "less_than_equal"),
        (set_at(first("blocks", "count"), 81), first(), "block_count"),
        (first("blocks", "count"), 0, "greater_than_equal"),
        (first("positions", "bits"), 40, "less_than_equal"),
        (first("channels", 3, "step"), 0.0, "greater_than"),
        (first("channels", 3, "step"), NAN, "finite_number"),
        (first("channels", 3, "offset"), INFINITY, "finite_number"),
        (set_at(first("channels", 3, "name"), "mean_x"), first(), "channels"),
        (set_at(first("positions", "step"), 1e9), first(), "position_range"),
        (set_at(first("bytes"), 12), first(), "bytes_sum"),
        (set_at(first("blocks", "radius"), 1e-300), first(), "block_radius"),
        (set_at(first("channels", 6, "offset"), 90_000.0), first("channels", 6), "value_range"),
        (set_at(first("channels", 7, "step"), 100.0), first("channels", 7), "value_range"),
        (set_at(first("channels", 10, "step"), 1e9), first("channels", 10), "value_range"),
        *((first("dilation"), value, None) for value in (0, -0.1, 1.5, 1e300, "0.1", None, True, [0.1])),
    ],
    "ladder": [
        *((set_at(first("video", "path"), path), first("video"), "path_not_hash") for path in PATHS),
        (first("video", "bytes"), 10**15, "less_than_equal"),
        (first("video", "bytes"), -5, "greater_than_equal"),
        (first("video", "sha256"), "xyz", "string_pattern_mismatch"),
        (lambda values: values["groups"][0]["renditions"][0]["channels"].pop(), first(), "channels"),
        (set_at(first("frame_count"), 2), group(), "rendition_frames"),
        (set_at(first("first_frame"), 1), group(), "rendition_frames"),
        (set_at(group("index"), 1), group(), "rendition_frames"),
        (lambda values: values["groups"][0]["renditions"].pop(), (), "rendition_ids"),
        (lambda values: values["groups"][0]["renditions"].reverse(), (), "rendition_ids"),
        (same_ids, (), "rendition_ids"),
        (("renditions", 0, "id"), "../x", "string_pattern_mismatch"),
        (("renditions",), [], "too_short"),
        (set_at(("renditions", 0, "splats"), 79), (), "rendition_splats"),
        (set_at(("renditions", 0, "sh_degree"), 0), (), "sh_degree"),
        (swap_names, first("video"), "path_not_hash"),
        (first("video", "checks"), [], "too_short"),
        (set_at(first("video", "checks", 1, "picture"), 3), first(), "checks"),
        (first("video", "checks", 0, "crc32"), 1 << 32, "less_than"),
        (("pages", 0, "bytes"), 10**15, "less_than_equal"),
        (("pages", 0, "frames"), [], "too_short"),
        (set_at(("metadata", "x"), json.loads("[" * 17 + "]" * 17)), ("metadata",), "free_form"),
        (set_at(("metadata", "x"), "y" * (2 << 20)), ("metadata",), "free_form"),
        (set_at(("settings", "x"), json.loads("[" * 40 + "]" * 40)), ("settings",), "free_form"),
        (set_at(("audio",), {"path": "files/a.m4a"}), ("audio", "bytes"), "missing"),
        (("audio", "codec"), "mp3", "literal_error"),
        (("audio", "start"), -0.5, "greater_than_equal"),
        (set_at(("audio", "samples"), 48_000), (), "audio_length"),
        (set_at(("audio", "start"), 0.15), (), "audio_length"),
        (("audio", "samples"), 0, "greater_than_equal"),
        (("audio", "channels"), 50, "less_than_equal"),
        (("audio", "bytes"), 1 << 30, "less_than_equal"),
        (set_at(("audio", "path"), f"files/{'0' * 32}.m4a"), ("audio",), "path_not_hash"),
    ],
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damaged_manifests_are_refused(copy_of: FindStream, kind: str) -> None:
    stream = copy_of(kind)
    path = stream / "manifest.json"
    original = path.read_bytes()
    for place, what, rule in DAMAGE[kind]:
        change, location = (place, what) if callable(place) else (set_at(place, what), place)
        code = "manifest.invalid"
        if rule is not None and "." in rule:
            code, location, rule = rule, None, None
        expected = {} if rule is None else {"location": ".".join(map(str, location)), "rule": rule}
        path.write_bytes(original)
        try:
            edit_manifest(stream, change)
        except TypeError:  # no sizes to add up any more
            values = json.loads(original)
            change(values)
            path.write_text(json.dumps(values))
        with refuses(code, file=path, **expected) as caught:
            StreamReader.open(stream)
        text = str(caught.value)
        assert str(stream) in text
        assert len(text) < 600
        assert "\n" not in text


def test_additions_and_the_least_radius_are_no_damage(copy_of: FindStream) -> None:
    stream = copy_of("motion")
    edit_manifest(stream, lambda values: values.update(later_addition={"x": 1}))
    step = 2.0**-10
    edit_manifest(stream, set_at(first("positions", "step"), step))
    bits = json.loads((stream / "manifest.json").read_bytes())["groups"][0]["renditions"][0]["positions"]["bits"]
    edit_manifest(stream, set_at(first("blocks", "radius"), step * 2**bits / 1e6))
    with StreamReader.open(stream) as reader:
        assert reader.frame_count == 7


def replace_page(folder, change):
    """Store what `change` makes of the page's bytes as the page, under its new name."""
    path = folder / "manifest.json"
    values = json.loads(path.read_bytes())
    page = values["pages"][0]
    put_file(folder, page, json.dumps(change((folder / page["path"]).read_bytes())).encode())
    write_sealed(path, values)


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda values: values["groups"].pop(), "page_frames"),
        (lambda values: values["groups"].reverse(), "group_order"),
        (set_at(("groups",), []), "too_short"),
        (set_at(("format",), "x"), "literal_error"),
        (lambda values: values["groups"][1]["renditions"].pop(), "rendition_ids"),
        (set_at(("groups", 1, "renditions", 1, "frame_count"), 3), "rendition_frames"),
        (set_at(("groups", 0, "renditions", 0, "sh_degree"), 2), "channels"),
    ],
)
def test_contradicting_pages(copy_of: FindStream, change: Callable[[dict[str, Any]], object], rule: str) -> None:
    stream = copy_of("ladder")

    def changed(data):
        values = json.loads(data)
        change(values)
        return values

    replace_page(stream, changed)
    with StreamReader.open(stream) as reader:
        assert len(reader.gaussians(2).means) == 80  # what is in the manifest plays
        with refuses("manifest.invalid", rule=rule):
            reader.gaussians(3)


def test_pages_that_are_damaged_or_missing(copy_of: FindStream) -> None:
    stream = copy_of("ladder")
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


def test_a_total_that_is_wrong_is_found_by_verifying(copy_of: FindStream) -> None:
    stream = copy_of("ladder")
    edit_manifest(stream, lambda values: None)  # its total leaves out what is in the page
    with StreamReader.open(stream) as reader:
        (damage,) = check_stream(reader).damage
    assert (damage.file, damage.groups) == ("manifest.json", ())
    assert "total_bytes" in damage.problem


@pytest.mark.parametrize(
    "data", [b"", b"{", b"null", b"[]", b"\xff\xfe\x00", b'{"format": "v3studio-stream"}', b"[" * 99999]
)
def test_what_is_no_manifest(data: bytes) -> None:
    with pytest.raises(StudioError) as caught:
        parse_manifest(data, "m")
    assert caught.value.code in ("manifest.not_json", "manifest.wrong_format", "manifest.wrong_version")
    assert caught.value.file == "m"


@pytest.mark.parametrize("text", [b"[],", b"1,", b'{"a":1},'])
def test_60_megabytes_are_refused_before_they_are_parsed(text: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """They would take gigabytes."""
    data, parsed = b'{"groups": [' + text * (60_000_000 // len(text)) + b"0]}", []
    monkeypatch.setattr(json, "loads", lambda *_, **__: parsed.append(1))
    with at_most(1 << 20), refuses("manifest.not_json"):
        parse_manifest(data, "m")
    assert parsed == []


def test_every_flipped_byte_of_the_manifest_is_noticed(intact: FindStream) -> None:
    data = (intact("motion") / "manifest.json").read_bytes()
    for position in range(0, len(data), 37):
        broken = bytearray(data)
        broken[position] ^= 1
        with pytest.raises(StudioError):
            parse_manifest(bytes(broken), "manifest.json")


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(number=st.integers(0, 2**32), place=st.sampled_from(["ladder", "page"]), signed=st.booleans())
def test_any_value_is_refused_or_played(
    copy_of: FindStream, tmp_path: Path, number: int, place: str, signed: bool
) -> None:
    """A reader raises a StudioError or gives frames and sound, with and without a valid checksum."""
    kind = "ladder"
    stream = tmp_path / kind if (tmp_path / kind).exists() else copy_of(kind)
    path = stream / "manifest.json"
    original = path.read_bytes()
    message = None
    change = functools.partial(changed_manifest, random.Random(number))
    try:
        if place == "page":
            replace_page(stream, change)
        elif signed:
            write_sealed(path, change(original))
        else:
            path.write_text(json.dumps(change(original)))
        with StreamReader.open(stream) as reader:
            assert len(list(reader.iterate())) == reader.frame_count == 7
            sound = reader.sound()
            if sound is not None:
                sound.read(0, 2000)
                sound.close()
    except StudioError as error:
        message = str(error)
    except (TypeError, KeyError, AttributeError):
        assume(False)  # no files left whose sizes could be added up
    finally:
        path.write_bytes(original)
    assert message is None or len(message) < 1000
