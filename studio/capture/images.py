"""Image files as arrays."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from studio.capture.deep_images import is_deep, read_deep_image, read_deep_values
from studio.capture.transfer import TransferFunction, eight_bit
from studio.errors import StudioError
from studio.storage import cached_object

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

_ALPHA_MODES = ("RGBA", "LA", "PA", "RGBa", "La")
_ORIENTATION = 0x0112  # of EXIF; 1 is upright
_FIX = "Replace the file or exclude the frame."


def image_header(path: Path) -> tuple[int, int, bool, bool]:
    """Width, height, whether there is an alpha channel, and whether the EXIF orientation says that the image is to be
    turned or mirrored for display; EXR and DPX are decoded. Raises StudioError: `footage.image_*`."""
    if is_deep(path) or not _pillow_reads(path):
        height, width, *channels = read_deep_values(path).shape
        return width, height, channels == [4], False
    with _open(path) as image, _undamaged(path):
        # of PNG, Pillow would decode the image
        turned = image.format in ("JPEG", "MPO", "TIFF") and image.getexif().get(_ORIENTATION, 1) != 1
        return *image.size, _is_transparent(image), turned


def read_image(path: Path, transfer: TransferFunction = "auto") -> np.ndarray:
    """Decode an image to (H, W, 3) RGB or (H, W, 4) RGBA with straight alpha, uint8; `transfer`: see
    `CaptureSettings.transfer`.

    Pixels are returned as stored: an EXIF orientation is not applied, because calibrations (COLMAP's included) refer to
    stored pixels. Gray images have three equal channels; 16-bit PNG and TIFF images are rounded to 8 bits. StudioError:
    `footage.image_missing`, or `footage.image_unreadable` if it is truncated or not an image.
    """
    if is_deep(path, transfer) or not _pillow_reads(path):
        found = read_deep_image(path, transfer)
        return _color_of(found) if found.shape[2] == 4 and _has_padding(path) else found
    with _open(path) as image:
        if _has_deep_color(image):
            found = read_deep_image(path, transfer)
            return found if _is_transparent(image) else _color_of(found)
        with _undamaged(path):
            image.load()
            if image.mode.startswith("I;16") or image.mode in ("I", "F"):
                values = np.asarray(image, dtype=np.float64)
                if image.mode != "F":
                    values = values / 257.0
                gray = np.clip(np.rint(values), 0, 255).astype(np.uint8)
                return np.repeat(gray[:, :, None], 3, axis=2)
            found = np.array(image.convert("RGBA" if _is_transparent(image) else "RGB"))
    if transfer not in ("auto", "srgb"):
        found[:, :, :3] = eight_bit(found[:, :, :3].astype(np.uint16) * 257, transfer)
    return found


def read_values(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """The numbers that an image file stores, for masks: no conversion of colors, bits or transfer functions. (H, W), or
    (H, W, 3 or 4) RGB or RGBA, of the type in the file, 1 bit as 0 and 255; and the palette, (256, 3) uint8, if the
    values are its indices."""
    if is_deep(path) or not _pillow_reads(path):
        return read_deep_values(path), None
    with _open(path) as image:
        deep = _has_deep_color(image)
    if deep:
        values = read_deep_values(path)
        return _color_of(values) if values.ndim == 3 and _has_padding(path) else values, None
    with _open(path) as image, _undamaged(path):
        image.load()
        if _is_transparent(image):
            with_alpha = np.array(image.convert("RGBA"))
            if image.mode != "P" or with_alpha[:, :, 3].min() < 255:
                return with_alpha, None
        if image.mode == "P":
            palette = np.array(image.getpalette("RGB"), np.uint8).reshape(-1, 3)
            return np.array(image), np.pad(palette, ((0, 256 - len(palette)), (0, 0)))
        if image.mode in ("L", "I", "F") or image.mode.startswith("I;16"):
            return np.array(image), None
        return np.array(image.convert("L" if image.mode == "1" else "RGB")), None


@contextlib.contextmanager
def _undamaged(path: Path) -> Iterator[None]:
    """Report what Pillow raises while it decodes a file."""
    try:
        yield
    except (OSError, ValueError, SyntaxError) as error:
        problem = f"the image is damaged or truncated ({_reason(error)})"
        raise StudioError("footage.image_unreadable", problem, file=path, fix=_FIX) from None


def _pillow_reads(path: Path) -> bool:
    """Whether Pillow reads a TIFF file, which it does not if its colors are floats, but OpenCV does."""
    if path.suffix.lower() not in (".tif", ".tiff"):
        return True
    try:
        with _open(path):
            return True
    except StudioError as error:
        return error.code != "footage.image_unreadable"


def _open(path: Path) -> ImageFile:
    from PIL import Image, UnidentifiedImageError
    from PIL.Image import MAX_IMAGE_PIXELS, DecompressionBombError

    stored = cached_object(path)
    try:
        return Image.open(path if stored is None else io.BytesIO(stored.read()))
    except FileNotFoundError:
        raise StudioError("footage.image_missing", "image not found", file=path) from None
    except DecompressionBombError:
        problem = f"the image has more than {2 * (MAX_IMAGE_PIXELS or 0):,} pixels"
        raise StudioError("footage.image_too_large", problem, file=path, fix="Scale the images down.") from None
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        problem = f"cannot read the image ({_reason(error)})"
        raise StudioError("footage.image_unreadable", problem, file=path, fix=_FIX) from None


def _is_transparent(image: ImageFile) -> bool:
    return image.mode in _ALPHA_MODES or "transparency" in image.info


def _has_padding(path: Path) -> bool:
    """Whether the fourth channel of an image means nothing: OpenCV takes it for alpha."""
    if path.suffix.lower() not in (".tif", ".tiff"):
        return False
    with contextlib.suppress(StudioError), _open(path) as image:  # some kinds are read by OpenCV only
        return not _is_transparent(image)
    return False


def _color_of(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image[:, :, :3])


def _has_deep_color(image: ImageFile) -> bool:
    """Whether the image has 16 bits per channel and Pillow would drop the lower ones instead of rounding. Pillow has no
    such color mode; its name for how the file stores pixels tells. Rare kinds that OpenCV reads otherwise stay with
    Pillow: premultiplied alpha, and one color as transparent."""
    if not image.tile or image.format not in ("PNG", "TIFF") or "transparency" in image.info:
        return False
    stored = image.tile[0][3]
    name = stored[0] if isinstance(stored, tuple) else stored
    return str(name).startswith(("RGB;16", "RGBA;16", "RGBX;16", "LA;16"))


def _reason(error: Exception) -> str:
    text = str(error) or type(error).__name__
    return "not an image, or damaged" if "cannot identify" in text else text
