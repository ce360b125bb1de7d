"""Joint training of a group, on a textured ball that moves."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from tests.studio.training.test_group import ball, loss_of, views
from tests.support.splats import Checkpoints, same_splats
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.training import LearningRates, TrainingView, TrainSettings, train_jointly
from v3studio.studio.training.joint import joint_bytes, splats_needed, views_of_frame

MOVES = [step * torch.tensor([0.05, -0.02, 0.0]) for step in range(4)]
SETTINGS = TrainSettings(dropout=0.0, joint_iterations=20, rates=LearningRates(sh_dc=0.02))
SHARED = ("log_scales", "logit_opacities", "sh")


@pytest.fixture(scope="module")
def seen() -> list[list[TrainingView]]:
    return [views(move) for move in MOVES]


@pytest.fixture(scope="module")
def noisy() -> list[Gaussians]:
    """The ball in each frame, with noise of its own on each attribute."""
    generator = torch.Generator().manual_seed(0)

    def noise(like: torch.Tensor, size: float) -> torch.Tensor:
        return size * torch.randn(like.shape, generator=generator)

    made = []
    for move in MOVES:
        true = ball(move)
        changed: dict[str, Any] = {"means": true.means + noise(true.means, 0.003), "sh": true.sh + noise(true.sh, 0.3)}
        made.append(replace(true, **changed))
    return made


def bend(frames: list[Gaussians]) -> float:
    """Mean acceleration of the means."""
    means = torch.stack([frame.means for frame in frames])
    return float(means.diff(n=2, dim=0).norm(dim=-1).mean())


def test_frames_share_appearance_and_come_closer(noisy: list[Gaussians], seen: list[list[TrainingView]]) -> None:
    trained = train_jointly(noisy, seen, SETTINGS, seed=1)
    assert len(trained) == len(noisy)
    for frame in trained[1:]:
        assert all(torch.equal(getattr(frame, name), getattr(trained[0], name)) for name in SHARED)
    for before, after, wanted in zip(noisy, trained, seen, strict=True):
        assert loss_of(after, wanted) < 0.8 * loss_of(before, wanted)
    assert bend(trained) < 0.9 * bend(noisy)
    moved = (trained[-1].means - trained[0].means).mean(0)
    assert torch.allclose(moved, MOVES[-1], atol=0.01), "paths are smoothed, not stopped"


def test_splats_that_no_image_needs_are_left_out(seen: list[list[TrainingView]]) -> None:
    whole = [ball(move) for move in MOVES]
    hidden = [replace(one[:50], means=(one.means[:50] + 4 * move) / 5) for one, move in zip(whole, MOVES, strict=True)]
    frames = [Gaussians.cat(one[:100], inside, one[100:]) for one, inside in zip(whole, hidden, strict=True)]
    kept = splats_needed(frames, seen)
    assert not set(range(100, 150)) & set(kept.tolist())
    assert 280 < len(kept) < 300
    assert torch.equal(kept, kept.sort().values)
    for frame, views_ in zip(frames, seen, strict=True):
        assert loss_of(frame[kept], views_) < 0.03 * loss_of(frame[:150], views_)
    for one, frame in zip(train_jointly(frames, seen, SETTINGS.replace(joint_iterations=1)), frames, strict=True):
        assert (one.means - frame.means[kept]).norm(dim=-1).max() < 0.05


def test_it_resumes_from_each_checkpoint_bit_for_bit(
    noisy: list[Gaussians], seen: list[list[TrainingView]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("v3studio.studio.training.settings.CHECKPOINT_EVERY", 3)
    settings, kept = SETTINGS.replace(joint_iterations=2, dropout=0.3), Checkpoints()
    whole = train_jointly(noisy, seen, settings, seed=4, checkpoint=kept)
    assert list(kept) == [3, 6], "not every frame has been trained at the first"
    for state in kept.values():
        assert all(map(same_splats, whole, train_jointly(noisy, seen, settings, seed=4, resume=state)))


def test_views_that_do_not_fit_into_memory_are_left_out_in_turns(seen: list[list[TrainingView]]) -> None:
    cameras, pixels, frames = len(seen[0]), 8 * 2_000_000, 60
    used = [
        [seen[0].index(one) for one in seen[0] if one.camera in [view.camera for view in kept]]
        for kept in (views_of_frame(seen[0], pixels, frames, position) for position in range(frames))
    ]
    assert 0 < len(used[0]) < cameras
    assert {camera for one in used for camera in one} == set(range(cameras))
    assert len(views_of_frame(seen[0], 1000, frames, 0)) == cameras
    assert joint_bytes(pixels, frames) < joint_bytes(pixels, 1) * frames
