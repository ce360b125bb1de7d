"""The CPU kernels against the reference on scenes drawn by hypothesis."""

from __future__ import annotations

import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st


@st.composite
def scenes(draw):  # type: ignore[no-untyped-def]
    """Arguments of the helpers `splats` and `camera`, and changes to the splats."""
    width, height = draw(st.integers(1, 80)), draw(st.integers(1, 70))
    return {
        "splats": {
            "count": draw(st.integers(0, 60)),
            "degree": draw(st.integers(0, 3)),
            "seed": draw(st.integers(0, 2**31)),
            "log_scale": draw(st.floats(-8.0, 3.0)),
            "spread": draw(st.floats(0.0, 4.0)),
            "opacity": draw(st.sampled_from([0.0, 1.0, 4.0, 30.0])),
        },
        "camera": {
            "width": width,
            "height": height,
            "focal": draw(st.floats(10.0, 300.0)),
            "principal": (draw(st.floats(-1.0, 2.0)) * width, draw(st.floats(-1.0, 2.0)) * height),
            "turn": draw(st.floats(-3.0, 3.0)),
            "distance": draw(st.floats(0.1, 10.0)),
        },
        "stretch": draw(st.floats(0.0, 6.0)),
        "alpha_max": draw(st.sampled_from([0.9, 0.99, 0.999])),
    }


def build(helpers, scene):  # type: ignore[no-untyped-def]
    splats, camera = helpers.splats(**scene["splats"]), helpers.camera(**scene["camera"])
    splats.log_scales[:, 0] += scene["stretch"]
    return splats.map(lambda tensor: tensor.float().double()), camera


COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.function_scoped_fixture], "derandomize": True}


@settings(max_examples=40, **COMMON)  # type: ignore[arg-type]
@given(scene=scenes())
def test_double_precision(helpers, scene) -> None:  # type: ignore[no-untyped-def]
    splats, camera = build(helpers, scene)
    truth = helpers.draw(splats, camera, "reference", alpha_max=scene["alpha_max"])
    ours = helpers.draw(splats, camera, "cpu", alpha_max=scene["alpha_max"])
    helpers.assert_same(ours, truth, image=1e-8, gradient=1e-6)
    torch.testing.assert_close(ours.radii, truth.radii)


@settings(max_examples=40, **COMMON)  # type: ignore[arg-type]
@given(scene=scenes())
def test_single_precision(helpers, scene) -> None:  # type: ignore[no-untyped-def]
    splats, camera = build(helpers, scene)
    sturdy = helpers.sturdy(splats, camera, scene["alpha_max"])
    options = {"weight": sturdy.double(), "alpha_max": scene["alpha_max"]}
    truth = helpers.draw(splats, camera, "reference", **options)
    ours = helpers.draw(splats, camera, "cpu", torch.float32, **options)
    # The gradient divides by 1 - alpha, which magnifies rounding.
    helpers.assert_same(ours, truth, where=sturdy, gradient=max(1e-3, 1e-5 / (1 - scene["alpha_max"])))


@settings(max_examples=20, **COMMON)  # type: ignore[arg-type]
@given(scene=scenes())
def test_alpha_and_depth_are_within_bounds(helpers, scene) -> None:  # type: ignore[no-untyped-def]
    """Blending is a weighted mean: alpha is between 0 and 1, and depth between those of the visible splats."""
    splats, camera = build(helpers, scene)
    ours = helpers.draw(splats, camera, "cpu", torch.float32)
    assert ours.alpha.min() >= 0
    assert ours.alpha.max() <= 1
    drawn = ours.radii > 0
    if drawn.any():
        depths = splats.means[drawn] @ torch.tensor(camera.rotation[2]) + camera.translation[2]
        covered = ours.alpha > 0
        assert (ours.depth[covered] >= depths.min() * (1 - 1e-4)).all()
        assert (ours.depth[covered] <= depths.max() * (1 + 1e-4)).all()
