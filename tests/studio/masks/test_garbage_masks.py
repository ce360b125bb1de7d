"""Garbage masks: where the performer never is."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from studio.capture import CaptureSettings, open_footage
from studio.masks import FunctionMaskSource
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


def test_polygons_of_another_size_and_of_fractions(capture: Path) -> None:
    (capture / "garbage.yaml").write_text(
        "01: {size: [192, 128], remove: [[[96, 0], [192, 0], [192, 128], [96, 128]]]}"
    )
    scaled = mask(capture, masks="none", garbage_masks="garbage.yaml")
    assert np.array_equal(np.unique(np.nonzero(scaled == 0)[1]), np.arange(48, 96))
    (capture / "garbage.yaml").write_text(
        "01: {keep: [[[10, 10], [20, 10], [20, 30]], [[50, 50], [60, 50], [60, 60]]]}"
    )
    kept = mask(capture, masks="none", garbage_masks="garbage.yaml") > 0
    border = 10 + 20 + 10 * 5**0.5 + 10 + 10 + 10 * 2**0.5  # pixels that it crosses may be counted
    assert abs(int(kept.sum()) - (10 * 20 / 2 + 10 * 10 / 2)) < 0.7 * border
    assert kept[12, 18]
    assert kept[52, 58]
    assert not kept[28, 12]


def test_files_digest_and_own_functions(capture: Path) -> None:
    path = capture / "garbage.yaml"
    path.write_text("01: {remove: [[[48, 0], [96, 0], [96, 64], [48, 64]]]}")
    spec = CaptureSettings(root=capture, masks="files", garbage_masks="garbage.yaml")
    footage = open_footage(spec)
    assert path in footage.files()
    own = footage.with_mask_source(FunctionMaskSource(lambda image, camera, frame: np.ones(image.shape[:2])))
    assert own.mask("01", 0)[:, 48:].max() == 0
    before = footage.digest()
    path.write_text("01: {remove: [[[50, 0], [96, 0], [96, 64], [48, 64]]]}")
    assert open_footage(spec).digest() != before


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
