"""The figure of crops shows what it says: the same part of each image, twice enlarged, with its PSNR."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.matte_crops import CROPS, ENLARGED, figure, psnr
from studio.metrics import psnr as psnr_of_library

LABEL, GAP = 18, 2


def test_each_cell_is_the_crop_of_its_camera_and_take() -> None:
    rng = np.random.default_rng(0)
    cameras = {crop.camera for crop in CROPS}
    truth = {camera: rng.random((360, 640, 3), np.float32) for camera in cameras}
    seen = {
        name: {camera: (truth[camera], rng.random((360, 640, 3), np.float32)) for camera in cameras}
        for name in ("own", "exact")
    }
    drawn = figure(seen)
    top = 0
    for crop in CROPS:
        rows, columns = slice(crop.top, crop.top + crop.height), slice(crop.left, crop.left + crop.width)
        images = [truth[crop.camera], *(one[crop.camera][1] for one in seen.values())]
        for column, image in enumerate(images):
            left = column * (ENLARGED * crop.width + GAP)
            start = top + LABEL
            cell = drawn[start : start + ENLARGED * crop.height, left : left + ENLARGED * crop.width]
            assert np.abs(cell[::ENLARGED, ::ENLARGED] / 255 - image[rows, columns]).max() < 0.6 / 255
        top += LABEL + ENLARGED * crop.height + GAP
    assert len(drawn) == top


def test_psnr_is_that_of_the_library() -> None:
    rng = np.random.default_rng(1)
    first, second = rng.random((2, 8, 9, 3), np.float32)
    assert psnr(first, second) == pytest.approx(
        float(psnr_of_library(torch.from_numpy(first), torch.from_numpy(second))), abs=1e-4
    )
