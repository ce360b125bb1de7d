"""Finds how much memory this process may use: the machine's, or less if a container or a limit of the session says so.

Without this, a run in a container of 4 GB on a machine of 64 GB would plan for 64 GB and be killed by the kernel.
"""

import contextlib
import errno
import importlib
import os
import re
import resource
from pathlib import Path

from v3studio.studio.errors import StudioError

CGROUPS = Path("/sys/fs/cgroup")
OWN_CGROUP = Path("/proc/self/cgroup")

_LEAST = 768 << 20  # bytes of data: a run of six cameras of 64x48 with one thread takes 588 MB
_LIBRARIES = 2 << 30  # bytes of addresses that libraries take beside the data: 1.8 GB in that run
_PER_THREAD = 3 * 40 << 20  # bytes: a buffer of 32 MiB and a stack of 8 MiB in each of three OpenBLAS


def memory_limit() -> int:
    """Bytes that this process may use: the least of the machine's memory, its cgroup's limit, `ulimit -v` and `-d`."""
    import psutil

    session = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    set_ = [limit for limit in session if limit != resource.RLIM_INFINITY]
    return min([int(psutil.virtual_memory().total), *_cgroup_limits(), *set_])


def memory_available() -> int:
    """Bytes that this process may still take without swapping, as far as can be known."""
    import psutil

    own = int(psutil.Process().memory_info().rss)
    return max(0, min(int(psutil.virtual_memory().available), memory_limit() - own))


def require_memory() -> None:
    """Refuse a limit of the session (`ulimit -d`, `-v`) in which not even a tiny take can be trained; under any other
    limit, load the libraries of linear algebra while there is room for them.

    OpenBLAS, of which NumPy, SciPy and OpenCV have one each, tries again forever if it cannot have its buffers, and
    signals are not handled meanwhile. It takes them when it is loaded, so that later nothing can take their place.
    """
    for kind, option, mapped in ((resource.RLIMIT_DATA, "-d", 0), (resource.RLIMIT_AS, "-v", _LIBRARIES)):
        limit = resource.getrlimit(kind)[0]
        if limit == resource.RLIM_INFINITY:
            continue
        least = _LEAST + mapped + _PER_THREAD * (_blas_threads() - 1)
        if limit < least:
            raise StudioError(
                "memory.limit_too_low",
                f"this session may use {limit / 1e9:.2f} GB of memory (ulimit {option}); at least {least / 1e9:.2f} GB "
                "are needed",
                value=limit,
                fix=f"Set ulimit {option} {-(-least // 1024)} or more, or unlimited; fewer threads (OMP_NUM_THREADS=1) "
                "need less.",
            )
        for name in ("numpy.linalg", "scipy.linalg", "cv2"):
            importlib.import_module(name)


def _blas_threads() -> int:
    """Threads of each OpenBLAS, which reads these variables in this order; its wheels are built for 64."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        text = os.environ.get(name, "")
        if text.isdecimal() and int(text[:9]) > 0:
            return min(int(text[:9]), 64)
    return min(os.cpu_count() or 1, 64)


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether an error of Python, PyTorch (on the CPU or a GPU), OpenCV or ONNX Runtime says that memory ran
    out."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    import cv2

    words = ["can't allocate memory", "not enough memory", "out of memory", "Insufficient memory", "std::bad_alloc"]
    words += ["Failed to allocate memory"]
    known = isinstance(error, (RuntimeError, OSError, cv2.error)) or type(error).__module__.startswith("onnxruntime")
    return known and any(word in str(error) for word in words)


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


def _cgroup_limits() -> list[int]:
    """Limits of this process's cgroup and of those above it: version 2, and version 1 as in older containers."""
    limits = []
    try:
        lines = OWN_CGROUP.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root = CGROUPS / "memory" if controllers else CGROUPS
        name = "memory.limit_in_bytes" if controllers else "memory.max"
        place = root / path.lstrip("/")
        for folder in (place, *place.parents):
            if folder == root.parent:
                break
            with contextlib.suppress(OSError, ValueError):  # version 2 says "max" for no limit, version 1 a huge number
                limits.append(int((folder / name).read_bytes()))
    return [limit for limit in limits if limit > 0]
