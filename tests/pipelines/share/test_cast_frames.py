import json
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from tests.support.sounds import click_times, clicks
from tests.support.splats import round_splats
from tests.support.streams import bake_numbered, edit_manifest
from v3studio.pipelines.share.cast_frames import CastFrames
from v3studio.studio.formats import ply


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A stream with the splat 0 of frame i at x = i, z up, and one static splat at (1, 2, 3)."""
    bake_numbered(tmp_path / "walk", [4], 25.0, splats=40)
    edit_manifest(tmp_path / "walk", lambda manifest: manifest.update(metadata={"up": [0, 0, 1]}))
    ply.write(tmp_path / "dot.ply", round_splats(torch.tensor([[1.0, 2, 3]])).with_sh_degree(1))
    return tmp_path


def opened(place: Path, *items: object, **fields: object) -> CastFrames:
    path = place / "cast.json"
    path.write_text(json.dumps({"format": "v3studio-cast", "version": 1, "items": items, **fields}))
    return CastFrames(path)


def test_streams_stand_at_their_places_and_begin_at_their_times(place: Path) -> None:
    later = {"stream": "walk", "position": [0, 0, 5], "turn": [0, 90, 0], "scale": 2, "start": 0.08}
    cast = opened(place, {"stream": "walk", "position": [10, 1, 0]}, later)
    assert (cast.frame_count, cast.fps) == (6, 25)  # the second begins two frames later
    for frame in range(cast.frame_count):
        means = cast.gaussians(frame).means.numpy().reshape(2, 40, 3)
        np.testing.assert_allclose(means[0, :, 0], 10 + frame % 4, atol=1e-3)
        np.testing.assert_allclose(means[0, :, 1:], [[1, 0]] * 40, atol=0.2)  # its lowest point, below its centers
        # x of the stream is -z of the world after 90 degrees about y
        np.testing.assert_allclose(means[1, :, 2], 5 - 2 * max(frame - 2, 0), atol=5e-3)
        np.testing.assert_allclose(means[1, :, 0], 0, atol=0.01)
    cast.close()


def test_static_splats_are_turned_about_x_then_y_then_z_of_their_own(place: Path) -> None:
    dot = {"splats": "dot.ply", "turn": [90, 0, 90], "scale": 2, "position": [0, 0, 1]}
    cast = opened(place, dot, {"stream": "walk"})
    splats = cast.gaussians(0)
    # as in three.js: about its z first, (1, 2, 3) to (-2, 1, 3), then about x, to (-2, -3, 1)
    np.testing.assert_allclose(splats.means[-1], [-4, -6, 3], atol=1e-5)
    assert splats.sh_degree == 1
    assert splats.dilation == cast.gaussians(1).dilation
    cast.close()


def test_the_sound_of_each_stream_begins_with_it_and_loops(place: Path) -> None:
    bake_numbered(place / "talk", [5], 25.0, sound=clicks(0.2, [0.12]))
    cast = opened(place, {"stream": "talk"}, {"stream": "walk"}, {"stream": "talk", "start": 0.31})
    sound = cast.sound()
    assert sound.samples == round(cast.frame_count / cast.fps * sound.sample_rate)
    wanted = [0.12, 0.32, 0.43, 0.52]  # at 0.12 + 0.2 n, and at 0.31 + 0.12
    for track in (sound, sound.copy()):
        pieces = [track.read(first, 7000) for first in range(0, sound.samples, 7000)]
        times = click_times(np.concatenate(pieces)[: round(0.55 * sound.sample_rate)])
        assert times == pytest.approx(wanted, abs=0.005)
        track.close()
    cast.close()
    silent = opened(place, {"stream": "walk"})
    assert not silent.has_sound
    assert silent.sound() is None
    silent.close()


def test_static_splats_alone_and_the_first_view(place: Path) -> None:
    cast = opened(place, {"splats": "dot.ply"}, camera={"position": [0, 1, 4], "target": [0, 1, 0], "fov": 30})
    np.testing.assert_allclose(cast.camera.center, [0, 1, 4])
    assert cast.frame_count == 1
    cast.close()
    with refuses("stream.not_found"):
        opened(place, {"stream": "none"})
