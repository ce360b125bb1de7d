"""Image files as arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studio.errors import StudioError


def _open(path: Path):  # type: ignore[no-untyped-def]
    from PIL import Image, UnidentifiedImageError

    try:
        return Image.open(path)
    except FileNotFoundError:
        raise StudioError(f"The image {path} is not there.") from None
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise StudioError(
            f"The image {path} cannot be read ({_reason(error)}); replace the file or leave the frame out."
        ) from None


def _reason(error: Exception) -> str:
    text = str(error) or type(error).__name__
    return "not an image, or damaged" if "cannot identify" in text else text


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) from the file's header, without decoding it.

    Raises:
        StudioError: the file is missing or not an image.
    """
    with _open(path) as image:
        return (int(image.size[0]), int(image.size[1]))


def read_image(path: Path) -> np.ndarray:
    """Decode an image whole.

    The pixels are as stored: an EXIF orientation is not applied, because calibrations (COLMAP's among them) are made
    on stored pixels.

    Returns:
        (H, W, 3) RGB or (H, W, 4) RGBA with straight alpha, uint8. Gray images come back with three equal channels;
        16-bit images are rounded to 8 bits.

    Raises:
        StudioError: the file is missing, truncated or not an image.
    """
    with _open(path) as image:
        try:
            image.load()
            if image.mode.startswith("I;16") or image.mode in ("I", "F"):
                values = np.asarray(image, dtype=np.float64)
                if image.mode != "F":
                    values = values / 257.0
                gray = np.clip(np.rint(values), 0, 255).astype(np.uint8)
                return np.repeat(gray[:, :, None], 3, axis=2)
            alpha = image.mode in ("RGBA", "LA", "PA", "RGBa", "La") or "transparency" in image.info
            return np.array(image.convert("RGBA" if alpha else "RGB"))
        except (OSError, ValueError, SyntaxError) as error:
            raise StudioError(
                f"The image {path} is damaged or truncated ({_reason(error)}); replace the file or leave the frame out."
            ) from None


def has_alpha(path: Path) -> bool:
    """Whether the image has an alpha channel, from its header."""
    with _open(path) as image:
        return image.mode in ("RGBA", "LA", "PA", "RGBa", "La") or "transparency" in image.info
