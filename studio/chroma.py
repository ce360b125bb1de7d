"""Chroma subsampling: what storing an image as 4:2:0 or 4:2:2 does to its colors, as a linear operator.

A camera stores one chroma sample for several luma samples, so colors bleed over outlines. A drawing that is compared
with such footage goes through the same loss first; otherwise, the splats learn the bleeding as color.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from torch import Tensor

Siting = Literal["left", "center"]
"""Horizontal position of chroma samples: on the first luma sample of each group (MPEG-2, the default of H.264 and
HEVC), or in the middle of the group (MPEG-1, JPEG)."""

LUMA_WEIGHTS = {"bt601": (0.299, 0.587, 0.114), "bt709": (0.2126, 0.7152, 0.0722), "bt2020": (0.2627, 0.678, 0.0593)}
"""Luma of R'G'B' (ITU-R BT.601, BT.709 and BT.2020)."""


@dataclass(frozen=True)
class ChromaSampling:
    """The chroma grid of a video."""

    step: tuple[int, int]  # (x, y) luma samples per chroma sample: (2, 2) for 4:2:0, (2, 1) for 4:2:2
    # (x, y) position of the first chroma sample relative to the first luma sample, in luma samples, as the file is
    # decoded: 0 on it, 0.5 between it and the second one
    first: tuple[float, float]
    # where the decoder assumes the samples; None if the image was turned, so that x is not "left"
    siting: Siting | None = "left"
    matrix: str = "bt601"  # a name in `LUMA_WEIGHTS`

    def cropped(self, left: int, top: int) -> ChromaSampling:
        """The grid of a crop that begins at pixel (left, top)."""
        (across, down), (x, y) = self.step, self.first
        return replace(self, first=((x - left) % across, (y - top) % down))

    def rotated(self, turns: int, width: int, height: int) -> ChromaSampling:
        """The grid after `np.rot90(image, turns)`; `width` and `height` of the image before, in pixels."""
        sampling = self
        for _ in range(turns % 4):
            (across, down), (x, y) = sampling.step, sampling.first
            sampling = replace(sampling, step=(down, across), first=(y, (width - 1 - x) % across), siting=None)
            width, height = height, width
        return sampling

    def shift(self, siting: Siting) -> float:
        """Pixels to the right of the decoder's samples at which an encoder that used `siting` took them."""
        if self.siting is None:
            return 0.0
        middle = (self.step[0] - 1) / 2
        return (middle if siting == "center" else 0.0) - (middle if self.siting == "center" else 0.0)


def resampled(image: Tensor, sampling: ChromaSampling, shift: float = 0.0) -> Tensor:
    """An image (H, W, 3) R'G'B' after its chroma was averaged down to the grid and interpolated back; luma is
    unchanged. Differentiable.

    Averaging is over the area of a chroma sample, interpolation linear. Beyond the border, the outermost pixel repeats.
    `shift`: horizontal position at which the encoder took the samples, relative to that grid, in pixels. Not 0 for
    footage that was converted with one siting and is decoded with another.
    """
    import torch  # `v3studio status` opens footage and does not need it

    height, width, _ = image.shape
    (across, down), (x, y) = sampling.step, sampling.first
    left, columns, average_x = _averaging(across, x + shift, width)
    top, rows, average_y = _averaging(down, y, height)
    luma = image.new_tensor(LUMA_WEIGHTS[sampling.matrix])
    # red and blue minus luma; green follows from them
    to_chroma = torch.eye(3, dtype=image.dtype, device=image.device)[:, ::2] - luma[:, None]
    from_chroma = torch.zeros(2, 3, dtype=image.dtype, device=image.device)
    from_chroma[0, 0] = from_chroma[1, 2] = 1
    from_chroma[:, 1] = -luma[::2] / luma[1]
    chroma = (image @ to_chroma).permute(2, 0, 1)
    kernel = image.new_tensor(average_y)[:, None] * image.new_tensor(average_x)
    padding = [left, across * (columns - 1) + len(average_x) - left - width]
    padding += [top, down * (rows - 1) + len(average_y) - top - height]
    padded = torch.nn.functional.pad(chroma[None], padding, mode="replicate")
    low = torch.nn.functional.conv2d(padded, kernel.expand(2, 1, -1, -1), stride=(down, across), groups=2)[0]
    low = _interpolated(low.transpose(1, 2), down, y, height).transpose(1, 2)
    low = _interpolated(low, across, x, width)
    return image + (low - chroma).permute(1, 2, 0) @ from_chroma


def _averaging(step: int, first: float, size: int) -> tuple[int, int, list[float]]:
    """Averaging of an axis: pixels of padding before it, number of samples, and the weights of the pixels of a sample.

    The samples are those at `first + step * index` for indices from -1 to the last one that a pixel needs.
    """
    if step == 1:
        return 0, size, [1.0]
    reach = range(math.floor(first - step / 2 + 0.5), math.ceil(first + step / 2 + 0.5))
    weights = [min(at + 0.5, first + step / 2) - max(at - 0.5, first - step / 2) for at in reach]
    return step - reach[0], -(-size // step) + 2, [weight / step for weight in weights]


def _interpolated(low: Tensor, step: int, first: float, size: int) -> Tensor:
    """(C, H, `size`) linear interpolation of (C, H, samples) along the last axis."""
    import torch

    if step == 1:
        return low
    count = low.shape[2] - 2
    phases = []
    for x in range(step):
        position = (x - first) / step + 1  # the first sample has the index -1
        index = math.floor(position)
        part = position - index
        phase = low[..., index : index + count]
        phases.append(phase if part == 0 else torch.lerp(phase, low[..., index + 1 : index + 1 + count], part))
    return torch.stack(phases, dim=-1).flatten(2)[..., :size]
