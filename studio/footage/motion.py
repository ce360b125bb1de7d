"""Motion of a performer between two frames of a camera, in units of the performer's size, whatever moves around them.

Splats follow a performer from the keyframe outward. The farther they have gone, the worse they fit, so a group of
frames should end before the performer has moved far: limbs that move fast count more than a slow walk.
"""

import cv2
import numpy as np

SIDE = 96  # pixels along each side of the images that are compared; the performer fills them

_MARGIN = 0.1
_MIN_PIXELS = 16  # minimum number of foreground pixels; images with fewer contain too little information
_STILL = 0.1  # displacement in compared pixels that noise can cause

_NEAR = 0.2
"""Distance from the other frame's mask, in sizes of the performer, beyond which something has appeared or vanished."""


def motion(images: tuple[np.ndarray, np.ndarray], masks: tuple[np.ndarray, np.ndarray]) -> float | None:
    """Root mean square of the displacement of the performer's pixels, from optical flow, plus the share of them that
    appeared or vanished. The unit is the performer's size: the square root of their area.

    Takes (H, W, 3) uint8 RGB images and (H, W) uint8 masks (255 = performer) of two consecutive frames. 0 if nothing
    moves, 1 if the performer is visible in one frame only, None if in neither.
    """
    inside = [(mask > 127).astype(np.uint8) for mask in masks]
    visible = [int(mask.sum()) >= _MIN_PIXELS for mask in inside]
    if not all(visible):
        return 1.0 if any(visible) else None
    x, y, width, height = cv2.boundingRect(np.maximum(*inside))
    margin = round(_MARGIN * max(width, height))
    rows, columns = (slice(max(0, at - margin), at + size + margin) for at, size in ((y, height), (x, width)))
    before, after = (cv2.cvtColor(_small(image[rows, columns]), cv2.COLOR_RGB2GRAY) for image in images)
    old, new = ((_small(255 * mask[rows, columns]) > 127).astype(np.uint8) for mask in inside)
    area = max(int(old.sum()), 1)
    finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    finder.setFinestScale(0)  # the preset's 2 smooths limbs away
    flow = finder.calc(before, after, None)  # type: ignore[call-overload]  # None: no first guess
    moved = np.maximum(np.linalg.norm(flow, axis=-1)[old > 0] - _STILL, 0)
    reach = 2 * round(_NEAR * area**0.5) + 1
    near = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    changed = sum(int((mask > cv2.dilate(other, near)).sum()) for mask, other in ((old, new), (new, old)))
    return float(np.sqrt(np.square(moved).sum()) + changed) / area


def _small(image: np.ndarray) -> np.ndarray:
    """The image, scaled to fit (SIDE, SIDE), with a black border at the right or below."""
    scale = SIDE / max(image.shape[:2])
    height, width = (max(1, round(scale * size)) for size in image.shape[:2])
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return cv2.copyMakeBorder(small, 0, SIDE - height, 0, SIDE - width, cv2.BORDER_CONSTANT)
