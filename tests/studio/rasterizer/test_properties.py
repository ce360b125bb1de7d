"""The CPU kernels against the reference on scenes drawn by hypothesis."""

from typing import Any

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.studio.rasterizer.conftest import assert_same, draw, make_camera, make_splats, sturdy_pixels


@st.composite
def scenes(pick):
    """Arguments of `make_splats` and `make_camera`, and changes to the splats."""
    width, height = pick(st.integers(1, 80)), pick(st.integers(1, 70))
    return {
        "splats": {
            "count": pick(st.integers(0, 60)),
            "degree": pick(st.integers(0, 3)),
            "seed": pick(st.integers(0, 2**31)),
            "log_scale": pick(st.floats(-8.0, 3.0)),
            "spread": pick(st.floats(0.0, 4.0)),
            "opacity": pick(st.sampled_from([0.0, 1.0, 4.0, 30.0])),
        },
        "camera": {
            "width": width,
            "height": height,
            "focal": pick(st.floats(10.0, 300.0)),
            "principal": (pick(st.floats(-1.0, 2.0)) * width, pick(st.floats(-1.0, 2.0)) * height),
            "turn": pick(st.floats(-3.0, 3.0)),
            "distance": pick(st.floats(0.1, 10.0)),
        },
        "stretch": pick(st.floats(0.0, 6.0)),
    }


@settings(max_examples=25, deadline=None, derandomize=True)
@given(scene=scenes())
def test_kernels_equal_the_reference(scene: dict[str, Any]) -> None:
    """They agree in double precision up to rounding, and in single precision within the bounds that all backends must
    meet."""
    splats, camera = make_splats(**scene["splats"]), make_camera(**scene["camera"])
    splats.log_scales[:, 0] += scene["stretch"]
    splats = splats.map(lambda tensor: tensor.float().double())
    truth = draw(splats, camera, "reference")
    exact = draw(splats, camera, "cpu")
    assert_same(exact, truth, image=1e-8, gradient=1e-6)
    torch.testing.assert_close(exact.radii, truth.radii)

    sturdy = sturdy_pixels(splats, camera)
    truth = draw(splats, camera, "reference", weight=sturdy.double())
    single = draw(splats, camera, "cpu", torch.float32, weight=sturdy.double())
    assert_same(single, truth, where=sturdy)

    # Blending is a weighted mean: alpha is between 0 and 1, and depth between those of the visible splats.
    assert single.alpha.min() >= 0
    assert single.alpha.max() <= 1
    visible = single.radii > 0
    if visible.any():
        depths = splats.means[visible] @ torch.tensor(camera.rotation[2]) + camera.translation[2]
        covered = single.alpha > 0
        assert (single.depth[covered] >= depths.min() * (1 - 1e-4)).all()
        assert (single.depth[covered] <= depths.max() * (1 + 1e-4)).all()
