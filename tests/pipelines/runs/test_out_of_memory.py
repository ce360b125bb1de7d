import subprocess
import sys
from pathlib import Path

import torch

from tests.support.errors import refuses
from tests.support.tiny_capture import ROOT
from v3studio.pipelines.runs.out_of_memory import memory_errors


def test_an_allocation_that_fails_is_a_sentence() -> None:
    with refuses("run.out_of_memory", stage="train"), memory_errors("train"):
        torch.empty(1 << 55, dtype=torch.uint8)


def test_the_memory_of_a_gpu_has_other_remedies() -> None:
    words = "CUDA out of memory. Tried to allocate 2.00 GiB. GPU 0 has a total capacity of 79.11 GiB"
    for error in (torch.cuda.OutOfMemoryError(words), RuntimeError("CUDA error: out of memory")):
        with refuses("run.out_of_gpu_memory", stage="train") as caught, memory_errors("train"):
            raise error
        assert "train.max_splats" in str(caught.value)


def test_a_run_with_too_little_memory_ends_with_a_sentence(tmp_path: Path) -> None:
    """Without the check, OpenBLAS tries for ever to have its buffers."""
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_DATA, (400 << 20, 400 << 20)); "
        "from v3studio.pipelines.cli import execute; sys.exit(execute(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", code, "run", str(tmp_path / "a.yaml"), "--take", str(tmp_path / "take")]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.startswith("error: this session may use 0.42 GB of memory (ulimit -d)")
    assert "Traceback" not in ended.stderr
    assert not (tmp_path / "take").exists()
