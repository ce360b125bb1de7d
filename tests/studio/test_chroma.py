"""Chroma subsampling, against worked examples and against FFmpeg."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support.chroma_video import write_yuv
from v3studio.studio.capture.video import VideoReader
from v3studio.studio.chroma import LUMA_WEIGHTS, ChromaSampling, resampled

CENTER = ChromaSampling((2, 2), (0.5, 0.5), "center")
LEFT = ChromaSampling((2, 2), (0.0, 0.5), "left")
H422 = ChromaSampling((2, 1), (0.0, 0.0), "left")


def noise(height: int = 14, width: int = 18) -> torch.Tensor:
    return torch.rand(height, width, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def luma(image: torch.Tensor) -> torch.Tensor:
    return image @ image.new_tensor(LUMA_WEIGHTS["bt601"])


@pytest.mark.parametrize("sampling", [CENTER, LEFT, H422])
def test_luma_and_flat_colors_stay(sampling: ChromaSampling) -> None:
    image = noise()
    assert torch.allclose(luma(resampled(image, sampling)), luma(image))
    flat = image[:1, :1].expand(9, 7, 3)
    assert torch.allclose(resampled(flat, sampling), flat)


def test_a_row_worked_out_by_hand() -> None:
    """Red minus luma of a row 0 0 0 0 1 1 1 1, with a constant luma of one half."""
    weights = LUMA_WEIGHTS["bt601"]
    red = torch.tensor([0.0, 0, 0, 0, 1, 1, 1, 1], dtype=torch.float64)
    image = torch.full((4, 8, 3), 0.5, dtype=torch.float64)
    image[..., 0] += red
    image[..., 1] -= red * weights[0] / weights[1]

    def found(sampling: ChromaSampling, shift: float = 0.0) -> list[float]:
        return [round(float(value), 6) for value in resampled(image, sampling, shift)[1, :, 0] - 0.5]

    # samples 0 0 1 1 in the middle of pairs; a pixel lies a quarter of a sample from its own one
    assert found(CENTER) == [0, 0, 0, 0.25, 0.75, 1, 1, 1]
    # samples on the first pixels of pairs, averaged with weights 1/4 1/2 1/4: 0 0 3/4 1
    assert found(LEFT) == [0, 0, 0, 0.375, 0.75, 0.875, 1, 1]
    # averaged in the middle of pairs, but shown on their first pixel: everything moves to the left
    assert found(LEFT, LEFT.shift("center")) == [0, 0, 0, 0.5, 1, 1, 1, 1]


@pytest.mark.parametrize("corner", [(1, 1), (2, 3), (5, 2)])
def test_a_crop_sees_what_the_picture_sees(corner: tuple[int, int]) -> None:
    image, (left, top) = noise(24, 26), corner
    whole = resampled(image, LEFT, 0.5)
    crop = resampled(image[top : top + 16, left : left + 17], LEFT.cropped(left, top), 0.5)
    inner = slice(4, -4)
    assert torch.allclose(crop[inner, inner], whole[top : top + 16, left : left + 17][inner, inner])


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turned_pictures_have_a_turned_grid(turns: int) -> None:
    image = noise(12, 16)
    turned = resampled(torch.rot90(image, turns), LEFT.rotated(turns, 16, 12))
    inner = slice(3, -3)
    assert torch.allclose(turned[inner, inner], torch.rot90(resampled(image, LEFT), turns)[inner, inner])


def test_gradient() -> None:
    image = noise(6, 7).requires_grad_()
    assert torch.autograd.gradcheck(lambda one: resampled(one, LEFT.cropped(1, 1), 0.5), image)


@pytest.mark.parametrize("siting", ["left", "center"])
def test_it_predicts_what_ffmpeg_makes_of_a_picture(siting: str, tmp_path: Path) -> None:
    """Colored shapes, averaged to 4:2:0 in the middle of pairs, tagged and decoded with either siting."""
    rng = np.random.default_rng(1)
    image = np.full((64, 96, 3), 128, np.uint8)
    for _ in range(12):
        x, y = rng.integers(0, 80), rng.integers(0, 50)
        image[y : y + rng.integers(4, 14), x : x + rng.integers(4, 16)] = rng.integers(70, 190, 3)
    write_yuv(tmp_path / "a.mkv", image, "yuv420p", siting)
    reader = VideoReader(tmp_path / "a.mkv")
    filmed, sampling = torch.from_numpy(reader.read(0)).double(), reader.chroma
    assert sampling.siting == siting
    exact = torch.from_numpy(image).double()
    inner = slice(8, -8)

    def error(one: torch.Tensor) -> float:
        return float((one - filmed)[inner, inner].square().mean())

    right = error(resampled(exact, sampling, sampling.shift("center")))
    assert right < 0.2 * error(exact)
    if siting == "left":
        assert right < 0.4 * error(resampled(exact, sampling))
