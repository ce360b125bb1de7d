"""The Triton backend against the reference, on the CPU. `test_triton.py` runs this file with TRITON_INTERPRET=1."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from tests.studio.rasterizer.conftest import assert_same, draw, make_camera, make_splats, sturdy_pixels
from tests.support.errors import refuses
from v3studio.studio.cameras import Camera
from v3studio.studio.rasterizer import available_backends, preferred_device, rasterize, rasterize_views
from v3studio.studio.rasterizer.triton_backend import Views, bin_splats, project_all


@pytest.fixture
def small() -> Camera:
    """A camera whose picture has two by two tiles, the outer ones cut by its edges."""
    return make_camera(24, 20, focal=20.0)


def compare(splats, camera, **options) -> None:
    sturdy = sturdy_pixels(splats, camera)
    assert sturdy.double().mean() > 0.7
    weight = sturdy.double()
    truth = draw(splats, camera, "reference", weight=weight, **options)
    ours = draw(splats, camera, "triton", torch.float32, weight=weight, **options)
    assert_same(ours, truth, where=sturdy)
    torch.testing.assert_close(ours.radii, truth.radii, rtol=1e-4, atol=1e-4)
    if len(splats):
        assert truth.alpha.max() > 0
        assert truth.gradients["means"].norm() > 0


@pytest.mark.parametrize(("count", "degree", "log_scale"), [(1, 0, -2), (6, 3, -2)])
def test_random_scenes(small: Camera, count: int, degree: int, log_scale: float) -> None:
    compare(make_splats(count, degree=degree, log_scale=log_scale), small, picture=True)


def test_splats_behind_and_beside_the_camera(small: Camera) -> None:
    splats = make_splats(16, spread=4.0, log_scale=-1.0)
    depth = (splats.means @ torch.tensor(small.rotation).T)[:, 2] + 3
    assert (depth < 0).sum() > 1
    compare(splats, small)


def test_clamped_splats_that_stop_pixels(small: Camera) -> None:
    splats = make_splats(5, log_scale=-0.5)
    splats.logit_opacities[:] = torch.tensor([3.0, 3.0, 3.0, 9.0, 3.0])  # two that are clamped stop a pixel by rounding
    compare(splats, small)
    assert draw(splats, small, "reference").alpha.max() > 0.999


def test_no_splats(small: Camera) -> None:
    compare(make_splats(0), small)


def test_nothing_in_sight() -> None:
    splats = make_splats(5)
    splats.means[:, 2] -= 50
    drawn = draw(splats, make_camera(24, 20, turn=0.0), "triton", torch.float32)
    assert drawn.radii.max() == drawn.alpha.max() == 0
    assert all(drawn.gradients[name].abs().max() == 0 for name in ("means", "quats", "log_scales", "sh"))


def test_values_that_are_not_finite(small: Camera) -> None:
    splats = make_splats(9).to(torch.float32)
    kept = splats[torch.arange(5, 9)]
    for i, (_, tensor) in enumerate(splats.items()):
        tensor.view(9, -1)[i, 0] = float("nan")
    leaves = splats.map(lambda tensor: tensor.clone().requires_grad_())
    render = rasterize(leaves, small, backend="triton")
    assert torch.equal(render.image, rasterize(kept, small, backend="triton").image)
    render.image.sum().backward()
    for _, tensor in leaves.items():
        assert torch.isfinite(tensor.grad).all()
        assert (tensor.grad[:5] == 0).all()
        assert tensor.grad.abs().max() > 0


def test_only_float32(small: Camera) -> None:
    with refuses("rasterizer.dtype", value="torch.float64"):
        rasterize(make_splats(1), small, backend="triton")
    with refuses("rasterizer.mixed_tensors", argument="screen_offsets"):
        offsets = torch.zeros(1, 2, dtype=torch.float64)
        rasterize(make_splats(1).to(torch.float32), small, backend="triton", screen_offsets=offsets)


def test_the_interpreter_is_not_chosen(small: Camera) -> None:
    assert "triton" in available_backends()
    assert preferred_device().type == ("cuda" if torch.cuda.is_available() else "cpu")
    splats = make_splats(3).to(torch.float32)
    assert torch.equal(rasterize(splats, small).image, rasterize(splats, small, backend="cpu").image)


def test_several_views_are_as_one_by_one() -> None:
    """Views of different sizes in one call: each as if drawn alone, and the sum of their gradients."""
    splats = make_splats(8, degree=2, log_scale=-2).to(torch.float32)
    cameras = [make_camera(20, 9, focal=25.0, turn=0.8), make_camera(16, 20, focal=15.0, turn=-0.4)]
    random = torch.Generator().manual_seed(1)
    behind = [torch.rand(3, generator=random), torch.rand(20, 16, 3, generator=random)]
    weights = [torch.rand(one.height, one.width, 3, generator=random) for one in cameras]

    def drawn(together: bool):
        leaves = splats.map(lambda tensor: tensor.clone().requires_grad_())
        offsets = torch.zeros(8, 2, requires_grad=True)
        options = {"backend": "triton", "screen_offsets": offsets}
        if together:
            renders = rasterize_views(leaves, cameras, behind, **options)
        else:
            renders = [rasterize(leaves, *one, **options) for one in zip(cameras, behind, strict=True)]
        parts = [(one.image * weight).sum() for one, weight in zip(renders, weights, strict=True)]
        torch.stack([*parts, renders[0].depth.sum(), renders[1].alpha.sum()]).sum().backward()
        return renders, [tensor.grad for _, tensor in leaves.items()] + [offsets.grad]

    renders, gradients = drawn(True)
    alone, expected = drawn(False)
    for one, other in zip(renders, alone, strict=True):
        for name in ("image", "alpha", "depth", "radii"):
            assert torch.equal(getattr(one, name), getattr(other, name))
            assert getattr(one, name).abs().max() > 0
    for gradient, other in zip(gradients, expected, strict=True):
        torch.testing.assert_close(gradient, other, rtol=1e-4, atol=1e-5 * float(other.abs().max()))


def test_colors_that_need_no_gradient(small: Camera) -> None:
    """Colors are fixed in the motion of a frame; the other gradients do not change."""
    found = []
    for colors in (True, False):
        leaves = make_splats(9, degree=1, log_scale=-2).to(torch.float32).map(lambda one: one.requires_grad_())
        leaves.sh.requires_grad_(colors)
        rasterize(leaves, small, backend="triton").image.sum().backward()
        found.append(leaves)
    assert torch.equal(found[0].means.grad, found[1].means.grad)
    assert found[0].sh.grad.abs().max() > 0
    assert found[1].sh.grad is None


def test_pairs_are_those_of_boxes_that_overlap_a_tile() -> None:
    splats = make_splats(40, degree=0, log_scale=-1.5, spread=1.5).to(torch.float32)
    splats.means[3:6] = splats.means[2]  # equal depths
    cameras = [make_camera(50, 35, focal=30.0), make_camera(70, 20, focal=20.0, turn=1.0)]
    views = Views.of(cameras, torch.device("cpu"))
    table, half, boxes, keys = project_all(splats, views, None)
    index, tiles = bin_splats(boxes, keys, half, views.tiles)

    assert views.tiles == 4 * 3 + 5 * 2
    means, depths, half = table[:, :2].numpy(), table[:, 9].numpy(), half.numpy()
    view_of = np.repeat([0, 1], 40)
    drawn = [int(i) for i in np.lexsort((depths, view_of)) if half[i, 0] > 0]
    assert 10 < len(drawn) < 80
    assert index.tolist() == drawn
    expected, pairs = [], []
    for view, (across, down, first) in enumerate([(4, 3, 0), (5, 2, 12)]):
        for tile in range(across * down):
            corner = 16 * np.array([tile % across, tile // across])
            hits = [
                row
                for row, i in enumerate(drawn)
                if view_of[i] == view
                and (means[i] + half[i] > corner).all()
                and (means[i] - half[i] < corner + 16).all()
            ]
            expected.append(hits)
            pairs += [(row, first + tile) for row in hits]
    starts = tiles.starts.tolist()
    assert [tiles.owners[a:b].tolist() for a, b in pairwise(starts)] == expected
    assert tiles.slots.tolist() == [sorted(pairs).index(pair) for pair in pairs]
    assert tiles.ends.tolist() == np.bincount([row for row, _ in pairs], minlength=len(drawn)).cumsum().tolist()
