"""Small synthetic footage, and the CPU's instruction sets."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
from PIL import Image

from v3studio.studio.cameras import Camera
from v3studio.studio.rasterizer.cpu import load_kernels

SAMPLE = Path(__file__).parents[2] / "sample_captures" / "dance16"


def write_video(
    path, frames, *, codec="libx264", pixels="yuv420p", options=None, container_options=None, fps=25, rotation=0,
    shape=None, source="rgb24", tag=None,
) -> Path:  # fmt: skip
    """Encode (H, W, 3) RGB (or `source`) uint8 frames, whose pixels are `shape` times as wide as high; `tag`: number of
    their color matrix, as in FFmpeg."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", options=container_options or {}) as container:
        stream = container.add_stream(codec, rate=fps)
        stream.width, stream.height, stream.pix_fmt = frames[0].shape[1], frames[0].shape[0], pixels
        stream.options = options if options is not None else {"crf": "10", "preset": "veryfast"}
        if rotation:
            stream.set_display_rotation(rotation)
        if tag is not None:
            stream.codec_context.colorspace = tag
        if shape is not None:
            stream.codec_context.sample_aspect_ratio = shape
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format=source)))
        container.mux(stream.encode())
    return path


def write_image(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)
    return path


def numbered(index: int, width: int = 96, height: int = 64) -> np.ndarray:
    """An image that encodes a number: eight bars, white where the bit is set."""
    image = np.full((height, width, 3), 16, np.uint8)
    bar = width // 8
    for bit in range(8):
        if index >> bit & 1:
            image[:, bit * bar : (bit + 1) * bar] = 235
    return image


def number_of(image: np.ndarray) -> int:
    """Inverse of `numbered`, robust to lossy coding."""
    bar = image.shape[1] // 8
    means = [image[8:-8, bit * bar + 3 : (bit + 1) * bar - 3].mean() for bit in range(8)]
    return sum(1 << bit for bit, mean in enumerate(means) if mean > 128)


def camera(name: str, width: int = 96, height: int = 64, **values: object) -> Camera:
    K = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    return Camera(name, width, height, K, np.eye(4), **values)  # type: ignore[arg-type]


@pytest.fixture(scope="session")
def make() -> SimpleNamespace:
    """The functions above, for test modules, which cannot import this one."""
    return SimpleNamespace(
        video=write_video, image=write_image, numbered=numbered, number_of=number_of, camera=camera, sample=SAMPLE
    )


@pytest.fixture(params=load_kernels().instruction_sets())
def instruction_set(request: pytest.FixtureRequest) -> Iterator[str]:
    """Each instruction set that this machine supports, in use during the test."""
    kernels = load_kernels()
    used = kernels.instruction_set()
    kernels.use_instruction_set(request.param)
    yield request.param
    kernels.use_instruction_set(used)


@pytest.fixture
def three_videos(tmp_path: Path) -> Path:
    """videos/cam1.mp4, cam2.mp4 and cam10.mp4 with 12 numbered frames each."""
    for name in ("cam1", "cam2", "cam10"):
        write_video(tmp_path / "videos" / f"{name}.mp4", [numbered(index) for index in range(12)])
    return tmp_path


@pytest.fixture
def image_folders(tmp_path: Path) -> Path:
    """images/left and images/right with frames 5 to 8 as PNG, and masks in masks/."""
    for name in ("left", "right"):
        for index in range(5, 9):
            write_image(tmp_path / "images" / name / f"{index:06d}.png", numbered(index))
            mask = np.zeros((64, 96), np.uint8)
            mask[16:48, 24:72] = 255
            write_image(tmp_path / "masks" / name / f"{index:06d}.png", mask)
    return tmp_path
