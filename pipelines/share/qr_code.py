"""QR codes of addresses, for terminals and for the window."""

from __future__ import annotations

import io

import numpy as np

_QUIET = 4  # light modules around the code, which readers need
_ERROR_CORRECTION = "m"


def qr_text(address: str) -> str:
    """The code in half blocks for a terminal, white on black whatever colors the terminal has."""
    import segno

    out = io.StringIO()
    segno.make(address, error=_ERROR_CORRECTION, micro=False).terminal(out, border=_QUIET, compact=True)
    lines = out.getvalue().rstrip("\n").split("\n")
    return "\n".join(f"\x1b[97;40m{line}\x1b[0m" for line in lines)


def qr_pixels(address: str, size: int) -> np.ndarray:
    """The code as an image.

    Args:
        address: what it says.
        size: largest width and height in pixels; modules have whole pixels, at least one.

    Returns:
        (H, W, 3) uint8, black on white, with its margin.
    """
    import segno

    code = segno.make(address, error=_ERROR_CORRECTION, micro=False)
    scale = max(size // code.symbol_size(border=_QUIET)[0], 1)
    dark = np.array([list(row) for row in code.matrix_iter(scale=scale, border=_QUIET)], bool)
    return np.repeat(np.where(dark, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
