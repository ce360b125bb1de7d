"""The dilation travels in the stream: each group of a rendition has its own, and readers draw with it."""

from dataclasses import replace

import pytest

from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest

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
