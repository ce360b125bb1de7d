"""Turns raw images into images of a pinhole camera, without distortion and scaled, and adapts calibrations to the
footage's size."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.lenses import distorted
from v3studio.studio.validation import camera_error


@dataclass(frozen=True)
class Fit:
    """The calibrated image's rectangle in the footage, pixels; `note`: a clause for the user if it was guessed."""

    left: float
    top: float
    width: float
    height: float
    note: str = ""


def black_bars(image: np.ndarray) -> tuple[int, int, int, int]:
    """Widths of the black bars at the borders: (left, top, right, bottom) in pixels. `image`: (H, W, 3) uint8."""
    bright = image.max(axis=2)
    rows, columns = bright.mean(axis=1) <= 20.0, bright.mean(axis=0) <= 20.0  # compression brightens bars slightly

    def run(flags: np.ndarray) -> int:
        return int(np.argmin(flags)) if not flags.all() else 0

    return run(columns), run(rows), run(columns[::-1]), run(rows[::-1])


def fit_size(camera: Camera, width: int, height: int, rule: str, read: Callable[[], np.ndarray]) -> Fit:
    """Fit the image size at which `camera` was calibrated to footage of another size. If the aspect ratios are equal
    (within one pixel of rounding), the rule is not used; "auto" detects black bars in the image, of which `read`
    returns (H, W, 3 or more) uint8."""
    across, down = width / camera.width, height / camera.height
    if abs(across * camera.height - height) <= 1.0 or abs(down * camera.width - width) <= 1.0 or rule == "stretch":
        return Fit(0.0, 0.0, width, height)
    factor = max(across, down) if rule == "crop" else min(across, down)
    inner = (camera.width * factor, camera.height * factor)
    fit = Fit((width - inner[0]) / 2, (height - inner[1]) / 2, inner[0], inner[1])
    if rule in ("crop", "letterbox"):
        return fit
    left, top, right, bottom = black_bars(read()[:, :, :3])
    expected = (fit.left, fit.top)
    sides = ((left, right), (top, bottom))
    near = [max(abs(a - e), abs(b - e)) <= max(1.0, 0.3 * e) for (a, b), e in zip(sides, expected, strict=True)]
    if all(near):
        bars = f"{round(fit.left)} px left and right" if fit.left >= 0.5 else f"{round(fit.top)} px top and bottom"
        return replace(fit, note=f"camera '{camera.name}' has black bars ({bars}); calibration mapped to the rest")
    turned = abs(width / camera.height * camera.width - height) <= 1.0
    raise camera_error(
        "footage.aspect_ratio",
        camera.name,
        f"the footage, {width}x{height}, is turned by 90 degrees against the calibration, "
        f"{camera.width}x{camera.height}"
        if turned
        else f"the aspect ratio of the footage, {width}x{height}, differs from the calibration's, "
        f"{camera.width}x{camera.height}",
        value=(width, height),
        fix="Turn the footage (for example: ffmpeg -i IN -vf transpose=1 OUT, or transpose=2 for the other direction), "
        "or calibrate with the footage as it is."
        if turned
        else "Calibrate at the footage's size, or set capture.size_rule to stretch, crop or letterbox, depending on "
        "how the footage was resized.",
        expected=(camera.width, camera.height),
        setting="capture.size_rule",
    )


_STEP = 4  # every fourth row and column is enough


class Warp:
    """Undistorts and scales the images of one camera, with lens distortion, of footage of width x height pixels.

    `scale`: size of the result relative to the footage, 0 < scale <= 1; `fit`: see `fit_size`; None: the calibrated
    image fills the frame. `source` is the camera of the raw frames, `camera` the pinhole camera of the result of
    `apply`.
    """

    def __init__(self, camera: Camera, width: int, height: int, scale: float, fit: Fit | None = None) -> None:
        fit = fit or Fit(0.0, 0.0, width, height)
        stretch = np.diag([fit.width / camera.width, fit.height / camera.height, 1.0])
        K = stretch @ camera.K
        K[0, 2] += fit.left
        K[1, 2] += fit.top
        self.source = replace(camera, width=width, height=height, K=K)
        view = self.source.undistorted()
        K = view.K.copy()
        K[0, 1] = 0.0  # the rasterizer has no skew
        self._straight = replace(view, K=K)
        self.camera = self._straight.scaled(scale)

    @property
    def is_identity(self) -> bool:
        """Return whether images remain unchanged: no distortion, no skew and full size."""
        size = self.camera.width, self.camera.height
        return self.is_straight and size == (self.source.width, self.source.height)

    @property
    def is_straight(self) -> bool:
        """Return whether raw images are those of a pinhole camera without skew."""
        return self.source.is_pinhole and not self.source.K[0, 1]

    def maps(self) -> tuple[np.ndarray, np.ndarray]:
        """Fixed-point maps for `cv2.remap` from undistorted to raw pixels, 6 bytes per pixel."""
        import cv2

        if self.source.fisheye:
            return _fisheye_maps(self.source, self._straight)
        K, skew = self._straight.cv2_K, self.source.K[0, 1]
        size, kind = (self.source.width, self.source.height), cv2.CV_32FC1 if skew else cv2.CV_16SC2
        first, second = cv2.initUndistortRectifyMap(K, self.source.distortion, None, K, size, kind)
        if skew:  # which OpenCV does not know
            first += np.float32(skew / K[1, 1]) * (second - np.float32(K[1, 2]))
            first, second = cv2.convertMaps(first, second, cv2.CV_16SC2)
        return first, second

    def beyond(self, mask: np.ndarray) -> float:
        """The fraction of the pixels of a raw mask, (H, W) uint8, that lie beyond the edge of a fisheye's view."""
        performer = mask[::_STEP, ::_STEP] >= 128
        return float(1 - self._in_view[performer].mean()) if performer.any() else 0.0

    @cached_property
    def _in_view(self) -> np.ndarray:
        """(h, w) bool: pixels of every fourth row and column of a fisheye's raw images that its view shows."""
        view = self._straight
        rows, columns = np.mgrid[: self.source.height : _STEP, : self.source.width : _STEP]
        rays = self.source.normalized(np.column_stack([columns.ravel(), rows.ravel()]) + 0.5)
        pixels = rays * [view.fx, view.fy] + view.K[:2, 2]
        inside = (pixels >= 0).all(1) & (pixels <= [view.width, view.height]).all(1)  # NaN is outside
        return np.asarray(inside.reshape(rows.shape))

    def apply(self, raw: np.ndarray, maps: tuple[np.ndarray, np.ndarray] | None, smooth: bool) -> np.ndarray:
        """Undistort and scale (H, W, 3) or (H, W) uint8 at the footage's size to the size of `camera`; pixels outside
        are 0.

        `maps` are from `maps`, None if the camera `is_straight`; `smooth`: bicubic (for images) rather than bilinear
        (for masks, which must not overshoot).
        """
        import cv2

        image = raw
        if maps is not None:
            how = cv2.INTER_CUBIC if smooth else cv2.INTER_LINEAR
            image = cv2.remap(image, maps[0], maps[1], how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        if (image.shape[1], image.shape[0]) != (self.camera.width, self.camera.height):
            image = cv2.resize(image, (self.camera.width, self.camera.height), interpolation=cv2.INTER_AREA)
        return image


def _fisheye_maps(source: Camera, view: Camera) -> tuple[np.ndarray, np.ndarray]:
    import cv2

    maps = np.empty((view.height, view.width, 2), np.float32)
    x = (np.arange(view.width) + 0.5 - view.cx) / view.fx
    for row in range(view.height):  # a whole 4K image takes gigabytes
        y = (row + 0.5 - view.cy) / view.fy
        bent = distorted(np.column_stack([x, np.full_like(x, y)]), source.distortion, True)
        maps[row] = bent @ source.K[:2, :2].T + source.K[:2, 2] - 0.5
    first, second = cv2.convertMaps(maps[..., 0].copy(), maps[..., 1].copy(), cv2.CV_16SC2)
    return first, second
