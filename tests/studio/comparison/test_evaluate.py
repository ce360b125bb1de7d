"""`evaluate`: PSNR in the box, compared with NumPy."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support.splats import round_splats
from tests.support.tiny_capture import write_capture
from v3studio.studio.camera_files import read_rig
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.comparison import evaluate
from v3studio.studio.footage import open_footage
from v3studio.studio.masks import FunctionMaskSource

FAR_AWAY = round_splats(torch.full((1, 3), 1e4))
"""A splat that no camera sees."""
FIRST_FIVE = FunctionMaskSource(
    lambda image, camera, frame: np.ones(image.shape[:2]), cameras=tuple(f"cam{number}" for number in range(5))
)


@pytest.mark.parametrize("padding", [3, None])
def test_nothing_rendered_is_as_far_as_the_footage_is_from_black(padding: int | None, tmp_path: Path) -> None:
    write_capture(tmp_path, frames=2)
    settings = CaptureSettings(root=tmp_path, images="images/{camera}/{frame:03d}.png", held_out=("cam4",))
    footage = open_footage(settings, read_rig(str(tmp_path / "cameras.json")))
    found = evaluate(FAR_AWAY, footage, 1, padding=padding)
    assert set(found) == {"cam4"}, "the held-out camera"
    mask = footage.mask("cam4", 1)
    image = footage.image("cam4", 1) / 255 * (mask[..., None] / 255)
    if padding is not None:
        rows, columns = np.nonzero(mask > 127)
        top, left = max(0, rows.min() - padding), max(0, columns.min() - padding)
        image = image[top : rows.max() + 1 + padding, left : columns.max() + 1 + padding]
    assert found["cam4"]["psnr"] == pytest.approx(-10 * np.log10(np.mean(image**2)), abs=1e-3)
    both = evaluate(FAR_AWAY, footage, 1, cameras=("cam0", "cam4"), padding=padding)
    assert both["cam4"] == found["cam4"]
    assert both["cam0"] != found["cam4"]


@pytest.mark.parametrize(
    ("held_out", "measured"), [(("cam4", "cam5"), {"cam4"}), (("cam5",), {"cam0", "cam1", "cam2", "cam3", "cam4"})]
)
def test_cameras_without_masks_are_not_measured(held_out: tuple[str, ...], measured: set[str], tmp_path: Path) -> None:
    write_capture(tmp_path, frames=1)
    images = "images/{camera}/{frame:03d}.png"
    settings = CaptureSettings(root=tmp_path, images=images, masks=FIRST_FIVE, held_out=held_out)
    footage = open_footage(settings, read_rig(str(tmp_path / "cameras.json")))
    assert set(evaluate(FAR_AWAY, footage, 0)) == measured
