"""How much memory this process may use: the machine's, or less if a container or a limit of the session says so.

Without this, a run in a container of 4 GB on a machine of 64 GB would plan for 64 GB and be killed by the kernel.
"""

from __future__ import annotations

import errno
import re
import resource
from pathlib import Path

_CGROUPS = Path("/sys/fs/cgroup")
_OWN_CGROUP = Path("/proc/self/cgroup")


def memory_limit() -> int:
    """Bytes that this process may use: the least of the machine's memory, its cgroup's limit, `ulimit -v` and `-d`."""
    import psutil

    return min([int(psutil.virtual_memory().total), *_cgroup_limits(), *_session_limits()])


def memory_available() -> int:
    """Bytes that this process may still take without swapping, as far as can be known."""
    import psutil

    own = int(psutil.Process().memory_info().rss)
    return max(0, min(int(psutil.virtual_memory().available), memory_limit() - own))


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an error of Python, PyTorch (on the CPU or a GPU) or OpenCV says that memory ran out."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    words = ("can't allocate memory", "not enough memory", "out of memory", "Insufficient memory", "std::bad_alloc")
    return isinstance(error, (RuntimeError, OSError, _cv2_error())) and any(word in str(error) for word in words)


def gpu_out_of_memory(error: BaseException) -> str | None:
    """The GPU whose memory ran out, with its size in GB, as in "NVIDIA H200 (150.1 GB)"; None for any other error."""
    import torch

    says = isinstance(error, RuntimeError) and "CUDA" in str(error) and is_out_of_memory(error)
    if not says and not isinstance(error, torch.cuda.OutOfMemoryError):
        return None
    if not torch.cuda.is_available():  # the error came from another machine
        return "the GPU"
    named = re.search(r"\bGPU (\d+)\b", str(error))  # as PyTorch's allocator says
    about = torch.cuda.get_device_properties(int(named[1]) if named else torch.cuda.current_device())
    return f"{about.name} ({about.total_memory / 1e9:.1f} GB)"


def _cv2_error() -> type[BaseException]:
    import cv2

    return cv2.error


def _session_limits() -> list[int]:
    limits = (resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA))
    return [limit for limit in limits if limit != resource.RLIM_INFINITY]


def _cgroup_limits() -> list[int]:
    """Limits of this process's cgroup and of those above it: version 2, and version 1 as in older containers."""
    found = []
    try:
        lines = _OWN_CGROUP.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root = _CGROUPS / "memory" if controllers else _CGROUPS
        name = "memory.limit_in_bytes" if controllers else "memory.max"
        place = root / path.lstrip("/")
        for folder in (place, *place.parents):
            if folder == root.parent:
                break
            text = _first_line(folder / name)
            if text.isdigit() and int(text) > 0:  # version 2 says "max" for no limit, version 1 a huge number
                found.append(int(text))
    return found


def _first_line(file: Path) -> str:
    try:
        return file.read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return ""
