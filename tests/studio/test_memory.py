import mmap
import re
import resource
from pathlib import Path

import numpy as np
import psutil
import pytest
import torch

from tests.support.errors import refuses
from v3studio.studio import memory
from v3studio.studio.memory import is_out_of_memory, memory_available, memory_limit, require_memory


@pytest.fixture
def cgroups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of cgroups; this process is in /outer/inner."""
    own = tmp_path / "cgroup"
    own.write_text("0::/outer/inner\n")
    monkeypatch.setattr(memory, "OWN_CGROUP", own)
    monkeypatch.setattr(memory, "CGROUPS", tmp_path / "fs")
    (tmp_path / "fs" / "outer" / "inner").mkdir(parents=True)
    return tmp_path / "fs"


def test_a_container_limits_it_at_any_level(cgroups: Path) -> None:
    (cgroups / "outer" / "inner" / "memory.max").write_text(f"{1 << 32}\n")
    assert memory_limit() == 1 << 32
    own = psutil.Process().memory_info().rss
    (cgroups / "outer" / "memory.max").write_text(f"{own + (64 << 20)}\n")
    assert memory_limit() == own + (64 << 20)
    assert memory_available() < 128 << 20, "less what this process has, which may just have changed a little"


def test_without_limits_it_is_the_machine(cgroups: Path) -> None:
    (cgroups / "outer" / "memory.max").write_text("max\n")
    assert memory_limit() == psutil.virtual_memory().total


def test_limits_of_the_session_count(cgroups: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_DATA)
    limit = psutil.virtual_memory().total // 2
    resource.setrlimit(resource.RLIMIT_DATA, (limit, before[1]))
    try:
        assert memory_limit() == limit
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def test_every_librarys_way_to_say_that_memory_ran_out_is_known() -> None:
    with pytest.raises(MemoryError) as numpy_says:
        np.empty(1 << 60, np.uint8)
    with pytest.raises(RuntimeError) as torch_says:
        torch.empty(1 << 55, dtype=torch.uint8)
    assert is_out_of_memory(numpy_says.value)
    assert is_out_of_memory(torch_says.value)
    with pytest.raises(OSError) as mmap_says:
        mmap.mmap(-1, 1 << 60)
    assert is_out_of_memory(mmap_says.value)
    assert not is_out_of_memory(RuntimeError("shapes do not match"))
    assert not is_out_of_memory(ValueError("out of memory"))


@pytest.mark.parametrize(("kind", "option"), [(resource.RLIMIT_DATA, "-d"), (resource.RLIMIT_AS, "-v")])
def test_a_limit_that_cannot_do_is_refused(kind: int, option: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit that the sentence asks for is enough; more threads need more."""
    limits = {kind: 400_000 << 10}
    monkeypatch.setattr(resource, "getrlimit", lambda limit: (limits.get(limit, resource.RLIM_INFINITY),) * 2)
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    asked = []
    for threads in ("1", "16"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        limits[kind] = 400_000 << 10
        with refuses("memory.limit_too_low", value=400_000 << 10) as caught:
            require_memory()
        advised = re.search(rf"ulimit {option} ([0-9]+)", str(caught.value))
        asked.append(int(advised[1]))
        limits[kind] = asked[-1] << 10
        require_memory()
    assert asked[0] < asked[1]
