"""Transfer functions against published points, and image files of more than 8 bits that are written by FFmpeg."""

import struct
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image

from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.images import image_header, read_image
from v3studio.studio.capture.transfer import linear_from_logc3, linear_from_slog3, srgb_from_linear
from v3studio.studio.footage import open_footage

LIGHT = np.linspace(0, 1, 24 * 32 * 3).reshape(24, 32, 3)
"""Linear light."""


def test_published_points() -> None:
    """Sony: 0%, 18% and 90% are at 95, 420 and 598 of 1023. ARRI: 0 and 18% are at 0.0928 and 0.391 for EI 800."""
    np.testing.assert_allclose(linear_from_slog3(np.array([95, 420, 598]) / 1023), [0, 0.18, 0.9], atol=2e-3)
    np.testing.assert_allclose(linear_from_logc3(np.array([0.092809, 0.391007])), [0, 0.18], atol=1e-5)
    # IEC 61966-2-1: sRGB 0.5 is 0.2140 of the light
    np.testing.assert_allclose(srgb_from_linear(np.array([0, 0.21404114, 1, 7, np.nan])), [0, 0.5, 1, 1, 0], atol=1e-6)
    for curve in (linear_from_slog3, linear_from_logc3):  # both pieces meet
        assert (np.diff(curve(np.linspace(0, 1, 5000))) > 0).all()


def encoded(path: Path, codec: str, frame: Any, **options: str) -> Path:
    encoder: Any = av.codec.CodecContext.create(codec, "w")
    encoder.width, encoder.height, encoder.pix_fmt = frame.width, frame.height, frame.format.name
    encoder.time_base, encoder.options = Fraction(1, 25), options
    frame.pts = 0
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"".join(bytes(packet) for packet in [*encoder.encode(frame), *encoder.encode(None)]))
    return path


def exr(path: Path, light: np.ndarray, **options: str) -> Path:
    """Gray, RGB, or RGBA, whose colors are premultiplied."""
    pixels, order = {1: ("grayf32le", [0]), 3: ("gbrpf32le", [1, 2, 0]), 4: ("gbrapf32le", [1, 2, 0, 3])}[
        light.shape[2]
    ]
    frame = av.VideoFrame(light.shape[1], light.shape[0], pixels)
    for plane, channel in zip(frame.planes, order, strict=True):
        rows = np.zeros((plane.height, plane.line_size // 4), np.float32)
        rows[:, : plane.width] = light[..., channel]
        plane.update(rows.tobytes())
    return encoded(path, "exr", frame, **options)


def srgb(light: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, written down once more."""
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    return 255 * np.clip(curve, 0, 1)


@pytest.mark.parametrize("kind", ["float", "half"])
def test_exr_is_linear(tmp_path: Path, kind: str) -> None:
    path = exr(tmp_path / "a.exr", LIGHT * 2, format=kind, compression="zip16")
    image = read_image(path)
    assert np.abs(image - srgb(LIGHT * 2)).max() < 0.75
    assert image_header(path)[:3] == (32, 24, False)
    assert np.abs(read_image(path, "srgb") - np.clip(510 * LIGHT, 0, 255)).max() < 0.75


def test_exr_with_alpha_is_unpremultiplied(tmp_path: Path) -> None:
    alpha = np.tile(np.linspace(0.25, 1, 32), (24, 1))[..., None]
    path = exr(tmp_path / "a.exr", np.concatenate([LIGHT * alpha, alpha], -1))
    image = read_image(path)
    assert image_header(path)[2]
    assert np.abs(image[..., :3] - srgb(LIGHT)).max() < 0.75
    assert np.abs(image[..., 3:] - 255 * alpha).max() < 0.75


@pytest.mark.parametrize(("pixels", "white"), [("gbrp10le", 1023), ("gbrp12be", 4095), ("rgb48be", 65535)])
def test_dpx(tmp_path: Path, pixels: str, white: int) -> None:
    frame = av.VideoFrame.from_ndarray(np.rint(LIGHT * white).astype(np.uint16), format=pixels)
    path = encoded(tmp_path / "a.dpx", "dpx", frame)
    assert np.abs(read_image(path) - 255 * LIGHT).max() < 0.76
    assert np.abs(read_image(path, "linear") - srgb(LIGHT)).max() < 255 * 12.92 * 0.5 / white + 0.51


@pytest.mark.parametrize(
    ("codec", "pixels"),
    [
        ("png", "rgb48be"), ("png", "rgba64be"), ("png", "gray16be"), ("png", "ya16be"),
        ("tiff", "rgb48le"), ("tiff", "rgba64le"), ("tiff", "gray16le"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("transfer", ["auto", "srgb"])
def test_sixteen_bits_are_rounded(tmp_path: Path, codec: str, pixels: str, transfer: Any) -> None:
    """The high byte alone would be one level too dark for half of the values."""
    colors, alpha = 1 if pixels.startswith(("gray", "ya")) else 3, pixels.startswith(("rgba", "ya"))
    values = np.random.default_rng(4).integers(0, 65536, (24, 32, colors + alpha)).astype(np.uint16)
    frame = av.VideoFrame(32, 24, pixels)
    rows = values.astype(">u2" if pixels.endswith("be") else "<u2").reshape(24, -1)
    (plane,) = frame.planes
    padded = np.zeros((24, plane.line_size // 2), rows.dtype)
    padded[:, : rows.shape[1]] = rows
    plane.update(padded.tobytes())
    path = encoded(tmp_path / f"a.{codec}", codec, frame)
    wanted = np.rint(values / 257.0)
    color = np.repeat(wanted[..., :colors], 3 // colors, axis=2)
    assert image_header(path)[2] == alpha
    np.testing.assert_array_equal(read_image(path, transfer), np.concatenate([color, wanted[..., colors:]], -1))


def test_a_capture_of_exr_files_with_plates(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    plate = 0.2 + 0.05 * rng.random((48, 64, 3))
    image = plate.copy()
    image[12:36, 20:40] = (0.9, 0.1, 0.1)
    for camera in ("a", "b"):
        exr(tmp_path / "images" / camera / "0001.exr", image)
        exr(tmp_path / "clean_plates" / f"{camera}.exr", plate)
    footage = open_footage(CaptureSettings(root=tmp_path))
    assert np.abs(footage.image("a", 1) - srgb(image)).max() < 0.75
    mask = footage.mask("b", 1)
    assert mask[14:34, 23:37].min() > 250
    assert mask[:8].max() < 10


def test_videos_have_a_transfer_function(tmp_path: Path, make: SimpleNamespace) -> None:
    gray = np.full((32, 64, 3), round(0.391 * 255), np.uint8)
    make.video(tmp_path / "a.mkv", [gray], codec="ffv1", pixels="bgr0", options={}, source="rgb24")
    pattern = "{camera}.mkv"
    plain = open_footage(CaptureSettings(root=tmp_path, images=pattern, masks="none"))
    log = open_footage(CaptureSettings(root=tmp_path, images=pattern, masks="none", transfer="logc3"))
    assert np.abs(plain.image("a", 0) - gray.astype(int)).max() <= 1
    assert abs(float(log.image("a", 0).mean()) - srgb(np.array(0.18))) < 2.5


@pytest.mark.parametrize("name", ["a.exr", "a.dpx"])
def test_damaged_files_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    for data in (b"", b"not an image", b"v/1\x01" + bytes(200), b"SDPX" + bytes(2048)):
        path.write_bytes(data)
        with refuses("footage.image_unreadable", file=path):
            read_image(path)
    with refuses("footage.image_missing", file=tmp_path / ("none" + path.suffix)):
        read_image(tmp_path / ("none" + path.suffix))


def test_gray_floats_beyond_the_range_are_clipped(tmp_path: Path) -> None:
    """Of floats, 1 is white; what is beyond is white or black, not wrapped around. Levels of 255 are refused."""
    values = np.array([[-3.0, 0.0, 0.4], [1.0, 1.01, 12.0]], np.float32)
    Image.fromarray(values).save(tmp_path / "gray.tif")
    image = read_image(tmp_path / "gray.tif")
    np.testing.assert_array_equal(image[:, :, 0], [[0, 0, 102], [255, 255, 255]])
    Image.fromarray(values * 21).save(tmp_path / "levels.tif")
    with refuses("footage.image_unreadable", file=tmp_path / "levels.tif"):
        read_image(tmp_path / "levels.tif")
    np.testing.assert_array_equal(image, image[:, :, :1].repeat(3, axis=2))


def tiff(path: Path, values: np.ndarray, extra: int | None) -> Path:
    """An uncompressed TIFF; `extra` is what it says about the fourth channel (ExtraSamples), if anything."""
    height, width, channels = values.shape
    data = values.astype("<u2").tobytes()
    entries = [
        (256, 4, 1, width), (257, 4, 1, height), (258, 3, channels, 8), (259, 3, 1, 1), (262, 3, 1, 2), (273, 4, 1, 16),
        (277, 3, 1, channels), (278, 4, 1, height), (279, 4, 1, len(data)),
        *([] if extra is None else [(338, 3, 1, extra)]),
    ]  # fmt: skip
    head = struct.pack("<2sHI4H", b"II", 42, 16 + len(data), *[16] * 4)
    directory = b"".join(struct.pack("<HHII", *entry) for entry in entries)
    path.write_bytes(head + data + struct.pack("<H", len(entries)) + directory + bytes(4))
    return path


@pytest.mark.parametrize("transfer", ["auto", "srgb", "logc3"])
def test_a_fourth_channel_without_meaning_is_not_alpha(tmp_path: Path, transfer: Any) -> None:
    """TIFF 6.0: ExtraSamples 0 is unspecified data, 2 is straight alpha."""
    values = np.random.default_rng(5).integers(0, 65536, (6, 8, 4)).astype(np.uint16)
    padded, alpha = tiff(tmp_path / "padded.tif", values, 0), tiff(tmp_path / "alpha.tif", values, 2)
    color = read_image(tiff(tmp_path / "color.tif", values[..., :3], None), transfer)
    assert (image_header(padded)[2], image_header(alpha)[2]) == (False, True)
    np.testing.assert_array_equal(read_image(padded, transfer), color)
    with_alpha = read_image(alpha, transfer)
    np.testing.assert_array_equal(with_alpha[..., :3], color)
    np.testing.assert_array_equal(with_alpha[..., 3], np.rint(values[..., 3] / 257.0))
    if transfer != "logc3":
        np.testing.assert_array_equal(color, np.rint(values[..., :3] / 257.0))
