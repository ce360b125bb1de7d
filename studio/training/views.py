"""What training sees of a frame: images and mattes as tensors, cropped to the performer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from studio.cameras import Camera
from studio.errors import StudioError
from studio.views import CapturedView

KEPT_PIXELS = 400_000
"""Up to so many pixels a view keeps its pictures as floats too, which saves 1.4 ms of a step of 23 for 32 bytes a
pixel."""


class TrainingView:
    """One camera's picture of one moment.

    Large pictures are kept as they come, and made floats when they are asked for: 81 cameras at 4K take 2 GiB as bytes
    and 16 GiB as floats.

    Args:
        camera: pinhole, fits `image`.
        image: (H, W, 3) uint8, or float32 in 0 to 1, RGB, as filmed.
        matte: (H, W) likewise, 255 or 1 = performer.
        full_size: (width, height) of the uncropped picture.
        plate: (H, W, 3) likewise, the empty set. Where it is known, the performer is not cut out: on and around him the
            picture is compared as filmed, with the splats drawn over the plate. That is how light made it, soft edges
            and all, so that errors of the matte do no harm as long as they stay small.

    Attributes:
        camera, full_size: as above.
    """

    def __init__(
        self, camera: Camera, image: Tensor, matte: Tensor, full_size: tuple[int, int], plate: Tensor | None = None
    ) -> None:
        self.camera, self.full_size = camera, full_size
        self._image, self._matte, self._plate = image, matte, plate
        self._near = None if plate is None else surroundings(_floats(matte)).to(torch.uint8)
        self._kept: tuple[Tensor, Tensor, Tensor | None] | None = None
        if matte.numel() <= KEPT_PIXELS:
            self._matte, self._kept = _floats(matte), self._parts()

    @property
    def device(self) -> torch.device:
        """Where the pictures are."""
        return self._image.device

    @property
    def image(self) -> Tensor:
        """(H, W, 3) float32 in 0 to 1."""
        return _floats(self._image)

    @property
    def matte(self) -> Tensor:
        """(H, W) float32 in 0 to 1, 1 = performer."""
        return _floats(self._matte)

    @property
    def plate(self) -> Tensor | None:
        """(H, W, 3) float32 in 0 to 1; None where there is none."""
        return None if self._plate is None else _floats(self._plate)

    @classmethod
    def from_view(
        cls,
        view: CapturedView,
        device: torch.device | str = "cpu",
        crop_margin: float | None = None,
        use_plate: bool = True,
    ) -> TrainingView:
        """Cropped to the matte's box padded by `crop_margin` of its size and 16 px; None keeps the whole picture.

        Raises:
            StudioError: the matte is empty, so there is nothing to learn from this view.
        """
        camera, image, matte, plate = view.camera, view.image, view.matte, view.plate if use_plate else None
        size = (camera.width, camera.height)
        if crop_margin is not None:
            left, top, width, height = matte_box(matte, crop_margin, camera.name)
            camera = camera.cropped(left, top, width, height)
            image = image[top : top + height, left : left + width]
            matte = matte[top : top + height, left : left + width]
            plate = None if plate is None else plate[top : top + height, left : left + width]

        def tensor(picture: np.ndarray) -> Tensor:
            # a copy: a view of the crop would hold the whole picture
            return torch.from_numpy(np.array(picture, dtype=np.uint8, order="C")).to(device)

        return cls(camera, tensor(image), tensor(matte), size, None if plate is None else tensor(plate))

    def composited(self, background: Tensor) -> Tensor:
        """(H, W, 3): what a drawn picture is compared with.

        Without a plate the performer over the plain (3,) background color, by the matte; with one the picture as
        filmed on and around the performer, and the plain color elsewhere.
        """
        image, rest, _ = self._kept or self._parts()
        return torch.addcmul(image, rest, background)

    def backdrop(self, background: Tensor) -> Tensor | None:
        """(H, W, 3): what stands behind the splats when they are compared with `composited`: the plate on and around
        the performer, the plain color elsewhere. None without a plate: then it is the plain color."""
        if self._plate is None:
            return None
        _, rest, plate = self._kept or self._parts()
        return None if plate is None else torch.addcmul(plate, rest, background)

    def _parts(self) -> tuple[Tensor, Tensor, Tensor | None]:
        """The picture (H, W, 3) as far as it is compared itself, how much is not (H, W, 1), and the plate likewise."""
        shown = self.matte[..., None] if self._near is None else self._near.to(torch.float32)[..., None]
        plate = self.plate
        return self.image * shown, 1 - shown, None if plate is None else plate * shown


def _floats(picture: Tensor) -> Tensor:
    """A picture in 0 to 1."""
    return picture if picture.is_floating_point() else picture / 255


def surroundings(matte: Tensor) -> Tensor:
    """(H, W) 1 on the performer and around him, as far as mattes are commonly wrong: 2 % of his size, at least 4 px."""
    inside = matte > 0.5
    extent = max(int(inside.any(0).sum()), int(inside.any(1).sum()))
    reach = max(4, round(0.02 * extent))
    grown = (matte > 0.02).float()[None, None]
    for across in ((1, 0), (0, 1)):  # rows, then columns: the same square, much faster where it is large
        size, padding = [2 * reach * one + 1 for one in across], [reach * one for one in across]
        grown = torch.nn.functional.max_pool2d(grown, size, stride=1, padding=padding)
    return grown[0, 0]


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


class Shuffled:
    """Views without end, each epoch in a new random order. An iterator whose place can be noted and found again.

    Args:
        views: at least one.
        generator: draws each epoch's order.

    Raises:
        StudioError: there is no view.
    """

    def __init__(self, views: Sequence[TrainingView], generator: torch.Generator) -> None:
        if not views:
            raise StudioError("There is no view to train on; at least one training camera is needed.")
        self._views, self._generator = views, generator
        self._left: list[int] = []

    def __iter__(self) -> Iterator[TrainingView]:
        return self

    def __next__(self) -> TrainingView:
        if not self._left:
            self._left = torch.randperm(len(self._views), generator=self._generator).tolist()
        return self._views[self._left.pop(0)]

    def state(self) -> Tensor:
        """(M,) int64: what is left of this epoch, in order."""
        return torch.tensor(self._left, dtype=torch.int64)

    def restore(self, state: Tensor) -> None:
        """Go on from `state`; the generator is restored by its owner."""
        self._left = [int(index) for index in state]


def backgrounds(kind: str, generator: torch.Generator, device: torch.device) -> Iterator[Tensor]:
    """(3,) background colors without end: "random", "black" or "white"."""
    while True:
        if kind == "random":
            yield torch.rand(3, generator=generator).to(device)
        else:
            yield torch.full((3,), 0.0 if kind == "black" else 1.0, device=device)
