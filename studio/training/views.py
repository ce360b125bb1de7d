"""What training sees of a frame: images and mattes as tensors, cropped to the performer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from studio.cameras import Camera
from studio.errors import StudioError
from studio.views import CapturedView


@dataclass(eq=False)
class TrainView:
    """One camera's picture of one moment.

    Attributes:
        camera: pinhole, fits `image`.
        image: (H, W, 3) float32 in 0 to 1, RGB, as filmed.
        matte: (H, W) float32 in 0 to 1, 1 = performer.
        full_size: (width, height) of the uncropped picture.
        plate: (H, W, 3) float32, the empty set. Where it is known, the performer is not cut out: on and around him the
            picture is compared as filmed, with the splats drawn over the plate. That is how light made it, soft edges
            and all, so that errors of the matte do no harm as long as they stay small.
    """

    camera: Camera
    image: Tensor
    matte: Tensor
    full_size: tuple[int, int]
    plate: Tensor | None = None
    _shown: Tensor = field(init=False)
    _plain: Tensor = field(init=False)
    _behind: Tensor | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        shown = self.matte[..., None]
        if self.plate is not None:
            shown = surroundings(self.matte)[..., None]
            self._behind = self.plate * shown
        self._plain = 1 - shown
        self._shown = self.image * shown

    @classmethod
    def from_view(
        cls,
        view: CapturedView,
        device: torch.device | str = "cpu",
        crop_margin: float | None = None,
        use_plate: bool = True,
    ) -> TrainView:
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
            return torch.from_numpy(np.ascontiguousarray(picture)).to(device).float() / 255

        return cls(camera, tensor(image), tensor(matte), size, None if plate is None else tensor(plate))

    def composited(self, background: Tensor) -> Tensor:
        """(H, W, 3): what a drawn picture is compared with.

        Without a plate the performer over the plain (3,) background colour, by the matte; with one the picture as
        filmed on and around the performer, and the plain colour elsewhere.
        """
        return torch.addcmul(self._shown, self._plain, background)

    def backdrop(self, background: Tensor) -> Tensor | None:
        """(H, W, 3): what stands behind the splats when they are compared with `composited`: the plate on and around
        the performer, the plain colour elsewhere. None without a plate: then it is the plain colour."""
        return None if self._behind is None else torch.addcmul(self._behind, self._plain, background)


def surroundings(matte: Tensor) -> Tensor:
    """(H, W) 1 on the performer and around him, as far as mattes are commonly wrong: 2 % of his size, at least 4 px."""
    inside = matte > 0.5
    extent = max(int(inside.any(0).sum()), int(inside.any(1).sum()))
    reach = max(4, round(0.02 * extent))
    grown = torch.nn.functional.max_pool2d((matte > 0.02).float()[None, None], 2 * reach + 1, stride=1, padding=reach)
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

    def __init__(self, views: Sequence[TrainView], generator: torch.Generator) -> None:
        if not views:
            raise StudioError("There is no view to train on; at least one training camera is needed.")
        self._views, self._generator = views, generator
        self._left: list[int] = []

    def __iter__(self) -> Iterator[TrainView]:
        return self

    def __next__(self) -> TrainView:
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
    """(3,) background colours without end: "random", "black" or "white"."""
    while True:
        if kind == "random":
            yield torch.rand(3, generator=generator).to(device)
        else:
            yield torch.full((3,), 0.0 if kind == "black" else 1.0, device=device)
