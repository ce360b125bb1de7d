"""Training views: images and masks of one frame as tensors, cropped to the performer."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.cameras import Camera, FootageView
from v3studio.studio.chroma import ChromaSampling
from v3studio.studio.color_fit import correct_color
from v3studio.studio.errors import StudioError
from v3studio.studio.rasterizer.cpu import kernel_threads
from v3studio.studio.rasterizer.kernels import kernels_for
from v3studio.studio.training.details import Detail, DetailBox, detail_boxes

CACHED_PIXELS = 400_000
"""Views of up to this many pixels also cache floats, which saves 1.4 of 23 ms per step and takes 32 bytes a pixel."""


_INSIDE = 0.99
_HIDDEN_BLOCKS = 8
_BLOCK, _BLOCKS_ACROSS = 8, 32  # pixels of a hidden block, and number of blocks along a larger image
_BORDER = 2  # pixels of the outline that are not used: masks and splats are soft there


class TrainingView:
    """One camera's image of one frame.

    Large images are stored as bytes and converted to floats on access: 81 cameras at 4K take 2 GiB as bytes and 16 GiB
    as floats.

    Args:
        camera: pinhole camera of `image`.
        image: (H, W, 3) RGB of the footage, uint8 or float32 in 0 to 1.
        mask: (H, W), same dtype; 255 or 1 is the performer.
        plate: (H, W, 3) empty set, same dtype, or None. With a plate, the performer is not cut out: on and around the
            performer, the footage is compared with the splats rendered over the plate. This models soft edges correctly
            and tolerates small mask errors. (H, W, 4): estimated from the footage, reliable where the fourth channel is
            1. Elsewhere, and inside the performer, where it may show the performer, the mask cuts out the footage.
        chroma: chroma grid of `image`; None: no subsampling.
        doubted: (H, W) bool, where the footage contradicts the mask. The mask has no say there: the footage is compared
            with splats over the plate, without which nothing is doubted.

    Attributes:
        camera, chroma, doubted: as above.
        color: (3, 4) matrix from the splats' colors to those of this camera; None: they are the same. See
            `studio.color_fit.correct_color`.
        details: parts of the performer that count more in this frame; the same in all of its views.
        detail_boxes: where the image shows them.
        hidden: (H, W) bool, pixels that training does not see; None: it sees all.
        closer: a view of each of these boxes alone, with more pixels; None where there is none; empty: of no box.
    """

    def __init__(
        self,
        camera: Camera,
        image: Tensor,
        mask: Tensor,
        plate: Tensor | None = None,
        chroma: ChromaSampling | None = None,
        doubted: Tensor | None = None,
    ) -> None:
        self.camera, self.chroma, self.doubted = camera, chroma, None if plate is None else doubted
        self.color: Tensor | None = None
        self.hidden: Tensor | None = None
        self.details: tuple[Detail, ...] = ()
        self.detail_boxes: tuple[DetailBox, ...] = ()
        self.closer: tuple[TrainingView | None, ...] = ()
        self._image, self._mask, self._plate = image, mask, plate
        self._compared = None if plate is None else _compared(_floats(mask), plate, self.doubted)
        self._cached: tuple[Tensor, Tensor, Tensor | None, Tensor] | None = None
        if mask.numel() <= CACHED_PIXELS:
            self._mask, self._cached = _floats(mask), self._parts()

    @property
    def _is_estimated(self) -> bool:
        return self._plate is not None and self._plate.shape[-1] == 4

    @property
    def device(self) -> torch.device:
        """Device of the images."""
        return self._image.device

    @property
    def image(self) -> Tensor:
        """(H, W, 3) float32 in 0 to 1."""
        return _floats(self._image)

    @property
    def mask(self) -> Tensor:
        """(H, W) float32 in 0 to 1; 1 is the performer."""
        return _floats(self._mask)

    @property
    def plate(self) -> Tensor | None:
        """(H, W, 3) empty set, float32 in 0 to 1, or None."""
        return None if self._plate is None else _floats(self._plate[..., :3])

    @classmethod
    def from_view(
        cls,
        view: FootageView,
        device: torch.device | str = "cpu",
        crop_margin: float | None = None,
        use_plate: bool = True,
        chroma: ChromaSampling | None = None,
        box: tuple[int, int, int, int] | None = None,
    ) -> TrainingView:
        """Convert a view of the footage.

        Args:
            view: image, mask, camera and optional clean plate.
            device: device of the tensors.
            crop_margin: crop to the bounding box of the mask, padded by this fraction of its size plus 16 pixels;
                None: keep the full image.
            use_plate: False ignores the clean plate.
            chroma: chroma grid of the view's image; None: no subsampling.
            box: (left, top, width, height) in pixels to crop to, instead of `crop_margin`.

        Raises:
            StudioError: `mask.empty`: the mask does not contain any performer pixels.
        """
        camera, image, mask, plate = view.camera, view.image, view.mask, view.plate if use_plate else None
        doubted = view.doubted
        if box is None and crop_margin is not None:
            box = mask_box(mask if doubted is None else np.where(doubted, 255, mask), crop_margin, camera.name)
        if box is not None:
            left, top, width, height = box
            camera = camera.cropped(left, top, width, height)
            chroma = None if chroma is None else chroma.cropped(left, top)
            image = image[top : top + height, left : left + width]
            mask = mask[top : top + height, left : left + width]
            plate = None if plate is None else plate[top : top + height, left : left + width]
            doubted = None if doubted is None else doubted[top : top + height, left : left + width]

        def tensor(image: np.ndarray) -> Tensor:
            # copy: a NumPy view of the crop would keep the full image in memory
            return torch.from_numpy(np.array(image, dtype=np.uint8, order="C")).to(device)

        return cls(
            camera, tensor(image), tensor(mask), None if plate is None else tensor(plate), chroma,
            None if doubted is None else tensor(doubted) > 0,
        )  # fmt: skip

    def _with(self, **changes: Any) -> TrainingView:
        view = copy.copy(self)
        vars(view).update(changes)
        return view

    def with_mask(self, mask: Tensor) -> TrainingView:
        """Return the view with another (H, W) mask, 0 to 1. Where it is compared over the plate stays the same."""
        # a large view is stored as bytes
        view = self._with(_mask=mask if self._mask.is_floating_point() else (mask * 255 + 0.5).to(torch.uint8))
        if self._cached is not None and (self._plate is None or self._is_estimated):
            view._cached = view._parts()
        return view

    def uncached(self) -> TrainingView:
        """Return the view in a form that takes a third of the memory and a bit more time on access."""
        return self._with(_cached=None)

    def with_color(self, matrix: Tensor) -> TrainingView:
        """Return the view from a camera with other colors; `matrix`: (3, 4), see `color`."""
        return self._with(color=matrix.to(self.device, torch.float32))

    def with_hidden(self, number: int) -> TrainingView:
        """Return the view with every `_HIDDEN_BLOCKS`-th block of pixels `hidden`; which ones depends on `number`."""
        height, width = self._mask.shape
        side = max(_BLOCK, math.ceil(max(height, width) / _BLOCKS_ACROSS))
        row, column = (torch.arange(length, device=self.device) // side for length in (height, width))
        return self._with(hidden=(column + 3 * row[:, None] + number) % _HIDDEN_BLOCKS == 0)

    def with_details(self, details: Sequence[Detail]) -> TrainingView:
        """Return the view with other details."""
        return self._with(details=tuple(details), detail_boxes=detail_boxes(self.camera, details), closer=())

    def with_closer(
        self, large: FootageView, use_plate: bool = True, chroma: ChromaSampling | None = None
    ) -> TrainingView:
        """Return the view with `closer` views of its details.

        Args:
            large: what the same camera saw, uncropped and in more pixels.
            use_plate, chroma: as for `from_view`, of `large`.
        """

        def of(box: DetailBox) -> TrainingView | None:
            across, down = large.camera.fx / self.camera.fx, large.camera.fy / self.camera.fy
            # the same rays, in the pixels of the large image
            left, right = (
                round((edge - self.camera.K[0, 2]) * across + large.camera.K[0, 2]) for edge in (box.left, box.right)
            )
            top, bottom = (
                round((edge - self.camera.K[1, 2]) * down + large.camera.K[1, 2]) for edge in (box.top, box.bottom)
            )
            if not (large.mask[top:bottom, left:right] > 127).any():
                return None
            size = (left, top, right - left, bottom - top)
            closer_view = TrainingView.from_view(large, self.device, None, use_plate, chroma, size)
            closer_view.color = self.color
            return closer_view

        return self._with(closer=tuple(of(box) for box in self.detail_boxes))

    def in_its_colors(self, image: Tensor, alpha: Tensor, behind: Tensor) -> Tensor:
        """A render in the colors of this camera (`color`); differentiable.

        Only the splats change: a background color has no color error, and a plate has that of this camera.

        Args:
            image: (H, W, 3) rendered over `behind`.
            alpha: (H, W) rendered alpha.
            behind: (3,) or (H, W, 3) background.
        """
        if self.color is None:
            return image
        rest = (1 - alpha)[..., None] * behind
        return correct_color(image - rest, alpha, self.color) + rest

    def over(self, background: Tensor) -> tuple[Tensor, Tensor]:
        """The view over a (3,) background color, and over what splats are rendered for comparison with it.

        Without a plate: (H, W, 3) performer, composited over the color with the mask; the color. With a plate: (H, W,
        3) footage on and around the performer, and the color elsewhere; (H, W, 3) the same of the plate.
        """
        image, rest, plate, plate_rest = self._cached or self._parts()
        target = over_color(image, rest, background)
        return target, background if plate is None else over_color(plate, plate_rest, background)

    def _parts(self) -> tuple[Tensor, Tensor, Tensor | None, Tensor]:
        """The image (H, W, 3) times its weight, one minus the weight (H, W, 1), and the same of the plate."""
        plate, shown = self.plate, self.mask[..., None]
        if plate is None or self._compared is None:
            return self.image * shown, 1 - shown, None, 1 - shown
        compared = self._compared.to(torch.float32)[..., None]
        shown = torch.maximum(shown, compared) if self._is_estimated else compared
        return self.image * shown, 1 - shown, plate * compared, 1 - compared


def over_color(image: Tensor, rest: Tensor, color: Tensor) -> Tensor:
    """(H, W, 3): `image` + `rest` * `color`, for (H, W, 3), (H, W, 1) and (3,).

    On the CPU in a kernel: PyTorch takes several times as long where the last dimension is one of three.
    """
    kernels = kernels_for(image, rest, color)
    if kernels is None or image.dtype != torch.float32:
        return torch.addcmul(image, rest, color)
    out: Tensor = kernels.empty_float(list(image.shape))
    kernels.over(image.contiguous(), rest.contiguous(), color.contiguous(), out, kernel_threads())
    return out


def _floats(image: Tensor) -> Tensor:
    """An image converted to floats in 0 to 1."""
    return image if image.is_floating_point() else image / 255


def _grown(mask: Tensor, reach: int) -> Tensor:
    grown = (mask > 0.02).float()[None, None]
    for axis in ((1, 0), (0, 1)):  # separable: rows, then columns
        size, padding = [2 * reach * on + 1 for on in axis], [reach * on for on in axis]
        grown = torch.nn.functional.max_pool2d(grown, size, stride=1, padding=padding)
    return grown[0, 0]


def _compared(mask: Tensor, plate: Tensor, doubted: Tensor | None) -> Tensor:
    """(H, W) uint8, 1 where footage is compared with splats over the plate: see `TrainingView`."""
    inside = mask > 0.5
    extent = max(int(inside.any(0).sum()), int(inside.any(1).sum()))
    reach = max(4, round(0.02 * extent))  # around the performer: 2% of their size, at least 4 pixels
    near = _grown(mask, reach)
    if plate.shape[-1] == 4:
        near = near * _grown(1 - mask, reach)
    if doubted is not None:
        near = torch.maximum(near, doubted.to(near))
    if plate.shape[-1] == 4:
        near = near * (_floats(plate[..., 3]) > 0.5)
    return near.to(torch.uint8)


def interior(mask: Tensor) -> Tensor:
    """(H, W) bool: at least two pixels from the outline; all of a performer that is too thin to have an inside."""
    inside = (mask > _INSIDE).float()
    eroded = 1 - torch.nn.functional.max_pool2d(1 - inside[None, None], 2 * _BORDER + 1, 1, _BORDER)[0, 0]
    return eroded > 0.5 if bool((eroded > 0.5).any()) else mask > 0.5


def mask_box(mask: np.ndarray, margin: float, name: str) -> tuple[int, int, int, int]:
    """Bounding box (left, top, width, height) of the performer in pixels, padded and clipped to the image.

    Args:
        mask: (H, W) uint8; pixels above one half are the performer.
        margin: padding as a fraction of the size of the box; 16 pixels are added to it.
    """
    rows = np.flatnonzero((mask > 127).any(1))
    columns = np.flatnonzero((mask > 127).any(0))
    if rows.size == 0:
        problem = f"the mask of camera '{name}' is empty, so the view cannot be used for training"
        raise StudioError("mask.empty", problem, fix="Fix the mask", camera=name)
    pad_y = 16 + int(margin * (rows[-1] - rows[0] + 1))
    pad_x = 16 + int(margin * (columns[-1] - columns[0] + 1))
    top, bottom = max(0, rows[0] - pad_y), min(mask.shape[0], rows[-1] + 1 + pad_y)
    left, right = max(0, columns[0] - pad_x), min(mask.shape[1], columns[-1] + 1 + pad_x)
    return int(left), int(top), int(right - left), int(bottom - top)


def backgrounds(kind: str, generator: torch.Generator, device: torch.device) -> Iterator[Tensor]:
    """Endless (3,) RGB background colors of a `kind`: "random", "black" or "white"."""
    if kind != "random":
        color = torch.full((3,), 0.0 if kind == "black" else 1.0, device=device)
        while True:
            yield color
    while True:
        # a blocking copy would wait for all kernels that are queued
        yield torch.rand(3, generator=generator).to(device, non_blocking=True)
