"""Flicker: how much the error of a video changes from frame to frame."""

from __future__ import annotations

import numpy as np


def flicker(before: np.ndarray, now: np.ndarray) -> float:
    """RMS change of the residual between two consecutive frames of one camera, in levels of 0 to 255.

    An error that stays, such as blur, does not flicker; motion that is reproduced does not either. The footage's own
    noise is part of it, equally for all that is compared with the same footage.

    Args:
        before, now: (H, W, 3) residuals, drawn minus footage, colors in 0 to 1; the same size.
    """
    return float(np.sqrt(np.square((now - before).astype(np.float64)).mean()) * 255)
