"""Which file has a capture's sound, and what of it belongs to the take's frames."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.sounds import click_times, clicks, write_video, write_wav
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import open_footage

FPS = 25


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """cam1 with sound (a click in frame 20), cam2 without, and take.wav with clicks in frames 10 and 30."""
    root = tmp_path_factory.mktemp("capture")
    (root / "videos").mkdir()
    write_video(root / "videos" / "cam1.mp4", 50, FPS, clicks(2.0, [20 / FPS]))
    write_video(root / "videos" / "cam2.mp4", 50, FPS, None)
    write_wav(root / "take.wav", clicks(2.0, [10 / FPS, 30 / FPS]))
    return root


def heard(root: Path, **settings: Any) -> list[float]:
    """Times of clicks in the take, in frames."""
    footage = open_footage(CaptureSettings(root=root, masks="none", rig=None, **settings))
    cut = footage.sound.cut(footage.frames, footage.spec.frame_range[2])
    samples = np.concatenate(list(cut.blocks()))
    assert len(samples) == round(len(footage.frames) / footage.fps * 48_000)
    return [time * footage.fps for time in click_times(samples)]


def test_a_file_is_cut_to_the_frames(videos: Path) -> None:
    close = {"abs": 0.03}
    assert heard(videos, audio="take.wav") == pytest.approx([10, 30], **close)
    assert heard(videos, audio="take.wav", frames="5:25") == pytest.approx([5], **close)
    assert heard(videos, audio="take.wav", audio_offset=0.2) == pytest.approx([15, 35], **close)
    assert heard(videos, audio="take.wav", audio_offset=-0.2, frames="3:") == pytest.approx([2, 22], **close)
    # every second frame is shown twice as long
    assert heard(videos, audio="take.wav", frames="4::2") == pytest.approx([3, 13], **close)
    assert heard(videos, audio=str(videos / "take.wav")) == pytest.approx([10, 30], **close)


def test_the_sound_of_a_camera_moves_with_its_frames(videos: Path) -> None:
    assert heard(videos, audio="cam1") == pytest.approx([20], abs=0.03)
    assert heard(videos, audio="cam1", offsets={"cam1": 3}) == pytest.approx([17], abs=0.03)
    assert heard(videos, audio="cam1", offsets={"cam2": 3}) == pytest.approx([20], abs=0.03)


def test_what_has_no_sound(videos: Path, image_folders: Path) -> None:
    for root, audio, code in (
        (videos, "cam3", "audio.not_found"),
        (videos, "cam2", "audio.no_sound"),
        (image_folders, "left", "audio.camera_of_images"),
    ):
        with refuses(code, setting="capture.audio"):
            open_footage(CaptureSettings(root=root, audio=audio))
    footage = open_footage(CaptureSettings(root=videos, masks="none", audio="take.wav"))
    with refuses("audio.uneven_frames", value=(2, 5)):
        footage.sound.cut((1, 2, 5), 1)
    assert open_footage(CaptureSettings(root=videos, masks="none")).sound is None
