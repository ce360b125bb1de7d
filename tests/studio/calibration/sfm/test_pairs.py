"""Selection of the pairs to match: those that overlap."""

from itertools import combinations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.studio.calibration.sfm.jobs import job_of
from v3studio.studio.calibration.sfm import features
from v3studio.studio.calibration.sfm.features import file_name, find_matches
from v3studio.studio.calibration.sfm.pairs import worthwhile


def test_enough_matches_or_the_best_there_are() -> None:
    # each camera has 8 partners with 7 matches, but camera 10, with fewer; camera 11 has none
    matches = dict.fromkeys(combinations(range(10), 2), 7) | {(n, 10): n % 10 for n in range(10)} | {(10, 11): 0}
    assert set(worthwhile(matches, 12)) == {pair for pair in matches if pair not in ((0, 10), (1, 10), (10, 11))}


def picture(scene: np.ndarray, shift: int) -> np.ndarray:
    """A plane, seen slightly from the side."""
    corners = np.array([[0, 0], [280, 0], [280, 210], [0, 210]], np.float32)
    seen = corners + np.array([[shift, 0], [0, shift], [-shift, 0], [0, -shift]], np.float32)
    return cv2.warpPerspective(scene, cv2.getPerspectiveTransform(corners, seen), (280, 210))


def test_the_preview_separates_images_without_overlap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three cameras in front of one wall, three in front of another."""
    pycolmap = pytest.importorskip("pycolmap")
    rng = np.random.default_rng(0)
    (tmp_path / "images").mkdir()
    for wall in range(2):
        scene = sum(cv2.GaussianBlur(rng.normal(size=(210, 280, 3)), (0, 0), s) * s * 70 for s in (1.5, 3, 6))
        scene = np.clip(128 + scene, 0, 255).astype(np.uint8)
        for number in range(3):
            name = file_name(3 * wall + number)
            cv2.imwrite(str(tmp_path / "images" / name), picture(scene, 12 * number))
    job = job_of(6, focal=336.0, size=(280, 210), max_features=800)
    asked: list[set[str]] = []
    real = pycolmap.match_image_pairs

    def watched(path: Path, *, pairing_options: Any, **options: Any) -> None:
        asked.append(set(Path(pairing_options.match_list_path).read_text().splitlines()))
        real(path, pairing_options=pairing_options, **options)

    monkeypatch.setattr(pycolmap, "match_image_pairs", watched)
    find_matches(tmp_path, job)
    assert [len(pairs) for pairs in asked] == [15], "only a few cameras: no preview"
    monkeypatch.setattr(features, "FEW", 5)
    find_matches(tmp_path, job)
    together = [(0, 1), (0, 2), (1, 2), (3, 4), (3, 5), (4, 5)]
    assert len(asked[1]) == 15
    assert asked[2] == {f"{file_name(a)} {file_name(b)}" for a, b in together}
    assert not list(tmp_path.glob("preview*"))
