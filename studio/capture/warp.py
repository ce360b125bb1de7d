"""From a raw image to the one a pinhole camera of the rig would have taken: crop, undistort, scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from studio.cameras import Camera
from studio.errors import StudioError


@dataclass(frozen=True)
class Fit:
    """Where the calibrated picture lies in the footage's frames: left, top, width, height in footage pixels."""

    left: float
    top: float
    width: float
    height: float
    note: str = ""


def black_bars(image: np.ndarray) -> tuple[int, int, int, int]:
    """Rows and columns at the border that are black all along: (left, top, right, bottom), in pixels.

    Args:
        image: (H, W, 3) uint8.
    """
    bright = image.max(axis=2)
    rows, columns = bright.mean(axis=1) <= 20.0, bright.mean(axis=0) <= 20.0  # bars ring a little when compressed

    def run(flags: np.ndarray) -> int:
        return int(np.argmin(flags)) if not flags.all() else 0

    return run(columns), run(rows), run(columns[::-1]), run(rows[::-1])


def fit_size(camera: Camera, width: int, height: int, rule: str, image: np.ndarray | None) -> Fit:
    """How footage of `width` x `height` relates to the size that `camera` was calibrated at.

    The same size and sizes in proportion (within a pixel of rounding) need no rule; others see
    `CaptureSettings.size_rule`. `image`, a frame of the footage, is looked at by "auto".

    Raises:
        StudioError: the aspect ratios differ and the rule does not say what to do.
    """
    across, down = width / camera.width, height / camera.height
    if abs(across * camera.height - height) <= 1.0 or abs(down * camera.width - width) <= 1.0 or rule == "stretch":
        return Fit(0.0, 0.0, width, height)
    if rule == "crop":
        factor = max(across, down)
    else:
        factor = min(across, down)
    inner = (camera.width * factor, camera.height * factor)
    fit = Fit((width - inner[0]) / 2, (height - inner[1]) / 2, inner[0], inner[1])
    if rule in ("crop", "letterbox"):
        return fit
    if image is not None:
        left, top, right, bottom = black_bars(image)
        expected = (fit.left, fit.top)
        sides = ((left, right), (top, bottom))
        near = [max(abs(a - e), abs(b - e)) <= max(1.0, 0.3 * e) for (a, b), e in zip(sides, expected, strict=True)]
        if all(near):
            bars = f"{round(fit.left)} px left and right" if fit.left >= 0.5 else f"{round(fit.top)} px above and below"
            return replace(fit, note=f"camera '{camera.name}' has black bars ({bars}), calibration fitted between them")
    raise StudioError(
        f"Camera '{camera.name}': the footage is {width}x{height}, but it was calibrated at {camera.width}x"
        f"{camera.height}, which is another aspect ratio; calibrate it at the footage's size, or set size_rule to "
        "stretch, crop or letterbox to say how the footage was changed."
    )


class Warp:
    """Undistorts and scales images of one camera.

    Attributes:
        source: the camera of the raw frames (with its lens distortion, at the footage's size).
        camera: the pinhole camera of what `image` and `matte` return.
    """

    def __init__(self, camera: Camera, width: int, height: int, scale: float, fit: Fit | None = None) -> None:
        fit = fit or Fit(0.0, 0.0, width, height)
        stretch = np.diag([fit.width / camera.width, fit.height / camera.height, 1.0])
        K = stretch @ camera.K
        K[0, 2] += fit.left
        K[1, 2] += fit.top
        self.source = replace(camera, width=width, height=height, K=K)
        self.camera = self.source.undistorted().scaled(scale)

    @property
    def is_identity(self) -> bool:
        """Nothing to do: no distortion and full size."""
        return self.source.is_pinhole and (self.camera.width, self.camera.height) == (
            self.source.width,
            self.source.height,
        )

    def maps(self) -> tuple[np.ndarray, np.ndarray]:
        """cv2.remap's fixed-point maps from undistorted to raw pixels (6 bytes a pixel)."""
        import cv2

        source = self.source
        first, second = cv2.initUndistortRectifyMap(
            source.cv2_K, source.distortion, None, source.cv2_K, (source.width, source.height), cv2.CV_16SC2
        )
        return first, second

    def apply(self, raw: np.ndarray, maps: tuple[np.ndarray, np.ndarray] | None, smooth: bool) -> np.ndarray:
        """Undistort (with `maps`, None for pinhole cameras) and scale an image or a matte.

        Args:
            raw: (H, W, 3) or (H, W) uint8 at the footage's size.
            smooth: bicubic (images) rather than bilinear (mattes, which must not ring).

        Returns:
            uint8 at `camera`'s size; pixels that the raw image did not see are 0.
        """
        import cv2

        image = raw
        if maps is not None:
            how = cv2.INTER_CUBIC if smooth else cv2.INTER_LINEAR
            image = cv2.remap(image, maps[0], maps[1], how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        if (image.shape[1], image.shape[0]) != (self.camera.width, self.camera.height):
            image = cv2.resize(image, (self.camera.width, self.camera.height), interpolation=cv2.INTER_AREA)
        return image
