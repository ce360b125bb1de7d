"""The Triton backend against the reference, on the CPU. `test_triton.py` runs this file with TRITON_INTERPRET=1."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch

from studio.rasterizer import available_backends, preferred_device, rasterize
from studio.rasterizer.triton_backend import bin_splats
from tests.support.errors import refuses


@pytest.fixture
def small(helpers):  # type: ignore[no-untyped-def]
    """A camera whose picture has two by two tiles, the outer ones cut by its edges."""
    return helpers.camera(24, 20, focal=20.0)


def compare(helpers, splats, camera, **options) -> None:  # type: ignore[no-untyped-def]
    sturdy = helpers.sturdy(splats, camera, options.get("alpha_max", 0.99))
    assert sturdy.double().mean() > 0.7
    weight = sturdy.double()
    truth = helpers.draw(splats, camera, "reference", weight=weight, **options)
    ours = helpers.draw(splats, camera, "triton", torch.float32, weight=weight, **options)
    helpers.assert_same(ours, truth, where=sturdy)
    torch.testing.assert_close(ours.radii, truth.radii, rtol=1e-4, atol=1e-4)
    if len(splats):
        assert truth.alpha.max() > 0
        assert truth.gradients["means"].norm() > 0


@pytest.mark.parametrize(("count", "degree", "log_scale"), [(1, 0, -2), (20, 3, -2), (6, 1, 1)])
def test_random_scenes(helpers, small, count, degree, log_scale) -> None:  # type: ignore[no-untyped-def]
    compare(helpers, helpers.splats(count, degree=degree, log_scale=log_scale), small, picture=True)


def test_another_dilation(helpers, small) -> None:  # type: ignore[no-untyped-def]
    compare(helpers, helpers.splats(20, degree=1, log_scale=-3, dilation=0.05), small)


def test_splats_behind_and_beside_the_camera(helpers, small) -> None:  # type: ignore[no-untyped-def]
    splats = helpers.splats(30, spread=4.0, log_scale=-1.0)
    depth = (splats.means @ torch.tensor(small.rotation).T)[:, 2] + 3
    assert (depth < 0).sum() > 3
    compare(helpers, splats, small)


@pytest.mark.parametrize("alpha_max", [0.9])
def test_clamped_splats_that_stop_pixels(helpers, small, alpha_max) -> None:  # type: ignore[no-untyped-def]
    splats = helpers.splats(10, log_scale=-0.5)
    splats.logit_opacities[:] = 9.0
    compare(helpers, splats, small, alpha_max=alpha_max)
    assert helpers.draw(splats, small, "reference", alpha_max=alpha_max).alpha.max() > 0.999


def test_splats_of_equal_depth_keep_their_order(helpers) -> None:  # type: ignore[no-untyped-def]
    camera = helpers.camera(16, 16, focal=20.0, turn=0.0)
    splats = helpers.splats(6, log_scale=-1.0)
    splats.means[:, 2] = 0.0
    truth = helpers.draw(splats, camera, "reference")
    ours = helpers.draw(splats, camera, "triton", torch.float32)
    assert (ours.image - truth.image).abs().median() < 1e-5


def test_no_splats(helpers, small) -> None:  # type: ignore[no-untyped-def]
    compare(helpers, helpers.splats(0), small)


def test_nothing_in_sight(helpers) -> None:  # type: ignore[no-untyped-def]
    splats = helpers.splats(5)
    splats.means[:, 2] -= 50
    drawn = helpers.draw(splats, helpers.camera(24, 20, turn=0.0), "triton", torch.float32)
    assert drawn.radii.max() == drawn.alpha.max() == 0
    assert all(drawn.gradients[name].abs().max() == 0 for name in ("means", "quats", "log_scales", "sh"))


def test_values_that_are_not_finite(helpers, small) -> None:  # type: ignore[no-untyped-def]
    splats = helpers.splats(9).to(torch.float32)
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


def test_only_float32(helpers, small) -> None:  # type: ignore[no-untyped-def]
    with refuses("rasterizer.dtype", value="torch.float64"):
        rasterize(helpers.splats(1), small, backend="triton")
    with refuses("rasterizer.mixed_tensors", argument="screen_offsets"):
        offsets = torch.zeros(1, 2, dtype=torch.float64)
        rasterize(helpers.splats(1).to(torch.float32), small, backend="triton", screen_offsets=offsets)


def test_the_interpreter_is_not_chosen(helpers, small) -> None:  # type: ignore[no-untyped-def]
    assert "triton" in available_backends()
    assert preferred_device().type == ("cuda" if torch.cuda.is_available() else "cpu")
    splats = helpers.splats(3).to(torch.float32)
    assert torch.equal(rasterize(splats, small).image, rasterize(splats, small, backend="cpu").image)


@pytest.mark.parametrize("size", [4, 16])
def test_pairs_are_those_of_boxes_that_overlap_a_tile(size) -> None:  # type: ignore[no-untyped-def]
    random = np.random.default_rng(2)
    width, height, count = 50, 35, 60
    means = random.uniform(-10, 60, (count, 2)).astype(np.float32)
    half = random.exponential(6, (count, 2)).astype(np.float32)
    half[0] = 1e30
    outside = ((means + half <= 0) | (means - half >= (width, height))).any(1)
    half[outside | (random.random(count) < 0.2)] = 0
    depths = random.integers(1, 9, count).astype(np.float32)
    index, tiles = bin_splats(*map(torch.from_numpy, (means, half, depths)), width, height, size)

    drawn = [int(i) for i in np.argsort(depths, kind="stable") if half[i, 0] > 0]
    assert index.tolist() == drawn
    expected, pairs = [], []
    for tile in range(tiles.across * tiles.down):
        corner = size * np.array([tile % tiles.across, tile // tiles.across])
        hits = [
            row
            for row, i in enumerate(drawn)
            if (means[i] + half[i] > corner).all() and (means[i] - half[i] < corner + size).all()
        ]
        expected.append(hits)
        pairs += [(row, tile) for row in hits]
    starts = tiles.starts.tolist()
    assert [tiles.owners[a:b].tolist() for a, b in pairwise(starts)] == expected
    assert tiles.slots.tolist() == [sorted(pairs).index(pair) for pair in pairs]
    assert tiles.ends.tolist() == np.bincount([row for row, _ in pairs], minlength=len(drawn)).cumsum().tolist()
