"""Movies carry the video's sound: a click in a frame is heard when the movie shows that frame."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from tests.studio.formats.conftest import MakeVideo
from tests.studio.formats.test_movie import camera
from tests.support.sounds import ArrayPcm, click_times, clicks
from v3studio.studio.formats.camera_path import CameraPath, Key
from v3studio.studio.formats.movie import movie_sound, render_movie
from v3studio.studio.splat_video import SplatVideo

FPS = 20
CLICK = 2 / FPS  # in frame 2


@pytest.fixture
def video(make_video: MakeVideo) -> SplatVideo:
    """Four frames with a click in frame 2."""
    return replace(make_video((4,)), sound=ArrayPcm(clicks(4 / FPS, [CLICK], channels=2)))


def heard(path):
    """Times of the clicks, and of the pictures, in seconds."""
    with av.open(str(path)) as file:
        assert file.streams.audio[0].codec_context.sample_rate == 48_000
        samples = np.concatenate([frame.to_ndarray() for frame in file.decode(audio=0)], axis=1).T
    with av.open(str(path)) as file:
        pictures = [frame.time for frame in file.decode(video=0)]
    return click_times(samples), pictures


def test_the_sound_is_in_sync_and_loops_with_the_frames(tmp_path: Path, video: SplatVideo) -> None:
    still = CameraPath([Key(0, camera(0.0))], 48, 32)
    render_movie(video, tmp_path / "a.mp4", still.camera, lambda time: time * FPS, 0.4, FPS)
    times, pictures = heard(tmp_path / "a.mp4")
    aac_frame = 1024 / 48_000
    assert times == pytest.approx([pictures[2], pictures[6]], abs=aac_frame)
    assert times == pytest.approx([CLICK, 4 / FPS + CLICK], abs=0.001)


def test_where_frames_keep_their_speed(video: SplatVideo) -> None:
    def clicks_of(video, frame, seconds):
        sound, _ = movie_sound(video, frame, seconds, FPS)
        return click_times(sound.until(seconds))

    assert clicks_of(video, lambda time: 1 + time * FPS, 0.15) == pytest.approx([0.05], abs=0.0005)
    assert clicks_of(video.part(2, 4), lambda time: time * FPS, 0.1) == pytest.approx([0.0], abs=0.0005)
    assert clicks_of(video.part(0, 4, 2), lambda time: time * FPS / 2, 0.2) == pytest.approx([CLICK], abs=0.0005)
    sound, why = movie_sound(video, lambda time: 2 * time * FPS, 0.2, FPS)
    assert sound is None
    assert why
    assert movie_sound(replace(video, sound=None), lambda time: time * FPS, 0.2, FPS) == (None, "")
