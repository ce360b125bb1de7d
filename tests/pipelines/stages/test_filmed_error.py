"""`bake.max_loss` in a take: the losses that the evaluation finds stay below it, or a warning says which do not."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from tests.support.tiny_capture import v3studio


def losses_of(take: Path) -> list[float]:
    rows = json.loads((take / "evaluation.json").read_text())["frames"]
    return [row["psnr_trained"] - row["psnr_decoded"] for row in rows]


def size_of(take: Path) -> int:
    size: int = json.loads((take / "stream" / "manifest.json").read_text())["total_bytes"]
    return size


def run(take: Path, *settings: str) -> str:
    """Bake and evaluate; what was printed."""
    done = v3studio("run", "--take", take, *(word for one in settings for word in ("--set", f"bake.{one}")))
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_no_frame_loses_more_than_the_limit_or_it_is_told(finished: Path, tmp_path: Path) -> None:
    """At QP 45, the means of keyframes are coarse, which no QP of single frames changes."""
    take = Path(shutil.copytree(finished, tmp_path / "project")) / "take"
    keyframes = {0, 3}
    coarse = ("qp=45", "smooth_paths=false")
    run(take, *coarse)
    before, size = losses_of(take), size_of(take)
    limit = round(max(loss for index, loss in enumerate(before) if index not in keyframes) / 2, 3)
    assert limit > 0.05
    printed = " ".join(run(take, *coarse, f"max_loss={limit}").split())
    above = {index for index, loss in enumerate(losses_of(take)) if loss > limit + 0.002}
    assert above <= keyframes
    assert size_of(take) > size
    for group, first in enumerate((0, 3)):
        told = f"group {group}: 1 frame above bake.max_loss {limit:g}: frame {first} loses most to encoding"
        assert (told in printed) == (first in above)
