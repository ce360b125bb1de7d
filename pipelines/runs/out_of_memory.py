"""What a run says when memory runs out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from studio.errors import StudioError
from studio.memory import is_out_of_memory, memory_limit


@contextmanager
def memory_errors(stage: str) -> Iterator[None]:
    """Turn an allocation that fails inside the block into a StudioError.

    Raises:
        StudioError: `run.out_of_memory`.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, StudioError) or not is_out_of_memory(error):
            raise
        raise StudioError(
            "run.out_of_memory",
            f"memory ran out in the stage {stage}; this process may use {memory_limit() / 1e9:.1f} GB",
            fix="Allow more memory, or lower run.groups_at_once, capture.cache_megabytes or capture.scale, and run "
            "again; finished work is kept.",
            stage=stage,
        ) from error
