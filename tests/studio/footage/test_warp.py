"""K with skew, as old calibrations have it, in closed form."""

import numpy as np
import pytest

from v3studio.studio.cameras import Camera
from v3studio.studio.footage.warp import Warp

SKEW = 20.0


@pytest.mark.parametrize("bend", [(), (-0.1, 0.02, 0.001, 0.002)])
def test_skew_is_removed_from_images(bend: tuple[float, ...]) -> None:
    """Columns of a ramp are shifted by the skew times y, where the image is not cut off."""
    K = np.array([[80.0, SKEW, 48], [0, 90, 32], [0, 0, 1]])
    camera = Camera("a", 96, 64, K, np.eye(4), np.array(bend))
    warp = Warp(camera, 96, 64, 1.0)
    assert not warp.is_identity
    assert warp.camera.K[0, 1] == 0
    raw = np.repeat(np.arange(96, dtype=np.uint8)[None], 64, axis=0)
    image = warp.apply(np.repeat(raw[..., None], 3, axis=2), warp.maps(), smooth=False)
    rows, columns = np.mgrid[12:52, 24:72]
    points = warp.camera.unproject(np.column_stack([columns.ravel() + 0.5, rows.ravel() + 0.5]))
    pixels, _ = camera.project(points)
    np.testing.assert_allclose(image[rows, columns, 0].ravel(), pixels[:, 0] - 0.5, atol=0.6)
    # by hand: without distortion, x = fx X / Z + skew Y / Z + cx
    X, Y = points[:, 0], points[:, 1]
    bent = camera.distortion if bend else np.zeros(4)
    r = X * X + Y * Y
    radial = 1 + bent[0] * r + bent[1] * r * r
    x = X * radial + 2 * bent[2] * X * Y + bent[3] * (r + 2 * X * X)
    y = Y * radial + bent[2] * (r + 2 * Y * Y) + 2 * bent[3] * X * Y
    np.testing.assert_allclose(pixels[:, 0], 80 * x + SKEW * y + 48, atol=1e-6)
    np.testing.assert_allclose(camera.normalized(pixels), points[:, :2], atol=1e-6)
