"""Offsets between cameras, from motion and sound with known offsets."""

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.sounds import write_video
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import open_footage
from v3studio.studio.footage.sync import check_sync, offsets_of, sound_signal

FPS = 20
LATE = {"a": 0, "b": 3, "c": -2, "d": 0}


def pace(time: np.ndarray) -> np.ndarray:
    """Position (0..1) of an irregularly moving object at a time in seconds."""
    rng = np.random.default_rng(5)
    steps = rng.gamma(0.6, 1.0, 400)
    way = np.concatenate([[0], np.cumsum(steps)])
    return np.interp(time, np.arange(401) / FPS * 1.5, way) % 20 / 20


def film(folder: Path, make: SimpleNamespace) -> None:
    """A ball seen from different positions, earlier or later by `LATE`, with sensor noise."""
    rng = np.random.default_rng(1)
    for number, (name, late) in enumerate(LATE.items()):
        background = rng.integers(60, 120, (90, 120, 3)).astype(np.float32)
        for frame in range(60):
            at = pace(np.array((frame - late + 10) / FPS))
            image = background.copy()
            place = (int(20 + 80 * (at if number % 2 else 1 - at)), int(30 + 8 * number + 20 * at))
            cv2.circle(image, place, 8 + number, (250.0, 240.0, 200.0), -1)
            image += rng.normal(0, 3, image.shape)
            make.image(folder / "images" / name / f"{frame:04d}.png", np.clip(image, 0, 255).astype(np.uint8))


def test_offsets_from_motion_and_their_correction(tmp_path: Path, make: SimpleNamespace) -> None:
    film(tmp_path, make)
    footage = open_footage(CaptureSettings(root=tmp_path, masks="none", fps=FPS))
    report = check_sync(footage)
    assert report.method == "motion"
    assert report.whole == {"b": 3, "c": -2}
    assert report.unsure == ()
    warned = [(warning.code, warning.fields["camera"], warning.value) for warning in report.warnings()]
    assert warned == [("sync.offset", "b", 3), ("sync.offset", "c", -2)]
    assert "{b: 3}" in report.warnings()[0].fix
    aligned = open_footage(CaptureSettings(root=tmp_path, masks="none", fps=FPS, offsets=report.whole))
    assert aligned.frames == tuple(range(2, 57))  # what all cameras have
    assert check_sync(aligned).whole == {}
    np.testing.assert_array_equal(aligned.raw_image("b", 10), footage.raw_image("b", 13))
    with refuses("footage.unknown_camera", value="e", setting="capture.offsets"):
        open_footage(CaptureSettings(root=tmp_path, masks="none", offsets={"e": 1}))


def clap(path: Path, seconds: float, offset: float, rate: int = 48_000) -> None:
    """A video of a static image with noise bursts that begin `offset` seconds late."""
    rng = np.random.default_rng(7)
    time = np.arange(int(seconds * rate)) / rate - offset
    sound = 0.003 * np.random.default_rng(int(1000 * offset) + 50).normal(size=len(time))
    for at in (0.41, 0.93, 1.38, 2.2):
        burst = (time >= at) & (time < at + 0.08)
        sound[burst] += rng.normal(0, 0.3, burst.sum()) * np.exp(-(time[burst] - at) / 0.03)
    write_video(path, int(seconds * FPS), FPS, sound.astype(np.float32)[:, None])


def test_offsets_from_sound(tmp_path: Path) -> None:
    (tmp_path / "videos").mkdir()
    for name, offset in (("a", 0.0), ("b", 0.25), ("c", 0.0)):
        clap(tmp_path / "videos" / f"{name}.mp4", 3.0, offset)
    report = check_sync(open_footage(CaptureSettings(root=tmp_path, masks="none")))
    assert report.method == "sound"
    assert report.offsets["b"] == pytest.approx(0.25 * FPS, abs=0.3)
    assert report.whole == {"b": 5}
    assert abs(len(sound_signal(tmp_path / "videos" / "a.mp4")) / 500 - 3.0) < 0.15


def test_bad_input(tmp_path: Path, make: SimpleNamespace) -> None:
    for name in ("a", "b"):
        for frame in range(3):
            make.image(tmp_path / "images" / name / f"{frame}.png", np.zeros((20, 20, 3), np.uint8))
    footage = open_footage(CaptureSettings(root=tmp_path, masks="none"))
    with refuses("sync.too_few_frames", value=3, expected=12):
        check_sync(footage)
    with refuses("sync.no_sound", camera="a"):
        check_sync(footage, method="sound")
    for seconds in (0.0, -1.0, float("inf")):
        with refuses("sync.seconds", value=seconds):
            check_sync(footage, seconds=seconds)
    with refuses("sync.one_camera"):
        check_sync(open_footage(CaptureSettings(root=tmp_path, masks="none", cameras=("a",))))


@pytest.mark.parametrize("late", [-3.4, -0.25, 0.3, 2.4])
def test_fractions_of_a_sample_are_found(late: float) -> None:
    """Smooth signals with a known shift, as motion of limbs is; the parabola is good to a few hundredths."""
    times = np.arange(200.0)

    def signal(shift: float) -> np.ndarray:
        return sum(np.sin((times - shift) * rate + phase) for rate, phase in ((0.31, 0.1), (0.47, 1.9), (0.83, 0.7)))

    lags = offsets_of({"a": signal(0.0), "b": signal(late)}, most=10).lags
    assert lags["b"] - lags["a"] == pytest.approx(late, abs=0.06)


def test_sounds_of_different_length() -> None:
    """Cameras do not stop at the same time."""
    heard = np.random.default_rng(5).normal(size=1000)
    lags = offsets_of({"a": heard, "b": heard[7:600]}, most=50).lags
    assert lags["a"] - lags["b"] == pytest.approx(7, abs=0.1)


@pytest.mark.parametrize("steps", ["periodic", "slow"])
def test_motion_that_several_offsets_fit_is_told(steps: str) -> None:
    """Steps of a walk, which repeat; and one slow motion, whose strength each camera sees differently."""
    rng = np.random.default_rng(3)
    times = np.arange(100.0)
    motion = np.sin(times * 0.3) ** 2 if steps == "periodic" else np.exp(-(((times - 50) / 18) ** 2))
    seen = {name: motion * (1 + 0.004 * tilt * times) for name, tilt in (("a", 0), ("b", 1), ("c", -1))}
    matched = offsets_of({name: signal + rng.normal(0, 0.1, 100) for name, signal in seen.items()}, most=30)
    assert all(np.isnan(lag) for lag in matched.lags.values())
    assert all(len(fitting) > 1 for fitting in matched.several.values())
    assert set(matched.several) == {"a", "b", "c"}
