"""The CPU kernels against the reference, on ordinary scenes and on corner cases."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import torch

from tests.studio.rasterizer.conftest import (
    assert_same,
    assert_same_by_any_threads,
    draw,
    make_camera,
    make_splats,
    sturdy_pixels,
)
from tests.support.errors import refuses
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.rasterizer.cpu import load_kernels


def compare(splats, camera, **options) -> None:
    """float64 up to rounding, float32 within the bounds that all backends must meet."""
    truth = draw(splats, camera, "reference", **options)
    exact = draw(splats, camera, "cpu", **options)
    assert_same(exact, truth, image=1e-9, gradient=1e-8)
    torch.testing.assert_close(exact.radii, truth.radii)
    sturdy = sturdy_pixels(splats, camera)
    assert sturdy.double().mean() > 0.7
    truth = draw(splats, camera, "reference", weight=sturdy.double(), **options)
    single = draw(splats, camera, "cpu", torch.float32, weight=sturdy.double(), **options)
    assert_same(single, truth, where=sturdy)


WIDE = {"count": 400, "spread": 3.0, "log_scale": -2.0}
SCENES = {
    "one": ({"count": 1, "degree": 0}, {}, {}),
    "none": ({"count": 0}, {}, {}),
    "degree 3": ({"count": 50}, {}, {}),
    "degree 2": ({"count": 300, "degree": 2, "log_scale": -1}, {}, {}),
    "many": ({"count": 1000, "log_scale": -3.5}, {}, {}),
    "large": ({"count": 37, "log_scale": 1}, {}, {}),
    "huge": ({"count": 20, "log_scale": 4.0}, {}, {}),
    "tiny": ({"count": 200, "log_scale": -14.0}, {}, {}),
    "around the camera": ({"count": 200, "spread": 4.0, "log_scale": -1.0}, {}, {}),
    "little dilation": ({"count": 300, "log_scale": -4, "dilation": 0.001}, {}, {}),
    "much dilation": ({"count": 300, "log_scale": -4, "dilation": 1.0}, {}, {}),
    "image alone": ({"count": 80}, {}, {"outputs": ("image",)}),
    "alpha alone": ({"count": 80}, {}, {"outputs": ("alpha",)}),
    "depth alone": ({"count": 80}, {}, {"outputs": ("depth",)}),
    "an image as background": ({"count": 120}, {}, {"outputs": ("image", "alpha"), "picture": True}),
    "one pixel": ({"count": 40, "log_scale": -2}, {"width": 1, "height": 1, "focal": 40.0}, {}),
    "one tile": ({"count": 40, "log_scale": -2}, {"width": 32, "height": 32, "focal": 40.0}, {}),
    "cut tiles": ({"count": 40, "log_scale": -2}, {"width": 33, "height": 65, "focal": 40.0}, {}),
    "principal point outside": (WIDE, {"principal": (-70.0, -30.0), "distance": 6.0}, {}),
    "principal point far below": (WIDE, {"principal": (36.3, 400.0), "distance": 6.0}, {}),
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_scenes(scene: tuple[dict[str, Any], dict[str, Any], dict[str, Any]]) -> None:
    splats, camera, options = scene
    compare(make_splats(**splats), make_camera(**camera), **options)


@pytest.mark.parametrize(
    ("attribute", "part", "value"),
    [
        ("log_scales", slice(None), (0.0, -9.0, -9.0)),  # needles
        ("log_scales", slice(None), (-0.5, -12.0, -1.0)),  # sheets
        ("logit_opacities", slice(0, None, 3), 60.0),
        ("logit_opacities", slice(1, None, 3), -60.0),
    ],
)
def test_extreme_shapes_and_opacities(attribute: str, part: slice, value: float | tuple[float, float, float]) -> None:
    splats = make_splats(60)
    getattr(splats, attribute)[part] = torch.tensor(value, dtype=torch.float64)
    compare(splats, make_camera())


def test_a_crop_equals_that_part_of_the_full_image() -> None:
    camera, splats = make_camera(300, 200, focal=240.0), make_splats(500).to(torch.float32)
    whole = rasterize(splats, camera, backend="cpu")
    part = rasterize(splats, camera.cropped(101, 53, 90, 70), backend="cpu")
    torch.testing.assert_close(part.image, whole.image[53:123, 101:191], atol=1e-4, rtol=0)


def test_ten_thousand_splats_on_one_pixel() -> None:
    camera = make_camera(20, 20, focal=50.0, turn=0.0)
    splats = make_splats(10_000, degree=0, log_scale=-6.0, spread=1e-3)
    splats.means[:, 2] = torch.linspace(0, 1, 10_000, dtype=torch.float64)
    splats.logit_opacities[:] = torch.linspace(-5.4, -4.6, 10_000, dtype=torch.float64)
    splats = splats.map(lambda tensor: tensor.float().double())
    truth, exact = draw(splats, camera, "reference"), draw(splats, camera, "cpu")
    assert_same(exact, truth, image=1e-9, gradient=1e-7)
    assert truth.alpha.max() > 0.999


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_same_bits_for_any_number_of_threads(dtype: torch.dtype) -> None:
    splats, camera = make_splats(1500), make_camera(200, 150, focal=150.0)

    def values():
        drawn = draw(splats, camera, "cpu", dtype)
        del drawn.gradients["background"]  # summed by torch
        return drawn.image, drawn.alpha, drawn.depth, drawn.radii, *drawn.gradients.values()

    assert_same_by_any_threads(values)


@pytest.mark.usefixtures("instruction_set")
def test_every_instruction_set() -> None:
    compare(make_splats(300), make_camera())


ATTRIBUTES = ("means", "quats", "log_scales", "logit_opacities", "sh")


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("attribute", ATTRIBUTES)
@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_a_value_that_is_not_finite(attribute: str, value: float, backend: str) -> None:
    """Checked: an error that names it. Unchecked: the splat is not drawn and affects nothing else."""
    camera, splats = make_camera(), make_splats(40)
    broken = splats.clone()
    getattr(broken, attribute).view(40, -1)[7, 0] = value
    with refuses("gaussians.not_finite", attribute=attribute, splat=7, count=1):
        rasterize(broken, camera, backend=backend, checked=True)
    if attribute == "logit_opacities" and value == math.inf:
        return  # opacity 1 is valid
    rest = splats[torch.arange(40) != 7]
    drawn, truth = draw(broken, camera, backend), draw(rest, camera, backend)
    torch.testing.assert_close(drawn.image, truth.image)
    assert drawn.radii[7] == 0
    for name in ("means", "quats", "log_scales", "sh"):
        assert torch.isfinite(drawn.gradients[name]).all()
        assert drawn.gradients[name][7].abs().max() == 0


def test_a_quaternion_of_length_zero() -> None:
    camera, splats = make_camera(), make_splats(10)
    splats.quats[3] = 0
    with refuses("gaussians.zero_quaternion", splat=3):
        rasterize(splats, camera, backend="cpu", checked=True)
    for backend in ("cpu", "reference"):
        drawn = draw(splats, camera, backend)
        assert drawn.radii[3] == 0
        assert torch.isfinite(drawn.gradients["quats"]).all()


def test_extreme_values_neither_crash_nor_hang() -> None:
    camera = make_camera()
    splats = make_splats(64).to(torch.float32)
    splats.means[0] = 3e38
    splats.means[1, :2] = 1e20
    splats.log_scales[2] = 80.0
    splats.log_scales[3] = 300.0
    splats.quats[4] *= 1e30
    splats.quats[5] *= 1e-30
    splats.sh[6] = 1e30
    splats.means[7] = torch.tensor(camera.center).float()
    splats.logit_opacities[8] = 1e30
    leaves = splats.map(lambda tensor: tensor.clone().requires_grad_())
    render = rasterize(leaves, camera, backend="cpu")
    render.image.sum().backward()
    assert render.image.shape == (49, 75, 3)


def test_no_gradient_where_none_is_required() -> None:
    camera, splats = make_camera(), make_splats(30)
    assert not rasterize(splats, camera, backend="cpu").image.requires_grad
    splats.sh.requires_grad_()
    with torch.no_grad():
        assert not rasterize(splats, camera, backend="cpu").image.requires_grad
    render = rasterize(splats, camera, backend="cpu")
    assert not render.radii.requires_grad
    render.image.sum().backward()
    assert splats.sh.grad is not None
    assert splats.means.grad is None


@pytest.mark.parametrize(
    ("dtype", "degree", "outputs", "trained"),
    [
        (torch.float32, 1, ("image",), ("means",)),
        (torch.float64, 0, ("image", "depth"), ("quats", "log_scales")),
        (torch.float32, 1, ("image", "depth"), ("means", "logit_opacities")),
        (torch.float64, 0, ("image",), ("sh",)),
    ],
)
def test_gradients_of_some_attributes_alone(
    instruction_set: str, dtype: torch.dtype, degree: int, outputs: tuple[str, ...], trained: tuple[str, ...]
) -> None:
    """The kernels leave out what only the other gradients need. All of them are checked against the reference above."""

    def gradients(wanted: tuple[str, ...]) -> dict[str, torch.Tensor]:
        splats = make_splats(300, degree=degree).to(dtype)
        leaves = [getattr(splats, name).clone().requires_grad_(name in wanted) for name in ATTRIBUTES]
        render = rasterize(Gaussians(*leaves), make_camera(), torch.full((3,), 0.4, dtype=dtype), backend="cpu")
        torch.stack([(getattr(render, name) ** 2).sum() for name in outputs]).sum().backward()
        return {name: leaf.grad for name, leaf in zip(ATTRIBUTES, leaves, strict=True) if leaf.grad is not None}

    whole, part = gradients(ATTRIBUTES), gradients(trained)
    assert set(part) == set(trained)
    for name, gradient in part.items():
        assert gradient.abs().max() > 0
        # equal bits with g++; other compilers may fuse other products with sums
        error = (gradient - whole[name]).norm() / whole[name].norm()
        assert error < 30 * torch.finfo(dtype).eps, f"{name} is off by {float(error):.1e}"


def test_several_python_threads_at_once() -> None:
    camera, splats = make_camera(200, 150, focal=150.0), make_splats(2000).to(torch.float32)
    truth = rasterize(splats, camera, backend="cpu").image
    with ThreadPoolExecutor(4) as pool:
        images = pool.map(lambda _: rasterize(splats, camera, backend="cpu").image, range(32))
    assert all(torch.equal(image, truth) for image in images)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_rendering_in_a_forked_child() -> None:
    camera, splats = make_camera(), make_splats(300).to(torch.float32)
    truth = rasterize(splats, camera, backend="cpu").image
    child = os.fork()
    if child == 0:
        os._exit(0 if torch.equal(rasterize(splats, camera, backend="cpu").image, truth) else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_kernels_check_the_sizes_of_arrays() -> None:
    kernels = load_kernels()
    image = torch.zeros(4, 4, 3)
    with pytest.raises(ValueError, match="target has 45 values, expected 48"):
        kernels.loss(image, torch.zeros(3, 5, 3), 4, 4, 0.2, None, 1)
    with pytest.raises(TypeError):
        kernels.loss(image.double(), image.double(), 4, 4, 0.2, None, 1)
    with pytest.raises(ValueError, match="mmx"):
        kernels.use_instruction_set("mmx")


def test_kernels_of_other_sources_are_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.rasterizer.cpu.KERNEL_INTERFACE", 0)
    with refuses("rasterizer.kernels_missing"):
        load_kernels()
