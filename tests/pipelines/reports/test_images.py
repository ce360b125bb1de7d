"""Images of reports, read back by another library."""

import io

import numpy as np
import pytest
from PIL import Image

from pipelines.reports.images import encode, to_bytes


@pytest.mark.parametrize(("ending", "tolerance"), [(".png", 0), (".jpg", 12)])
def test_colors_are_those_of_the_image(ending: str, tolerance: int) -> None:
    image = np.zeros((32, 48, 3), np.uint8)
    image[:, :16], image[:, 16:32], image[:, 32:] = (220, 40, 30), (30, 200, 60), (20, 50, 240)
    with Image.open(io.BytesIO(encode(image, ending))) as found:
        assert found.format == {".png": "PNG", ".jpg": "JPEG"}[ending]
        read = np.asarray(found.convert("RGB")).astype(int)
    for column in (8, 24, 40):
        assert np.abs(read[16, column] - image[16, column]).max() <= tolerance


def test_floats_are_clamped_and_rounded() -> None:
    values = np.array([-1.0, 0.0, 0.4 / 255, 0.6 / 255, 0.5, 1.0, 7.0])
    assert to_bytes(values[:, None, None])[:, 0, 0].tolist() == [0, 0, 0, 1, 128, 255, 255]
