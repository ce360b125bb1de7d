"""The chroma grid that is read from a video's own stream."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.chroma_video import write_yuv
from v3studio.studio.capture.video import VideoReader

GRAY = np.full((64, 96, 3), 128, np.uint8)


@pytest.mark.parametrize(
    ("pixel_format", "siting", "codec", "step", "first"),
    [
        ("yuv420p", None, "libx264", (2, 2), (0.0, 0.5)),  # untagged H.264 means left
        ("yuv420p", "left", "libx264", (2, 2), (0.0, 0.5)),
        ("yuv420p", "center", "libx264", (2, 2), (0.5, 0.5)),
        ("yuv420p", "topleft", "libx264", (2, 2), (0.0, 0.0)),
        ("yuv422p", None, "libx264", (2, 1), (0.0, 0.0)),
        ("yuv420p10le", None, "libx264", (2, 2), (0.0, 0.5)),
        ("yuvj420p", None, "mjpeg", (2, 2), (0.5, 0.5)),  # JPEG means center
        ("yuv444p", None, "libx264", None, None),
        ("bgr0", None, "ffv1", None, None),
    ],
)
def test_subsampling_and_siting(
    pixel_format: str,
    siting: str | None,
    codec: str,
    step: tuple[int, int] | None,
    first: tuple[float, float] | None,
    tmp_path: Path,
) -> None:
    write_yuv(tmp_path / "a.mkv", GRAY, pixel_format, siting, codec)
    reader = VideoReader(tmp_path / "a.mkv")
    grid = reader.chroma
    assert (None if grid is None else (grid.step, grid.first)) == (None if step is None else (step, first))
    assert np.abs(reader.read(0).astype(int) - 128).max() <= 2, "the test picture is not what read() returns"
