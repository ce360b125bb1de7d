"""The dilation travels in the stream: each group of a rendition has its own, and readers draw with it."""

import json
from dataclasses import replace

import pytest

from studio.stream import BakeSettings, Rung, StreamReader, bake_group, write_manifest
from studio.stream.encode import write_manifest as manifest_writer

KINDS = {
    "motion": BakeSettings(preset="ultrafast"),
    "planes": BakeSettings(profile="planes", preset="ultrafast"),
}


def write(folder, make_frames, settings, dilations, **more):
    """A stream with a group of two frames for each of the dilations."""
    entries = [
        bake_group(
            [replace(frame, dilation=dilation) for frame in make_frames(2, 60, seed=group)],
            folder,
            group,
            2 * group,
            settings,
            **more,
        )
        for group, dilation in enumerate(dilations)
    ]
    write_manifest(folder, entries, 25.0, settings)
    return folder


def decoded(folder, rendition=None):
    with StreamReader.open(folder, rendition=rendition) as reader:
        return [frame.dilation for frame in reader.iterate()]


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_decoded_with_the_dilation_of_their_group(tmp_path, make_frames, kind):
    """Also where groups differ, as in a take of which only a part was trained again."""
    folder = write(tmp_path / "stream", make_frames, KINDS[kind], (0.1, 0.3, 1.0))
    assert decoded(folder) == [0.1, 0.1, 0.3, 0.3, 1.0, 1.0]


@pytest.mark.parametrize("kind", KINDS)
def test_the_usual_dilation_is_not_written(tmp_path, make_frames, kind):
    """So streams of today are the bytes of yesterday."""
    folder = write(tmp_path / "stream", make_frames, KINDS[kind], (0.3, 0.3))
    assert "dilation" not in (folder / "manifest.json").read_text()


def test_all_renditions_and_pages_have_it(tmp_path, make_frames, monkeypatch):
    monkeypatch.setattr(manifest_writer, "INLINE_BYTES", 1)  # later groups go to pages
    settings = BakeSettings(ladder=(Rung(qp=24), Rung(qp=34)), preset="ultrafast")
    folder = write(tmp_path / "stream", make_frames, settings, (0.05, 0.2))
    manifest = json.loads((folder / "manifest.json").read_bytes())
    assert [one["dilation"] for one in manifest["groups"][0]["renditions"]] == [0.05, 0.05]
    page = json.loads((folder / manifest["pages"][0]["path"]).read_bytes())
    assert [one["dilation"] for one in page["groups"][0]["renditions"]] == [0.2, 0.2]
    for rendition in manifest["renditions"]:
        assert decoded(folder, rendition["id"]) == [0.05, 0.05, 0.2, 0.2]
