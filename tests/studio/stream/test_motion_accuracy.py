"""How exactly the profile `motion` keeps each attribute: steps and errors as absolute figures.

`test_motion.py` measures errors in the steps that the stream itself declares; this one notices a stream whose declared
steps are too coarse.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from studio.errors import Cancelled, StudioError
from studio.gaussians import Gaussians
from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.manifest import MotionRendition
from studio.stream.video import PlaneEncoder
from tests.support.performer import attribute_errors, performer

FRAMES = 4


def baked(folder: Path, frames: list[Gaussians], **settings: object) -> tuple[MotionRendition, list[Gaussians]]:
    chosen = BakeSettings.model_validate({"preset": "veryfast", **settings})
    entry = bake_group(frames, folder, 0, 0, chosen)
    write_manifest(folder, [entry], 30, chosen)
    with StreamReader.open(folder) as reader:
        return entry, list(reader.iterate())  # type: ignore[return-value]


# Of the format's tuned steps (docs/STREAM.md); coarser ones would be visible.
STEPS = {"rotation": 0.0015, "log_scale": 0.017, "opacity": 0.0096, "y": 0.0069, "co": 0.0072, "cg": 0.0072}


def step_name(channel: str) -> str:
    return channel.rsplit("_", 1)[1] if channel.startswith("sh_") else channel.rstrip("0123456789").rstrip("_")


def test_steps_are_the_documented_ones(tmp_path: Path) -> None:
    frames = performer(FRAMES)
    entry, _ = baked(tmp_path, frames, quality=20)
    size = float(np.exp(np.median(frames[0].log_scales.numpy().mean(axis=1))))
    opaque = float(np.median(frames[0].opacities.numpy())) / 0.15
    for channel in entry.channels[:3]:
        assert channel.step == pytest.approx(0.08 * size / math.sqrt(opaque) / 2, rel=1e-4), channel.name
    for channel in entry.channels[3:]:
        assert channel.step == pytest.approx(STEPS[step_name(channel.name)], rel=1e-6), channel.name


def test_errors_at_qp_20_stay_below_absolute_limits(tmp_path: Path) -> None:
    """A seventh above what was measured: 0.00028, 1.27, 0.035, 0.021, 0.018. Steps follow what can be seen, so the
    profile `planes` errs less at the same QP, for several times the bytes."""
    frames = performer(FRAMES)
    entry, decoded = baked(tmp_path / "motion", frames, quality=20)
    found = attribute_errors(frames, decoded)
    limits = {"means": 0.00033, "angle": 1.45, "log_scales": 0.041, "opacity": 0.0245, "sh": 0.0205}
    assert {name: error for name, error in found.items() if error > limits[name]} == {}
    planes, _ = baked(tmp_path / "planes", frames, quality=20, profile="planes")
    assert entry.bytes < planes.bytes / 3


@pytest.mark.parametrize(
    ("attribute", "channels"),
    [
        ("means_low", {"residual_x", "residual_y", "residual_z"}),
        ("quats", {"rotation_0", "rotation_1", "rotation_2"}),
        ("scales", {"log_scale_0", "log_scale_1", "log_scale_2"}),
        ("opacities", {"opacity"}),
        ("sh", {f"sh_{k}_{part}" for k in range(4) for part in ("y", "co", "cg")}),
    ],
)
def test_the_qp_of_an_attribute_acts_on_its_channels_only(tmp_path: Path, attribute: str, channels: set[str]) -> None:
    """6 QPs more double the step, 6 fewer halve it."""
    frames = performer(2, 300)
    plain, _ = baked(tmp_path / "plain", frames, quality=20)
    for qp, factor in ((26, 2.0), (14, 0.5)):
        entry, _ = baked(tmp_path / str(qp), frames, quality=20, attribute_qps={attribute: qp})
        found = {now.name: now.step / before.step for now, before in zip(entry.channels, plain.channels, strict=True)}
        assert found == pytest.approx({name: factor if name in channels else 1.0 for name in found})


def test_needles_are_widened_to_a_sixteenth_of_the_typical_size(tmp_path: Path) -> None:
    frames = performer(2, 300)
    for frame in frames:
        frame.log_scales[7] = torch.tensor([-25.0, -4.6, -4.6])
    _, decoded = baked(tmp_path, frames, quality=0)
    size = float(np.exp(np.median(frames[0].log_scales.numpy().mean(axis=1))))
    for found in decoded:
        assert found.log_scales.min().item() == pytest.approx(math.log(size / 16), abs=0.02)


def test_it_can_be_cancelled_in_the_middle_of_the_video(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []

    def stop(done: int, total: int) -> None:
        seen.append((done, total))
        if done == 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        bake_group(performer(FRAMES), tmp_path, 0, 0, BakeSettings(), progress=stop)
    assert seen[-1] == (2, FRAMES)
    assert not list(tmp_path.rglob("*.mp4"))


def test_a_failure_of_the_encoder_is_not_swallowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: PlaneEncoder, plane: np.ndarray) -> None:
        raise StudioError("video.encoder", "the encoder failed")

    monkeypatch.setattr(PlaneEncoder, "add", fail)
    with pytest.raises(StudioError, match="the encoder failed"):
        bake_group(performer(FRAMES), tmp_path, 0, 0, BakeSettings())
    assert not list(tmp_path.rglob("*.mp4"))
