"""Runs a test with each instruction set that this machine supports."""

from collections.abc import Iterator

import pytest

from studio.rasterizer.cpu import load_kernels


@pytest.fixture(params=load_kernels().instruction_sets())
def instruction_set(request: pytest.FixtureRequest) -> Iterator[str]:
    """The name of the instruction set, in use during the test."""
    kernels = load_kernels()
    used = kernels.instruction_set()
    kernels.use_instruction_set(request.param)
    yield request.param
    kernels.use_instruction_set(used)
