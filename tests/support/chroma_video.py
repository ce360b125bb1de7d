"""Lossless videos with subsampled chroma."""

from pathlib import Path

import av
import numpy as np

SITINGS = {"left": "0", "center": "1", "topleft": "2"}
"""Values of H.264's chroma_sample_loc_type."""


def write_yuv(
    path: Path, image: np.ndarray, pixel_format: str, siting: str | None = None, codec: str = "libx264"
) -> None:
    """One frame of an (H, W, 3) uint8 image; FFmpeg averages chroma in the middle, whatever the tag `siting` says."""
    options = {"qp": "0"} if codec == "libx264" else {}
    if siting is not None:
        options["x264-params"] = f"chromaloc={SITINGS[siting]}"
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options)
        stream.height, stream.width = image.shape[:2]
        stream.pix_fmt = pixel_format
        for packet in (*stream.encode(av.VideoFrame.from_ndarray(image, "rgb24")), *stream.encode()):
            container.mux(packet)
