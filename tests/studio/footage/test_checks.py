"""Colors of the set that change during a take, and performers beyond the view of a fisheye."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from v3studio.studio.cameras import Rig
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import check_footage, open_footage
from v3studio.studio.footage.checks import ColorDrift

FRAMES = range(10, 22)


def seen(gains: dict[int, tuple[float, float, float]], moving: bool = True) -> ColorDrift:
    """A noisy set with a performer who walks through it and casts a shadow; gains by frame."""
    rng = np.random.default_rng(0)
    room = rng.uniform(60, 170, (120, 160, 3))
    drift = ColorDrift()
    for frame in FRAMES:
        image, mask = room.copy(), np.zeros((120, 160), np.uint8)
        at = 10 + 8 * (frame - 10) if moving else 40
        image[20:110, at : at + 30] = rng.uniform(0, 255, 3)
        mask[20:110, at : at + 30] = 255
        image[110:, at : at + 50] *= 0.5
        image = image * gains.get(frame, (1, 1, 1)) + rng.normal(0, 3, image.shape)
        drift.see("cam1", frame, np.clip(image, 0, 255).astype(np.uint8), mask)
    return drift


def test_a_steady_camera_is_not_reported() -> None:
    assert seen({}).messages() == []
    assert seen({15: (1.01, 1.01, 0.99)}).messages() == []


@pytest.mark.parametrize(
    ("gain", "said", "change"), [((1.08, 1.08, 1.08), "brightness", 0.08), ((1.0, 1.0, 0.9), "blue", 0.1)]
)
def test_the_change_is_told_with_its_frames(gain: tuple[float, float, float], said: str, change: float) -> None:
    (message,) = seen(dict.fromkeys((14, 15, 20), gain)).messages()
    assert message.code == "footage.color_drift"
    assert message.fields["frames"] == (14, 15, 20)
    assert message.fields["change"] == pytest.approx(change, abs=0.01)
    assert said in str(message)


def test_a_performer_beyond_the_view_is_told() -> None:
    drift = ColorDrift()
    for frame, beyond in ((3, 0.0), (4, 0.2), (5, 0.05)):
        drift.see("cam1", frame, np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8), np.uint8), beyond)
    (message,) = drift.messages()
    assert (message.code, message.value) == ("mask.beyond_view", 0.2)
    assert message.fields == {"camera": "cam1", "frames": (4, 5)}


def test_a_fisheyes_mask_is_read_once(tmp_path: Path, make: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("cam1", "cam2"):
        make.image(tmp_path / "images" / name / "0.png", make.numbered(200))
        make.image(tmp_path / "masks" / name / "0.png", 255 * (make.numbered(200) > 100).astype(np.uint8))
    lens = make.camera("cam1", fisheye=True)
    footage = open_footage(CaptureSettings(root=tmp_path), Rig((lens, replace(lens, name="cam2"))))
    mask, read = footage.mask_source.mask, list[str]()

    def counted(camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        read.append(camera)
        return mask(camera, frame, image)

    monkeypatch.setattr(footage.mask_source, "mask", counted)
    assert check_footage(footage, drift=ColorDrift()) == []
    assert sorted(read) == ["cam1", "cam2"]
