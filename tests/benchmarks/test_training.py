"""The benchmark of training runs on a take."""

from pathlib import Path

import pytest
import torch

from v3studio.studio.rasterizer import set_kernel_threads

ROOT = Path(__file__).parents[2]


def test_parts_and_steps_of_a_take(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import training

    threads = torch.get_num_threads()
    try:
        pairs = training.main([str(finished / "take"), "--rounds", "1"])
    finally:
        torch.set_num_threads(threads)
        set_kernel_threads(None)
    assert [pair.calls for pair in pairs if pair.name == "whole step"] == [
        {"keyframe": 1},
        {"motion": 1},
        {"finetune": 1},
    ]
    assert all(pair.fused[0] > 0 and pair.plain[0] > 0 for pair in pairs)
