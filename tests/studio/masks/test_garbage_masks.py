"""Garbage masks: where the performer never is."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from studio.capture import CaptureSettings, open_footage
from tests.support.errors import refuses


@pytest.fixture
def capture(tmp_path: Path, make: SimpleNamespace) -> Path:
    """An empty set, a small performer at the left and a larger stand at the right, which is not in the plates."""
    rng = np.random.default_rng(1)
    for camera in ("01", "b"):
        plate = rng.integers(90, 120, (64, 96, 3), np.uint8)
        image = plate.copy()
        image[20:44, 10:30] = (230, 40, 40)
        image[10:60, 60:90] = (40, 40, 230)
        make.image(tmp_path / "images" / camera / "0.png", image)
        make.image(tmp_path / "clean_plates" / f"{camera}.png", plate)
        make.image(tmp_path / "masks" / camera / "0.png", np.where(image.max(2) > 200, 255, 0).astype(np.uint8))
    return tmp_path


def mask(capture: Path, camera: str = "01", **values: object) -> np.ndarray:
    return open_footage(CaptureSettings(root=capture, **values)).mask(camera, 0)  # type: ignore[arg-type]


def found(mask: np.ndarray) -> tuple[bool, bool]:
    """Whether the performer and the stand are in the mask."""
    return bool(mask[24:40, 14:26].min() == 255), bool(mask[15:55, 65:85].max() > 0)


def test_polygons_remove_what_they_surround(capture: Path) -> None:
    (capture / "garbage.yaml").write_text("01:\n  remove: [[[48, 0], [96, 0], [96, 64], [48, 64]]]\n")
    for masks in ("files", "clean_plate"):
        assert found(mask(capture, masks=masks)) == (True, True)
        assert found(mask(capture, masks=masks, garbage_masks="garbage.yaml")) == (True, False)
        assert found(mask(capture, "b", masks=masks, garbage_masks="garbage.yaml")) == (True, True)
    everything = mask(capture, masks="none", garbage_masks="garbage.yaml")
    assert everything[:, :48].min() == 255
    assert everything[:, 48:].max() == 0


@pytest.mark.parametrize(
    "text",
    [
        "[1, 2",
        "[]",
        "01: {}",
        "01: {around: []}",
        "01: {remove: [[[0, 0], [1, 0]]]}",
        "01: {remove: [[[0, 0], [1, 0], [1, here]]]}",
        "01: {remove: [[[0, 0], [1, 0], [1, .nan]]]}",
        "01: {remove: [[[0, 0], [1, 0], 5]]}",
        "01: {remove: [[12, 34, 56]]}",
        "01: {remove: [[[0, 0], [1, 0], [1, 1, 1]]]}",
        "01: {size: 16, remove: [[[0, 0], [1, 0], [1, 1]]]}",
        "01: {size: [1, 5]}",
        "01: {size: [0, 5], remove: [[[0, 0], [1, 0], [1, 1]]]}",
        "02: {remove: [[[0, 0], [1, 0], [1, 1]]]}",
        "01: {remove: [[[0, 0], [1, 0], [1, 1]]]}\n01: {remove: [[[0, 0], [1, 0], [1, 1]]]}",
    ],
)
def test_bad_files_are_refused(capture: Path, text: str) -> None:
    path = capture / "garbage.yaml"
    path.write_text(text)
    with refuses("mask.garbage_file", file=path, setting="capture.garbage_masks"):
        mask(capture, garbage_masks="garbage.yaml")


def test_a_missing_file_and_cameras_left_out(capture: Path) -> None:
    with refuses("mask.garbage_file", file=capture / "none.yaml"):
        mask(capture, garbage_masks="none.yaml")
    (capture / "garbage.yaml").write_text("{01: &all {remove: [[[0, 0], [96, 0], [96, 64], [0, 64]]]}, b: *all}")
    assert mask(capture, "b", garbage_masks="garbage.yaml", cameras=("b",), masks="none").max() == 0
