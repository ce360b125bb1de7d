"""The error of a run, or another command, when memory runs out."""

from collections.abc import Iterator
from contextlib import contextmanager

from v3studio.studio.errors import StudioError
from v3studio.studio.memory import gpu_out_of_memory, is_out_of_memory, memory_limit


@contextmanager
def memory_errors(stage: str = "") -> Iterator[None]:
    """Turn an allocation that fails inside the block into a StudioError."""
    try:
        yield
    except Exception as error:
        if isinstance(error, StudioError) or not is_out_of_memory(error):
            raise
        where = f" in the stage {stage}" if stage else ""
        gpu = gpu_out_of_memory(error)
        if gpu is not None:
            problem = f"the memory of {gpu} ran out{where}"
            fix = (
                "End other programs that use this GPU, or lower train.max_splats, capture.scale or "
                "run.groups_at_once, and run again; finished work is kept."
            )
            raise StudioError("run.out_of_gpu_memory", problem, fix=fix, stage=stage) from error
        problem = f"memory ran out{where}; this process may use {memory_limit() / 1e9:.1f} GB"
        fix = "Allow more memory, or lower run.groups_at_once or capture.scale, and run again; finished work is kept."
        raise StudioError("run.out_of_memory", problem, fix=fix, stage=stage) from error
