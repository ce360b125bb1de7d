"""The CPU kernels against the reference on scenes drawn by hypothesis."""

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


@settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(scene=scenes())
def test_kernels_equal_the_reference(helpers, scene) -> None:  # type: ignore[no-untyped-def]
    """In double precision up to rounding, and in single precision within the bounds that all backends must meet."""
    splats, camera = build(helpers, scene)
    alpha_max = scene["alpha_max"]
    truth = helpers.draw(splats, camera, "reference", alpha_max=alpha_max)
    exact = helpers.draw(splats, camera, "cpu", alpha_max=alpha_max)
    helpers.assert_same(exact, truth, image=1e-8, gradient=1e-6)
    torch.testing.assert_close(exact.radii, truth.radii)

    sturdy = helpers.sturdy(splats, camera, alpha_max)
    options = {"weight": sturdy.double(), "alpha_max": alpha_max}
    truth = helpers.draw(splats, camera, "reference", **options)
    single = helpers.draw(splats, camera, "cpu", torch.float32, **options)
    # The gradient divides by 1 - alpha, which magnifies rounding.
    helpers.assert_same(single, truth, where=sturdy, gradient=max(1e-3, 1e-5 / (1 - alpha_max)))

    # Blending is a weighted mean: alpha is between 0 and 1, and depth between those of the visible splats.
    assert single.alpha.min() >= 0
    assert single.alpha.max() <= 1
    visible = single.radii > 0
    if visible.any():
        depths = splats.means[visible] @ torch.tensor(camera.rotation[2]) + camera.translation[2]
        covered = single.alpha > 0
        assert (single.depth[covered] >= depths.min() * (1 - 1e-4)).all()
        assert (single.depth[covered] <= depths.max() * (1 + 1e-4)).all()
