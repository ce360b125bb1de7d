"""Fine-tuning of the splats that are kept, on a textured ball that moves."""

import math
from dataclasses import replace

import pytest
import torch

from tests.studio.training.test_group import ball, loss_of, views
from tests.support.errors import refuses
from tests.support.splats import Checkpoints
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.training import LearningRates, TrainingView, TrainSettings
from v3studio.studio.training.offsets import SplatOffsets, train_offsets

MOVES = (torch.zeros(3), torch.tensor([0.1, 0.0, 0.05]))
SETTINGS = TrainSettings(dropout=0.0, rates=LearningRates(scale=0.05))
KEPT = torch.arange(0, 300, 3)


@pytest.fixture(scope="module")
def frames() -> list[Gaussians]:
    return [ball(move) for move in MOVES]


@pytest.fixture(scope="module")
def seen() -> list[list[TrainingView]]:
    return [views(move) for move in MOVES]


def test_others_are_covered_and_paths_stay(frames: list[Gaussians], seen: list[list[TrainingView]]) -> None:
    offsets = train_offsets(frames[:1], seen[:1], KEPT, 0, SETTINGS, 30)
    cut = [offsets.selected(frame) for frame in frames]
    tuned = [offsets.applied(frame) for frame in cut]
    for before, after, wanted in zip(cut, tuned, seen, strict=True):  # the second frame was not trained on
        assert loss_of(after, wanted) < 0.75 * loss_of(before, wanted)
    assert torch.allclose(tuned[1].means - tuned[0].means, cut[1].means - cut[0].means, atol=1e-6)
    assert (tuned[0].scales > cut[0].scales).float().mean() > 0.8


def test_offsets_resume_from_each_checkpoint_bit_for_bit(
    frames: list[Gaussians], seen: list[list[TrainingView]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("v3studio.studio.training.settings.CHECKPOINT_EVERY", 5)
    kept = Checkpoints()
    whole = train_offsets(frames, seen, KEPT, 0, SETTINGS, 13, seed=4, checkpoint=kept)
    assert list(kept) == [5, 10]
    for state in kept.values():
        resumed = train_offsets(frames, seen, KEPT, 0, SETTINGS, 13, seed=4, resume=state)
        for name, value in whole.to_tensors().items():
            assert torch.equal(value, resumed.to_tensors()[name]), name


def test_offsets_are_in_each_splats_own_units() -> None:
    frame = ball(torch.zeros(3))[:2]
    turned = replace(frame, quats=torch.tensor([[1.0, 0, 0, 0], [0, 0, 0, 3.0]]))
    none = SplatOffsets.zeros(torch.tensor([1]), 0)
    assert torch.allclose(none.applied(none.selected(turned)).quats, torch.tensor([[0, 0, 0, 1.0]]))
    tensors = none.to_tensors()
    tensors["rotation"] = torch.tensor([[1.0, 0, 0]])  # a quarter turn about the splat's x, after w = 1
    offsets, half = SplatOffsets.from_tensors(tensors), math.sqrt(0.5)
    quats = offsets.applied(offsets.selected(turned)).quats
    assert torch.allclose(quats, torch.tensor([[0, 0, half, half]]), atol=1e-6)


def test_offsets_of_other_splats_are_refused(frames: list[Gaussians]) -> None:
    with refuses("training.offsets_mismatch", value=[300, 0], expected=[299, 0]):
        SplatOffsets.zeros(torch.tensor([0, 300]), 0).selected(frames[0])
    with refuses("training.offsets_mismatch"):
        SplatOffsets.zeros(KEPT, 1).selected(frames[0])
