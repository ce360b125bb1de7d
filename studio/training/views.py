"""What training sees of a frame: images and mattes as tensors, cropped to the performer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from studio.cameras import Camera
from studio.errors import StudioError


class CapturedView(Protocol):
    """What a footage object hands out: a pinhole camera, (H, W, 3) uint8 RGB and a (H, W) uint8 matte."""

    @property
    def camera(self) -> Camera: ...
    @property
    def image(self) -> np.ndarray: ...
    @property
    def matte(self) -> np.ndarray: ...


@dataclass(eq=False)
class TrainView:
    """One camera's picture of one moment.

    Attributes:
        camera: pinhole, fits `image`.
        image: (H, W, 3) float32 in 0 to 1, RGB, as filmed.
        matte: (H, W) float32 in 0 to 1, 1 = performer.
        full_size: (width, height) of the uncropped picture.
    """

    camera: Camera
    image: Tensor
    matte: Tensor
    full_size: tuple[int, int]
    _foreground: Tensor = field(init=False)
    _see_through: Tensor = field(init=False)

    def __post_init__(self) -> None:
        self._see_through = 1 - self.matte[..., None]
        self._foreground = self.image * self.matte[..., None]

    @classmethod
    def from_view(
        cls, view: CapturedView, device: torch.device | str = "cpu", crop_margin: float | None = None
    ) -> TrainView:
        """Cropped to the matte's box padded by `crop_margin` of its size and 16 px; None keeps the whole picture.

        Raises:
            StudioError: the matte is empty, so there is nothing to learn from this view.
        """
        camera, image, matte = view.camera, view.image, view.matte
        size = (camera.width, camera.height)
        if crop_margin is not None:
            left, top, width, height = matte_box(matte, crop_margin, camera.name)
            camera = camera.cropped(left, top, width, height)
            image = image[top : top + height, left : left + width]
            matte = matte[top : top + height, left : left + width]
        return cls(
            camera,
            torch.from_numpy(np.ascontiguousarray(image)).to(device).float() / 255,
            torch.from_numpy(np.ascontiguousarray(matte)).to(device).float() / 255,
            size,
        )

    def composited(self, background: Tensor) -> Tensor:
        """(H, W, 3): the performer over a plain (3,) background colour, by the matte."""
        return torch.addcmul(self._foreground, self._see_through, background)


def matte_box(matte: np.ndarray, margin: float, name: str) -> tuple[int, int, int, int]:
    """(left, top, width, height) of the matte above one half, padded by `margin` of its size and 16 px, clipped.

    Raises:
        StudioError: no pixel of the matte is above one half.
    """
    rows = np.flatnonzero((matte > 127).any(1))
    columns = np.flatnonzero((matte > 127).any(0))
    if rows.size == 0:
        raise StudioError(f"Camera '{name}': the mask is empty, so this view cannot be trained on; mend its mask.")
    pad_y = 16 + int(margin * (rows[-1] - rows[0] + 1))
    pad_x = 16 + int(margin * (columns[-1] - columns[0] + 1))
    top, bottom = max(0, rows[0] - pad_y), min(matte.shape[0], rows[-1] + 1 + pad_y)
    left, right = max(0, columns[0] - pad_x), min(matte.shape[1], columns[-1] + 1 + pad_x)
    return int(left), int(top), int(right - left), int(bottom - top)


def shuffled(views: Sequence[TrainView], generator: torch.Generator) -> Iterator[TrainView]:
    """Views without end, each epoch in a new random order."""
    if not views:
        raise StudioError("There is no view to train on.")
    while True:
        for index in torch.randperm(len(views), generator=generator).tolist():
            yield views[index]


def backgrounds(kind: str, generator: torch.Generator, device: torch.device) -> Iterator[Tensor]:
    """(3,) background colours without end: "random", "black" or "white"."""
    while True:
        if kind == "random":
            yield torch.rand(3, generator=generator).to(device)
        else:
            yield torch.full((3,), 0.0 if kind == "black" else 1.0, device=device)
