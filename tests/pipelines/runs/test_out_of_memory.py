from __future__ import annotations

import pytest
import torch

from pipelines.runs.out_of_memory import memory_errors
from studio.errors import StudioError
from tests.support.errors import refuses


def test_an_allocation_that_fails_is_a_sentence() -> None:
    with refuses("run.out_of_memory", stage="train") as caught, memory_errors("train"):
        torch.empty(1 << 55, dtype=torch.uint8)
    assert "finished work is kept" in str(caught.value)


def test_the_memory_of_a_gpu_has_other_remedies() -> None:
    words = "CUDA out of memory. Tried to allocate 2.00 GiB. GPU 0 has a total capacity of 79.11 GiB"
    for error in (torch.cuda.OutOfMemoryError(words), RuntimeError("CUDA error: out of memory")):
        with refuses("run.out_of_gpu_memory", stage="train") as caught, memory_errors("train"):
            raise error
        assert "train.max_splats" in str(caught.value)
        assert "cache_megabytes" not in str(caught.value)


def test_other_errors_stay_what_they_are() -> None:
    with pytest.raises(RuntimeError, match="shapes"), memory_errors("train"):
        raise RuntimeError("shapes do not match")
    with refuses("x.y"), memory_errors("train"):
        raise StudioError("x.y", "out of memory")
