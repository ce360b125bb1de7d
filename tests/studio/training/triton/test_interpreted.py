"""All Triton kernels of training in Triton's interpreter, on the CPU."""

from pathlib import Path

import pytest

from tests.support.triton import needs_triton, run_interpreted

pytestmark = pytest.mark.long


@needs_triton
def test_the_interpreted_kernels_against_their_definitions() -> None:
    run_interpreted([Path(__file__).with_name(f"interpreted_{name}.py") for name in ("loss", "coded")], 9)
