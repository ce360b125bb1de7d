"""TIFF files packed byte by byte and EXR files of OpenEXR's own library: how they store an image does not change it."""

import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from tests.support.errors import refuses
from v3studio.studio.capture.images import read_image, read_values
from v3studio.studio.capture.transfer import srgb_from_linear

TRUTH = np.zeros((12, 16, 3))
TRUTH[..., 0], TRUTH[..., 1], TRUTH[..., 2] = np.linspace(0, 1, 16), 0.25, np.linspace(0, 1, 12)[:, None]


def tiff(path: Path, values: np.ndarray, photometric: int, planar: bool = False) -> Path:
    """A TIFF 6.0 file without compression of (H, W) or (H, W, 3) values; a strip, or one per channel if `planar`."""
    height, width, *rest = values.shape
    channels, size = rest[0] if rest else 1, values.dtype.itemsize
    strips = [values[..., index] for index in range(channels)] if planar else [values]
    body = b"".join(strip.tobytes() for strip in strips)
    many = channels > 1
    after = 8 + len(body)
    lists = [struct.pack(f"<{channels}H", *[8 * size] * channels)]
    lists.append(struct.pack(f"<{len(strips)}I", *(8 + index * strips[0].nbytes for index in range(len(strips)))))
    lists.append(struct.pack(f"<{len(strips)}I", *(strip.nbytes for strip in strips)))
    places = [after, after + len(lists[0]), after + len(lists[0]) + len(lists[1])]
    first = [struct.unpack("<H", lists[0][:2])[0], 8, strips[0].nbytes]
    bits, offsets, counts = (
        place if len(data) > 4 else value for place, data, value in zip(places, lists, first, strict=True)
    )
    kinds = {"u": 1, "i": 2, "f": 3}[values.dtype.kind]
    tags = [
        (256, 4, 1, width), (257, 4, 1, height), (258, 3, channels, bits), (259, 3, 1, 1), (262, 3, 1, photometric),
        (273, 4, len(strips), offsets), (277, 3, 1, channels), (278, 4, 1, height), (279, 4, len(strips), counts),
        (284, 3, 1, 2 if planar else 1), *([] if many else [(339, 3, 1, kinds)]),
    ]  # fmt: skip
    body += b"".join(lists)
    body += b"\0" * (len(body) % 2)
    directory = (
        struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + struct.pack("<I", 0)
    )
    path.write_bytes(struct.pack("<2sHI", b"II", 42, 8 + len(body)) + body + directory)
    return path


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("planar", [False, True])
def test_tiff_with_a_plane_per_channel(tmp_path: Path, kind: type, planar: bool) -> None:
    full = np.iinfo(kind).max
    values = np.rint(full * TRUTH).astype(kind)
    path = tiff(tmp_path / "a.tif", values, 2, planar)
    assert np.abs(read_image(path).astype(int) - 255 * TRUTH).max() <= 1
    np.testing.assert_array_equal(read_values(path)[0], values)


@pytest.mark.parametrize(
    ("kind", "white"), [(np.uint8, 255), (np.uint16, 65535), (np.float32, 1)], ids=["uint8", "uint16", "float32"]
)
@pytest.mark.parametrize("zero_is_white", [False, True])
def test_gray_tiff(tmp_path: Path, kind: type, white: int, zero_is_white: bool) -> None:
    gray = TRUTH[..., 0]
    stored = white * (1 - gray if zero_is_white else gray)
    path = tiff(tmp_path / "a.tif", (stored if white == 1 else np.rint(stored)).astype(kind), 0 if zero_is_white else 1)
    assert np.abs(read_image(path).astype(int) - 255 * gray[..., None]).max() <= 1


def test_integers_whose_white_is_not_known_are_refused_as_images_only(tmp_path: Path) -> None:
    labels = np.arange(12 * 16, dtype=np.int32).reshape(12, 16)
    path = tiff(tmp_path / "a.tif", labels, 1)
    np.testing.assert_array_equal(read_values(path)[0], labels)
    with refuses("footage.image_unreadable", file=path):
        read_image(path)


def exr(path: Path, channels: dict[str, np.ndarray], data: tuple[int, int], display: tuple[int, int, int, int]) -> Path:
    height, width = next(iter(channels.values())).shape
    windows = [(data, (data[0] + width - 1, data[1] + height - 1)), (display[:2], display[2:])]
    names = ("dataWindow", "displayWindow")
    header = {name: tuple(np.array(corner, np.int32) for corner in w) for name, w in zip(names, windows, strict=True)}
    header |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {name: np.ascontiguousarray(v, np.float32) for name, v in channels.items()}).write(str(path))
    return path


@pytest.mark.parametrize("data", [(0, 0), (100, 50), (104, 53)], ids=["at 0", "shifted", "cropped"])
@pytest.mark.parametrize("layer", ["", "beauty."])
def test_windows_and_layers_of_exr(tmp_path: Path, data: tuple[int, int], layer: str) -> None:
    left, top = (data[0] - 100, data[1] - 50) if data[0] else (0, 0)
    origin = (data[0] - left, data[1] - top)
    channels = {f"{layer}{name}": TRUTH[top:, left:, index] for index, name in enumerate("RGB")}
    path = exr(tmp_path / "a.exr", channels, data, (*origin, origin[0] + 15, origin[1] + 11))
    wanted = np.rint(255 * srgb_from_linear(TRUTH))
    wanted[:top], wanted[:, :left] = 0, 0
    image = read_image(path)
    assert image.shape == TRUTH.shape
    assert np.abs(image - wanted).max() <= 1


@pytest.mark.parametrize("name", ["A", "R", "Y", "matte.A"])
def test_exr_with_one_channel(tmp_path: Path, name: str) -> None:
    path = exr(tmp_path / "a.exr", {name: TRUTH[..., 0]}, (0, 0), (0, 0, 15, 11))
    np.testing.assert_allclose(read_values(path)[0], TRUTH[..., 0], atol=1e-6)
