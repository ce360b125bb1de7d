"""Trains groups in parallel, and within a group the two sides of its keyframe: they are independent, and one thread for
each uses a CPU better than all threads for one."""

import gc
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait

from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.studio.errors import Cancelled, StudioError
from v3studio.studio.memory import memory_limit

_MOST = 8  # more threads than this contend for the GIL
_BYTES_A_PIXEL = 16  # of a training view: 8 channels of bytes, for this frame and the next
_BYTES_A_SMALL_PIXEL = 80  # of a small view, which is also cached as floats
_BYTES_A_DRAWN_PIXEL = 200  # of the view being rendered: float32 images, targets and gradients


def groups_at_once(inputs: Inputs) -> int:
    """Number of groups to train in parallel: `run.groups_at_once`, or as many as threads and memory allow."""
    asked, groups = inputs.config.run.groups_at_once, len(inputs.groups)
    if asked is not None:
        return min(asked, groups)
    # a run on other machines may need a GPU that this one does not have
    if inputs.config.run.device.startswith("cuda") or inputs.device != "cpu":
        return 1
    memory = memory_limit() // 2
    return max(1, min(groups, inputs.threads, _MOST, memory // memory_of_group(inputs)))


def sides_at_once(inputs: Inputs, threads: int) -> int:
    """Number of sides of a keyframe that a group with this many CPU threads trains in parallel, 1 or 2."""
    if threads == 1 or inputs.device != "cpu":
        return 1
    return 2 if 2 * groups_at_once(inputs) * memory_of_group(inputs) <= memory_limit() else 1


def refuse_too_little_memory(inputs: Inputs) -> None:
    """Refuse to train on a CPU what cannot fit; otherwise the kernel kills the run, silently.

    A user who sets `run.groups_at_once` has the last word.
    """
    if inputs.config.run.groups_at_once is not None or inputs.device != "cpu":
        return
    needed, limit = memory_of_group(inputs), memory_limit()
    if needed > limit:
        problem = f"training one group takes about {needed / 1e9:.1f} GB, and this process may use {limit / 1e9:.1f} GB"
        fix = "Allow more memory, set capture.scale, or use fewer cameras; run.groups_at_once: 1 tries it anyway."
        raise StudioError("train.too_little_memory", problem, value=needed, fix=fix, limit=limit)


def memory_of_group(inputs: Inputs) -> int:
    """Estimated bytes that training one group takes on a CPU, beyond the program itself."""
    from v3studio.studio.training.joint import joint_bytes
    from v3studio.studio.training.views import CACHED_PIXELS

    footage = inputs.calibrated_footage
    pixels = [footage.rig[name].width * footage.rig[name].height for name in footage.train_cameras]
    each = sum(max(_BYTES_A_PIXEL * count, _BYTES_A_SMALL_PIXEL * min(count, CACHED_PIXELS)) for count in pixels)
    longest = max((len(group.frames) for group in inputs.groups), default=1)
    joint = joint_bytes(sum(pixels), longest) if inputs.config.train.joint_iterations else 0
    return each + joint + _BYTES_A_DRAWN_PIXEL * max(pixels, default=1)


def threads_by_group(groups: int, at_once: int, threads: int) -> list[int]:
    """CPU threads per group; if the last round has fewer groups, they get more. It depends only on the index of the
    group, not on which groups are left: sums over another number of threads round differently, and a resumed run must
    give the same bits."""
    full = groups - groups % at_once
    last = max(1, threads // (groups % at_once)) if groups % at_once else 0
    return [max(1, threads // at_once) if index < full else last for index in range(groups)]


def threads_of_groups(inputs: Inputs) -> list[int]:
    """CPU threads that training uses for each group of the take, by index."""
    return threads_by_group(len(inputs.groups), groups_at_once(inputs), inputs.threads)


def run_groups(
    jobs: Mapping[int, Callable[[], None]], at_once: int, threads: Sequence[int], stop: Cancellation
) -> None:
    """Run one job per group, several in parallel; `stop` is set when a job fails, to end the others soon. Raises the
    first exception of a job; Cancelled only if there is no other."""
    import torch

    def work(index: int, job: Callable[[], None]) -> None:
        torch.get_num_threads()  # the first call in a thread applies the number last set by any thread, so do it first
        torch.set_num_threads(threads[index])  # OpenMP stores it per calling thread
        stop.check()
        job()

    before = torch.get_num_threads()
    # Training makes garbage quickly; each full collection would go through all modules that are loaded. So would one
    # here, in a quarter of a second: what has been garbage for long may wait.
    gc.collect(1)
    gc.freeze()
    try:
        if at_once == 1:
            for index, job in jobs.items():
                work(index, job)
            return
        with ThreadPoolExecutor(at_once, thread_name_prefix="group") as pool:
            futures = [pool.submit(work, index, job) for index, job in jobs.items()]
            done, _ = wait(futures, return_when=FIRST_EXCEPTION)
            if any(future.exception() is not None for future in done):
                stop.cancel()
        errors = [error for future in futures if (error := future.exception()) is not None]
        for error in sorted(errors, key=lambda error: isinstance(error, Cancelled)):
            raise error
    finally:
        gc.unfreeze()
        torch.set_num_threads(before)
