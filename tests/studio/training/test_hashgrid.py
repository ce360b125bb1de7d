"""The sparse hash grid against a slow, literal implementation of Mueller et al. 2022, section 3."""

import itertools

import torch

from v3studio.studio.training.hashgrid import HashGrid


def slow_encoding(grid: HashGrid, position: list[float], capacity: int) -> torch.Tensor:
    out, first = [], 0
    for resolution, rows in zip(grid.resolutions, grid.rows, strict=True):
        value = torch.zeros(grid.features, dtype=torch.float64)
        base = [min(int(c * resolution), resolution - 1) for c in position]
        for offset in itertools.product((0, 1), repeat=3):
            corner = [b + o for b, o in zip(base, offset, strict=True)]
            weight = 1.0
            for axis in range(3):
                fraction = position[axis] * resolution - base[axis]
                weight *= fraction if offset[axis] else 1 - fraction
            if (resolution + 1) ** 3 <= capacity:
                row = corner[0] * (resolution + 1) ** 2 + corner[1] * (resolution + 1) + corner[2]
            else:
                row = ((corner[0] * 1) ^ (corner[1] * 2654435761) ^ (corner[2] * 805459861)) % capacity
            value += weight * grid.table[first + row].detach().double()
        out.append(value)
        first += rows
    return torch.cat(out)


def make_grid() -> HashGrid:
    grid = HashGrid(levels=5, features=3, log2_size=9, base_resolution=4, growth=1.7)
    torch.nn.init.normal_(grid.table)
    return grid


def test_encoding_equals_the_literal_implementation() -> None:
    grid = make_grid()
    assert grid.rows[0] < 512, "a dense level is tested"
    assert grid.rows[-1] == 512, "a hashed level is tested"
    positions = torch.rand(40, 3)
    positions[0], positions[1], positions[2] = 0.0, 1.0, 0.5
    encoded = grid(grid.corners(positions))
    for position, row in zip(positions.tolist(), encoded, strict=True):
        expected = slow_encoding(grid, position, 512)
        assert torch.allclose(row.double(), expected, atol=2e-4)


def test_gradient_equals_finite_differences() -> None:
    grid = make_grid().double()
    corners = grid.corners(torch.rand(7, 3, dtype=torch.float64))
    assert torch.autograd.gradcheck(lambda table: grid(corners), grid.table, atol=1e-9, fast_mode=True)


def test_positions_outside_are_clamped() -> None:
    grid = make_grid()
    outside = grid(grid.corners(torch.tensor([[-3.0, 0.5, 9.0]])))
    border = grid(grid.corners(torch.tensor([[0.0, 0.5, 1.0]])))
    assert torch.equal(outside, border)
