"""Masks that cameras agree on, in a synthetic capture without plates, compared with exact ones."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.studio.masks.scenes import ball, overlap
from tests.support.errors import refuses
from tests.support.rigs import ring
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import Footage, open_footage
from v3studio.studio.masks.agreement import people, source, vote
from v3studio.studio.masks.matting_model import MattingModel

LITE = Path(__file__).parents[1] / "data" / "lite.tflite"
FRAMES, SIZE = 16, (128, 96)
RED, BLIND = np.array([200.0, 70.0, 60.0]), "cam4"
"""Color of the performer, and the camera whose wall has the same color."""


def alpha_of(camera: Camera, frame: int) -> np.ndarray:
    """(H, W) bool: two balls, one above the other, that move."""
    x, y = 0.5 * np.sin(0.4 * frame), 0.2 * np.cos(0.4 * frame)
    return ball(camera, np.array([x, y, -0.15]), 0.32) | ball(camera, np.array([x, y, 0.3]), 0.2)


@pytest.fixture(autouse=True)
def few_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the usual number along each side, which are split once more, is as good for small images."""
    monkeypatch.setattr(vote, "CELLS", 24)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return ring(8, radius=3.0, heights=(0.3, 1.2), size=SIZE, focal=112.0)


@pytest.fixture(scope="module")
def capture(rig: Rig, make: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("agreed")
    for number, camera in enumerate(rig):
        rng = np.random.default_rng(number)
        texture = cv2.GaussianBlur(rng.normal(0, 50, (SIZE[1], SIZE[0], 3)).astype(np.float32), (0, 0), 4)
        wall = texture + (RED if camera.name == BLIND else np.array([110.0, 130.0, 120.0]))
        for frame in range(FRAMES):
            shown = alpha_of(camera, frame)
            image = np.where(shown[..., None], RED, wall) + rng.normal(0, 2, wall.shape)
            image = np.clip(image, 0, 255).astype(np.uint8)
            image[..., 0] = image[..., 0] // 2 * 2 + ~shown  # red is even on the performer, see `even`
            make.image(folder / "images" / camera.name / f"{frame:03d}.png", image)
    return folder


def even(image: np.ndarray) -> np.ndarray:
    """(H, W) bool: the exact mask of an image."""
    return image[..., 0] % 2 == 0


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Estimating the set takes most of the time; it does not depend on the model."""
    return tmp_path_factory.mktemp("cache")


def opened(capture: Path, rig: Rig | None, cache: Path | None = None, **settings: object) -> Footage:
    spec = CaptureSettings(root=capture, images="images/{camera}/{frame}.png").replace(**settings)
    return open_footage(spec, rig, cache_folder=cache, threads=1)


def found(footage: Footage, camera: Camera, frame: int) -> float:
    return overlap(footage.mask(camera.name, frame), alpha_of(camera, frame))


def test_cameras_agree_on_better_masks_than_each_of_them_has(capture: Path, rig: Rig, cache: Path) -> None:
    """And the masks are kept for other processes."""
    agreed = opened(capture, rig, cache)
    alone = opened(capture, rig, cache, masks="median_background")
    assert "agreed by 8 cameras" in agreed.description
    assert "mask_model null" in agreed.description
    together = {camera.name: found(agreed, camera, 7) for camera in rig}
    apart = {camera.name: found(alone, camera, 7) for camera in rig}
    assert np.mean(list(together.values())) > max(0.85, np.mean(list(apart.values())))
    assert together[BLIND] > apart[BLIND]
    files = {path: path.stat().st_mtime_ns for path in cache.rglob("mask_*.png")}
    again = opened(capture, rig, cache)
    assert np.array_equal(again.mask("cam2", 7), agreed.mask("cam2", 7))
    assert {path: path.stat().st_mtime_ns for path in cache.rglob("mask_*.png")} == files != {}


def test_a_model_sees_squares_of_people(capture: Path, rig: Rig, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"mask_model": f"selfie:{LITE}"}
    sides = []

    def nobody(self: MattingModel, image: np.ndarray, *_: object) -> np.ndarray:
        sides.append(image.shape[:2])
        return np.zeros(image.shape[:2], np.float32)

    model = opened(capture, rig, cache, **settings)
    assert LITE in model.files()
    assert "matting model lite.tflite" in model.description
    camera = next(iter(rig))
    opened(capture, rig, cache).mask(camera.name, 7)
    sets = set(cache.glob("background_*"))
    before = found(model, camera, 7)
    assert set(cache.glob("background_*")) == sets != set(), "they do not depend on the model"
    monkeypatch.setattr(MattingModel, "__call__", nobody)
    shutil.rmtree(cache / "masks")  # which are kept
    assert found(opened(capture, rig, cache, **settings), camera, 7) < before - 0.05
    assert len(sides) == 2 * len(rig)  # two margins
    assert all(height == width < SIZE[0] for height, width in sides)


def test_what_a_model_sees_is_kept_where_it_is_shown(capture: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def without_head(image: np.ndarray, *_: object) -> np.ndarray:
        shown = even(image)
        rows = np.flatnonzero(shown.any(1))
        shown[: rows[0] + len(rows) // 4] = False
        return np.where(shown, np.float32(4), np.float32(-4))

    monkeypatch.setattr(source, "evidence_of", without_head)
    monkeypatch.setattr(source, "SET_FRAMES", 2)
    monkeypatch.setattr(MattingModel, "__call__", lambda self, image, *_: np.float32(even(image)))
    footage = opened(capture, rig, mask_model=f"selfie:{LITE}")
    assert np.mean([found(footage, camera, 7) for camera in rig]) > 0.85


def test_without_cameras_or_with_few_each_camera_is_alone(capture: Path, rig: Rig) -> None:
    alone = opened(capture, None, masks="median_background").mask("cam1", 7)
    for masks in ("auto", ["median_background", "model"]):
        for cameras, rigs in ((rig.names, None), (rig.names[:2], rig)):
            footage = opened(capture, rigs, masks=masks, cameras=cameras)
            assert "by each camera alone" in footage.description
            assert np.array_equal(footage.mask("cam1", 7), alone)


ONE = {"images": "images/{camera}/007.png"}
"""Settings of a capture with one frame, which gets the number 0."""


def shows(footage: Footage, camera: Camera) -> float:
    """IoU of the mask in that frame."""
    return overlap(footage.mask(camera.name, 0), alpha_of(camera, 7))


def test_cameras_agree_on_what_it_sees_in_one_frame(capture: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is no other evidence."""
    monkeypatch.setattr(people, "_DARK", 0.0)  # `even` reads the lowest bit
    monkeypatch.setattr(MattingModel, "__call__", lambda self, image: np.float32(even(image)))
    footage = opened(capture, rig, **ONE)
    assert "agreed by 8 cameras, from matting model selfie.tflite" in footage.description
    assert min(shows(footage, camera) for camera in rig) > 0.9
    monkeypatch.setattr(MattingModel, "__call__", lambda self, image: np.zeros(image.shape[:2], np.float32))
    with refuses("mask.nobody_seen"):
        opened(capture, rig, **ONE).mask("cam2", 0)
    assert "not found" in opened(capture, rig, mask_model=None, **ONE).description


@pytest.mark.parametrize("count", [8, 3])
def test_masks_of_other_sources_are_evidence(capture: Path, rig: Rig, make: SimpleNamespace, count: int) -> None:
    """A lamp that one camera's mask shows is not seen by the others."""
    few, lamp = rig.names[:count], rig.names[0]
    for name in few:
        mask = 255 * alpha_of(rig[name], 7).astype(np.uint8)
        if name == lamp:
            mask[:14, :24] = 255
        make.image(capture / "cut" / f"{name}.png", mask)
    settings = {**ONE, "mask_files": "cut/{camera}.png", "cameras": few}
    given, agreed = (opened(capture, rig, masks=masks, **settings) for masks in ("files", ["files"]))
    assert shows(given, rig[lamp]) < 0.8
    assert shows(agreed, rig[lamp]) > 0.9
    assert np.mean([shows(agreed, rig[name]) for name in few]) > 0.9


def test_another_model_in_the_same_file_changes_the_digest(capture: Path, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    model = tmp_path / "model.onnx"

    def digest(**settings: object) -> str:
        return opened(capture, None, mask_model=f"plain:{model}", **settings).digest()

    for settings in ({}, {"masks": ["median_background", "model"]}):
        model.write_bytes(b"one")
        first = digest(**settings)
        assert digest(**settings) == first
        model.write_bytes(b"two")
        assert digest(**settings) != first
