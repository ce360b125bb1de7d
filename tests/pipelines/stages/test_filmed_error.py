"""A limit to the loss of each frame: the evaluation finds no larger one, or a warning says where."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest


def losses_of(take: Path) -> list[float]:
    rows = json.loads((take / "evaluation.json").read_text())["frames"]
    return [row["psnr_trained"] - row["psnr_decoded"] for row in rows]


def size_of(take: Path) -> int:
    size: int = json.loads((take / "stream" / "manifest.json").read_text())["total_bytes"]
    return size


def test_no_frame_loses_more_than_the_limit_or_it_is_reported(
    finished: Path, tmp_path: Path, here: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At QP 45, the means of keyframes are coarse, which no QP of single frames changes."""
    take = Path(shutil.copytree(finished, tmp_path / "project")) / "take"
    keyframes = {0, 3}
    monkeypatch.setattr("studio.stream.settings.LOSS_QP", 45)

    def run(quality: object) -> str:
        done = here("run", take, "--bake.quality", quality, "--bake.smooth_paths", "false").ok()
        return " ".join((done.stdout + done.stderr).split())

    run(45)
    before, size = losses_of(take), size_of(take)
    limit = round(max(loss for index, loss in enumerate(before) if index not in keyframes) / 2, 3)
    assert limit > 0.05
    printed = run(f"{limit} dB loss")
    above = {index for index, loss in enumerate(losses_of(take)) if loss > limit + 0.002}
    assert above <= keyframes
    assert size_of(take) > size
    for group, first in enumerate((0, 3)):
        warning = f"group {group}: 1 frame above the limit of {limit:g} dB: frame {first} loses most to encoding"
        assert (warning in printed) == (first in above)
