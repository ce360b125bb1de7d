"""Garbage masks: where the performer never is."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import open_footage
from v3studio.studio.masks import FunctionMaskSource


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


RIGHT_HALF = "[[48, 0], [96, 0], [96, 64], [48, 64]]"
FILE = "garbage.yaml"
EVERYTHING = FunctionMaskSource(lambda image, camera, frame: np.ones(image.shape[:2]))


def mask(capture: Path, camera: str = "01", text: str | None = None, **values: object) -> np.ndarray:
    """A mask with this garbage file, if any."""
    if text is not None:
        (capture / FILE).write_text(text)
        values["garbage_masks"] = FILE
    return open_footage(CaptureSettings(root=capture, **values)).mask(camera, 0)  # type: ignore[arg-type]


@pytest.mark.parametrize("masks", ["files", "clean_plate"])
def test_polygons_remove_what_they_surround(capture: Path, masks: str) -> None:
    text = f"01:\n  remove: [{RIGHT_HALF}]\n"
    for camera, given, stand in (("01", None, True), ("01", text, False), ("b", text, True)):
        restricted = mask(capture, camera, given, masks=masks)
        assert restricted[24:40, 14:26].min() == 255, "the performer is in the mask"
        assert restricted[15:55, 65:85].any() == stand
    everything = mask(capture, "01", text, masks="none")
    assert everything[:, :48].min() == 255
    assert everything[:, 48:].max() == 0


def test_polygons_of_another_size_and_of_fractions(capture: Path) -> None:
    text = "01: {size: [192, 128], remove: [[[96, 0], [192, 0], [192, 128], [96, 128]]]}"
    scaled = mask(capture, "01", text, masks="none")
    assert np.array_equal(np.unique(np.nonzero(scaled == 0)[1]), np.arange(48, 96))
    text = "01: {keep: [[[10, 10], [20, 10], [20, 30]], [[50, 50], [60, 50], [60, 60]]]}"
    kept = mask(capture, "01", text, masks="none") > 0
    border = 10 + 20 + 10 * 5**0.5 + 10 + 10 + 10 * 2**0.5  # pixels that it crosses may be counted
    assert abs(int(kept.sum()) - (10 * 20 / 2 + 10 * 10 / 2)) < 0.7 * border
    assert (kept[12, 18], kept[52, 58], kept[28, 12]) == (True, True, False)


def test_files_digest_and_own_functions(capture: Path) -> None:
    path = capture / FILE
    path.write_text(f"01: {{remove: [{RIGHT_HALF}]}}")
    spec = CaptureSettings(root=capture, masks="files", garbage_masks=FILE)
    footage = open_footage(spec)
    assert path in footage.files()
    own = open_footage(spec.replace(masks=EVERYTHING))
    assert np.array_equal(np.unique(np.nonzero(own.mask("01", 0))[1]), np.arange(48))
    before = footage.digest()
    path.write_text(path.read_text().replace("48", "50"))
    assert open_footage(spec).digest() != before


TRIANGLE = "[[0, 0], [1, 0], [1, 1]]"


@pytest.mark.parametrize(
    "text",
    [
        "[1, 2", "[]", "01: {}", "01: {around: []}",
        "01: {remove: [[[0, 0], [1, 0]]]}", "01: {remove: [[[0, 0], [1, 0], 5]]}", "01: {remove: [[12, 34, 56]]}",
        *(f"01: {{remove: [[[0, 0], [1, 0], {point}]]}}" for point in ("[1, here]", "[1, .nan]", "[1, 1, 1]")),
        f"01: {{size: 16, remove: [{TRIANGLE}]}}", f"01: {{size: [0, 5], remove: [{TRIANGLE}]}}", "01: {size: [1, 5]}",
        f"02: {{remove: [{TRIANGLE}]}}", f"01: {{remove: [{TRIANGLE}]}}\n01: {{remove: [{TRIANGLE}]}}",
    ],
)  # fmt: skip
def test_bad_files_are_refused(capture: Path, text: str) -> None:
    with refuses("mask.garbage_file", file=capture / FILE, setting="capture.garbage_masks"):
        mask(capture, "01", text)


def test_a_missing_file_and_cameras_left_out(capture: Path) -> None:
    with refuses("mask.garbage_file", file=capture / "none.yaml"):
        mask(capture, garbage_masks="none.yaml")
    text = "{01: &all {remove: [[[0, 0], [96, 0], [96, 64], [0, 64]]]}, b: *all}"
    assert mask(capture, "b", text, cameras=("b",), masks="none").max() == 0
