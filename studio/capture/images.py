"""Image files as arrays: read with Pillow, but OpenEXR and DPX with FFmpeg, and TIFF and PNG of more than 8 bits with
OpenCV."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from v3studio.studio.capture.exr_header import exr_for_ffmpeg
from v3studio.studio.capture.transfer import TransferFunction, eight_bit
from v3studio.studio.errors import StudioError
from v3studio.studio.memory import is_out_of_memory
from v3studio.studio.storage import cached_object

if TYPE_CHECKING:
    from av.video.frame import VideoFrame
    from PIL.ImageFile import ImageFile

_FFMPEG = (".exr", ".dpx")
_TIFF = (".tif", ".tiff")
_MOST_LIGHT = 64  # of floats, where 1 is white
_ALPHA_MODES = ("RGBA", "LA", "PA", "RGBa", "La")
_ORIENTATION = 0x0112  # of EXIF; 1 is upright


def image_header(path: Path) -> tuple[int, int, bool, str]:
    """Width, height, whether there is an alpha channel, and a clause about what viewers do with the image besides: its
    EXIF orientation, its color profile. EXR and DPX are decoded. Raises StudioError: `footage.image_*`."""
    if _is_deep(path):
        height, width, *channels = _deep_values(path).shape
        return width, height, channels == [4], ""
    with _open(path) as image, _undamaged(path):
        # of PNG, Pillow would decode the image
        turned = image.format in ("JPEG", "MPO", "TIFF") and image.getexif().get(_ORIENTATION, 1) != 1
        notes = ["EXIF turns the images for display, but they are used as stored"] if turned else []
        if b"sRGB" not in image.info.get("icc_profile", b"sRGB").replace(b"\0", b""):  # names may be UTF-16
            notes.append("the images have a color profile other than sRGB, and their values are read as sRGB")
        return *image.size, _is_transparent(image), "; ".join(notes)


def read_image(path: Path, transfer: TransferFunction = "auto") -> np.ndarray:
    """Decode an image to (H, W, 3) RGB or (H, W, 4) RGBA with straight alpha, uint8; `transfer`: see
    `CaptureSettings.transfer`.

    Pixels are returned as stored: an EXIF orientation is not applied, because calibrations (COLMAP's included) refer to
    stored pixels. Gray images have three equal channels; 16-bit PNG and TIFF images are rounded to 8 bits. StudioError:
    `footage.image_missing`, or `footage.image_unreadable` if it is truncated or not an image.
    """
    if _is_deep(path, transfer):
        pixels = _deep_image(path, transfer)
        return _color_of(pixels) if pixels.shape[2] == 4 and _has_padding(path) else pixels
    with _open(path) as image, _undamaged(path):
        if _has_deep_values(image):
            pixels = _deep_image(path, transfer)
            return pixels if _is_transparent(image) else _color_of(pixels)
        image.load()
        if image.mode.startswith("I"):  # of PNG
            gray = np.clip(np.rint(np.asarray(image, dtype=np.float64) / 257.0), 0, 255).astype(np.uint8)
            return np.repeat(gray[:, :, None], 3, axis=2)
        pixels = np.array(image.convert("RGBA" if _is_transparent(image) else "RGB"))
    if transfer not in ("auto", "srgb"):
        pixels[:, :, :3] = eight_bit(pixels[:, :, :3].astype(np.uint16) * 257, transfer)
    return pixels


def read_values(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """The numbers that an image file stores, for masks: no conversion of colors, bits or transfer functions. (H, W), or
    (H, W, 3 or 4) RGB or RGBA, of the type in the file, 1 bit as 0 and 255; and the palette, (256, 3) uint8, if the
    values are its indices."""
    if _is_deep(path):
        return _deep_values(path), None
    with _open(path) as image, _undamaged(path):
        if _has_deep_values(image):
            numbers = _deep_values(path)
            return numbers if numbers.ndim != 3 or _is_transparent(image) else _color_of(numbers), None
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
        if is_out_of_memory(error):
            raise
        _refuse(path, f"damaged or truncated: {_reason(error)}")


def _is_deep(path: Path, transfer: TransferFunction = "auto") -> bool:
    """Return whether the file is not read with Pillow: by its format, or for a transfer function that needs all bits.
    Pillow does not read TIFF files whose colors are floats, but OpenCV does."""
    suffix = path.suffix.lower()
    if suffix in _FFMPEG or (suffix in (*_TIFF, ".png") and transfer not in ("auto", "srgb")):
        return True
    if suffix in _TIFF:
        try:
            _open(path).close()
        except StudioError as error:
            return error.code == "footage.image_unreadable"
    return False


def _open(path: Path) -> ImageFile:
    from PIL import Image
    from PIL.Image import MAX_IMAGE_PIXELS, DecompressionBombError

    try:
        stored = cached_object(path)
        return Image.open(path if stored is None else io.BytesIO(stored.read()))
    except FileNotFoundError:
        raise StudioError("footage.image_missing", "image not found", file=path) from None
    except DecompressionBombError:
        problem = f"the image has more than {2 * (MAX_IMAGE_PIXELS or 0):,} pixels"
        raise StudioError("footage.image_too_large", problem, file=path, fix="Scale the images down.") from None
    except (OSError, ValueError, SyntaxError) as error:
        if is_out_of_memory(error):
            raise
        _refuse(path, _reason(error))


def _is_transparent(image: ImageFile) -> bool:
    return image.mode in _ALPHA_MODES or "transparency" in image.info


def _has_padding(path: Path) -> bool:
    """Return whether the fourth channel of an image means nothing: OpenCV takes it for alpha."""
    if path.suffix.lower() not in _TIFF:
        return False
    with contextlib.suppress(StudioError), _open(path) as image:  # some kinds are read by OpenCV only
        return not _is_transparent(image)
    return False


def _color_of(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image[:, :, :3])


def _has_deep_values(image: ImageFile) -> bool:
    """Return whether the image has 16 bits per channel and Pillow would drop the lower ones instead of rounding, or is
    a TIFF file whose values Pillow returns as they are, whatever they mean. Pillow has no color mode with 16 bits; its
    name for how the file stores pixels tells. Rare kinds that OpenCV reads otherwise stay with Pillow: premultiplied
    alpha, and one color as transparent."""
    if not image.tile or image.format not in ("PNG", "TIFF") or "transparency" in image.info:
        return False
    if image.format == "TIFF" and (image.mode[0] in "IF" or _TiffKind(image.tag_v2).has_deep_planes):  # type: ignore[attr-defined]
        return True
    stored = image.tile[0][3]
    name = stored[0] if isinstance(stored, tuple) else stored
    return str(name).startswith(("RGB;16", "RGBA;16", "RGBX;16", "LA;16"))


class _TiffKind:
    """The way in which a TIFF file stores numbers, from its tags by number."""

    def __init__(self, tags: Mapping[int, Any]) -> None:
        self.bits = max(np.atleast_1d(tags.get(258, 1)))  # per sample
        self.is_float = 3 in np.atleast_1d(tags.get(339, 1))
        self.zero_is_white = tags.get(262) == 0
        self.has_deep_planes = self.bits > 8 and tags.get(284) == 2 and tags.get(277, 1) > 1

    @classmethod
    def of(cls, data: bytes) -> _TiffKind:
        """The kind of a file, also of one that Pillow cannot open."""
        from PIL.TiffImagePlugin import ImageFileDirectory_v2

        stream = io.BytesIO(data)
        tags = ImageFileDirectory_v2(stream.read(16 if data[2:3] == b"+" else 8))  # BigTIFF has a longer header
        stream.seek(tags.next)
        tags.load(stream)
        return cls(tags)


def _reason(error: Exception) -> str:
    text = str(error) or type(error).__name__
    return "not an image, or damaged" if "cannot identify" in text else text


def _deep_image(path: Path, transfer: TransferFunction) -> np.ndarray:
    """Decode an EXR (RGB or gray, half or float), DPX (8 to 16 bits), TIFF or PNG file to (H, W, 3) RGB or (H, W, 4)
    RGBA with straight alpha, uint8 sRGB; `transfer` auto: EXR files are linear, others sRGB."""
    stored = _deep_values(path)
    if stored.dtype.name not in ("uint8", "uint16") and stored.dtype.kind != "f":
        _refuse(
            path, "of 32-bit integers, whose white is not known", "Save it with 8 or 16 bits, or as floats up to 1."
        )
    if stored.dtype != np.uint16 or transfer not in ("auto", "srgb"):
        if stored.dtype.kind == "f" and path.suffix.lower() in _TIFF and np.nanmax(stored, initial=0) > _MOST_LIGHT:
            _refuse(path, f"floats up to {np.nanmax(stored):g}, but 1 is white", "Divide by the value of white.")
        white = {"uint8": 255, "uint16": 65535}.get(stored.dtype.name, 1)
        stored = np.asarray(stored, np.float32) / np.float32(white)
    if stored.ndim == 2:
        stored = np.repeat(stored[:, :, None], 3, axis=2)
    color, alpha = stored[:, :, :3], stored[:, :, 3:]
    if path.suffix.lower() == ".exr":
        transfer = "linear" if transfer == "auto" else transfer
        if alpha.size:  # colors of EXR files are premultiplied
            color = color / np.maximum(alpha, 1e-6)
    return np.ascontiguousarray(np.concatenate([eight_bit(color, transfer), eight_bit(alpha, "srgb")], axis=2))


def _deep_values(path: Path) -> np.ndarray:
    """The numbers in an EXR, DPX, TIFF or PNG file, (H, W) or (H, W, 3 or 4; RGB or RGBA): of DPX files 0 to 1, of
    others of the type in the file."""
    suffix = path.suffix.lower()
    try:
        stored = cached_object(path)
        data = path.read_bytes() if stored is None else stored.read()
    except FileNotFoundError:
        raise StudioError("footage.image_missing", "image not found", file=path) from None
    except OSError as error:
        _refuse(path, str(error.strerror))
    if suffix == ".exr":
        return _exr_values(path, data)
    if suffix in _TIFF:
        return _tiff_values(path, data)
    return _channels(path, _decoded(path, data, "dpx")) if suffix == ".dpx" else _opencv_values(path, data)


def _tiff_values(path: Path, data: bytes) -> np.ndarray:
    with _undamaged(path):
        kind = _TiffKind.of(data)
    if kind.bits not in (1, 2, 4, 8, 16, 32, 64):
        _refuse(path, f"{kind.bits} bits per value are not supported", "Save it with 8 or 16 bits.")
    if not kind.has_deep_planes:
        values = _opencv_values(path, data)
        if not kind.zero_is_white or values.dtype == np.uint8:  # which OpenCV inverts
            return values
        return np.asarray((1 if kind.is_float else np.iinfo(values.dtype).max) - values)
    if kind.is_float or kind.bits != 16:  # OpenCV mixes up the planes, and FFmpeg reads only these
        _refuse(path, f"a plane per channel of {kind.bits} bits is not supported", "Save it with interleaved channels.")
    return np.asarray(_decoded(path, data, "tiff").to_ndarray())


def _exr_values(path: Path, data: bytes) -> np.ndarray:
    """FFmpeg takes the upper left corner of the display window as 0, and needs to be told the layer."""
    try:
        data, layer = exr_for_ffmpeg(data)
    except (ValueError, struct.error, LookupError):
        _refuse(path, "damaged or truncated: its header ends early")
    if layer is None:
        _refuse(
            path, "it has no layer with R, G and B, and more than one channel", "Save the layer of the image alone."
        )
    return _channels(path, _decoded(path, data, "exr", {"layer": layer} if layer else {}))


def _decoded(path: Path, data: bytes, name: str, options: Mapping[str, str] | None = None) -> VideoFrame:
    import av
    from av.codec import CodecContext
    from PIL.Image import MAX_IMAGE_PIXELS

    try:
        decoder: Any = CodecContext.create(name, "r")
        decoder.options = {"max_pixels": str(2 * (MAX_IMAGE_PIXELS or 0)), **(options or {})}
        decoder.thread_count = 1
        frames = [*decoder.decode(av.Packet(data)), *decoder.decode(None)]
    except (av.error.FFmpegError, OSError, ValueError):
        frames = []
    if not frames or frames[0].is_corrupt:
        _refuse(path, f"damaged or truncated, or a kind of {name.upper()} that FFmpeg cannot read")
    return frames[0]


def _channels(path: Path, frame: VideoFrame) -> np.ndarray:
    """(H, W) or (H, W, 3 or 4) float32, 0..1 for integers."""
    kind = frame.format.name
    if "f32" in kind or "f16" in kind:
        number = np.dtype(np.float32 if "f32" in kind else np.float16).newbyteorder("<" if kind.endswith("le") else ">")
        planes = [
            np.frombuffer(bytes(plane), number).reshape(plane.height, -1)[:, : plane.width].astype(np.float32)
            for plane in frame.planes
        ]
        if len(planes) == 1:
            return planes[0]
        green, blue, red, *alpha = planes
        return np.stack([red, green, blue, *alpha], -1)
    bits = frame.format.components[0].bits
    if frame.format.is_rgb and kind.startswith("abgr"):
        samples = frame.to_ndarray(format="rgba")
    elif frame.format.is_rgb or kind.startswith("gray"):
        samples = frame.to_ndarray()
    else:
        _refuse(path, f"its pixel format, {kind}, is not supported")
    return samples.astype(np.float32) / np.float32(2**bits - 1)


def _opencv_values(path: Path, data: bytes) -> np.ndarray:
    """(H, W) or (H, W, 3 or 4; RGB or RGBA), as stored."""
    import cv2

    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error as error:
        if is_out_of_memory(error):
            raise
        pixels = None
    if pixels is None or (pixels.ndim == 3 and pixels.shape[2] not in (3, 4)):
        _refuse(path, "not an image, damaged, or of a kind that OpenCV cannot read")
    if pixels.ndim == 3:
        pixels = pixels[:, :, [2, 1, 0, 3][: pixels.shape[2]]]
    return np.asarray(pixels)


def _refuse(path: Path, problem: str, fix: str = "Replace the file or exclude the frame.") -> NoReturn:
    raise StudioError("footage.image_unreadable", f"cannot read the image ({problem})", file=path, fix=fix) from None
