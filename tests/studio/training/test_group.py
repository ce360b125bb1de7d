"""Keyframe, motion and fine-tuning on a textured ball with known motion."""

import math
from dataclasses import replace

import pytest
import torch

from tests.support.errors import cancel_at, refuses
from tests.support.rigs import camera_at
from tests.support.settings import refuses_setting
from tests.support.splats import Checkpoints, round_splats, same_splats
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import Cancelled
from v3studio.studio.gaussians import SH_C0, Gaussians
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.training import TrainingView, TrainSettings, train_interframe, train_keyframe

WIDTH, HEIGHT = 64, 48
SHIFT = torch.tensor([0.06, -0.03, 0.02])
SETTINGS = TrainSettings(
    keyframe_iterations=60,
    densify_from=1000,
    densify_until=0,
    prune_finetune_iterations=10,
    motion_iterations=60,
    finetune_iterations=20,
    hash_levels=6,
    max_splats=1000,
)


def cameras() -> list[Camera]:
    """Eight cameras on two rings that look at the origin from a distance of 3."""
    made = []
    for index in range(8):
        angle, height = index * math.pi / 4, 0.8 if index % 2 else -0.8
        eye = (3 * math.cos(angle), height, 3 * math.sin(angle))
        made.append(camera_at(f"cam{index}", eye, focal=75.0, size=(WIDTH, HEIGHT), up=(0.0, 1.0, 0.0)))
    return made


def ball(offset: torch.Tensor) -> Gaussians:
    """300 opaque splats on a sphere of radius 0.5, with a checkered texture that moves with it."""
    index = torch.arange(300) + 0.5
    polar, turn = torch.acos(1 - 2 * index / 300), math.pi * (1 + 5**0.5) * index
    unit = torch.stack([polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin()], -1)
    colors = 0.5 + 0.45 * torch.sign(torch.sin(7 * unit + torch.tensor([0.3, 1.1, 2.0])))
    splats = round_splats(0.5 * unit + offset, math.log(0.035))
    return replace(splats, logit_opacities=torch.full((300,), 5.0), sh=((colors - 0.5) / 0.28209479)[:, None])


def noisy_points() -> torch.Tensor:
    """The means of the ball with noise."""
    return ball(torch.zeros(3)).means + 0.02 * torch.randn(300, 3, generator=torch.Generator().manual_seed(0))


def views(offset: torch.Tensor) -> list[TrainingView]:
    return views_of(ball(offset))


def views_of(gaussians: Gaussians) -> list[TrainingView]:
    made = []
    for camera in cameras():
        with torch.no_grad():
            render = rasterize(gaussians, camera)
        alpha = render.alpha.clamp(0, 1)
        image = render.image / alpha[..., None].clamp_min(1e-3)
        made.append(TrainingView(camera, image.clamp(0, 1), alpha))
    return made


@pytest.fixture(scope="module")
def before() -> list[TrainingView]:
    return views(torch.zeros(3))


@pytest.fixture(scope="module")
def after() -> list[TrainingView]:
    return views(SHIFT)


def loss_of(gaussians: Gaussians, seen: list[TrainingView]) -> float:
    black = torch.zeros(3)
    with torch.no_grad():
        errors = [(rasterize(gaussians, view.camera, black).image - view.over(black)[0]).abs().mean() for view in seen]
    return float(torch.stack(errors).mean())


def test_motion_follows_the_surface(after: list[TrainingView]) -> None:
    truth = ball(torch.zeros(3))
    warped = train_interframe(truth, after, SETTINGS.replace(finetune_iterations=0), seed=3)
    moved = warped.means - truth.means
    error = (moved - SHIFT).norm(dim=-1)
    assert float(error.mean()) < float(SHIFT.norm()) / 3
    assert loss_of(warped, after) < 0.5 * loss_of(truth, after)
    tuned = train_interframe(truth, after, SETTINGS, seed=3)
    assert len(tuned) == len(truth), "the number of splats is constant within a group"
    assert torch.equal(tuned.means, warped.means), "fine-tuning does not change the means"


def test_the_frame_after_the_keyframe_has_its_own_number_of_steps(after: list[TrainingView]) -> None:
    settings = SETTINGS.replace(motion_iterations=3, motion_first_iterations=9)

    def phases(older: Gaussians | None) -> tuple[int, int]:
        seen = []
        told = lambda done, total, **figures: seen.append((figures["phase"], total))  # noqa: E731
        train_interframe(ball(torch.zeros(3)), after, settings, before_previous=older, progress=told)
        assert {total for _, total in seen} == {len(seen)}
        return sum(phase == "motion" for phase, _ in seen), len(seen)

    assert phases(None) == (9, 9 + settings.finetune_iterations)
    assert phases(ball(-SHIFT)) == (3, 3 + settings.finetune_iterations)


def test_keyframe_reconstructs_the_ball_within_the_splat_limit(before: list[TrainingView]) -> None:
    truth = ball(torch.zeros(3))
    settings = SETTINGS.replace(keyframe_iterations=150, max_splats=180)
    steps = []
    told = lambda done, total, **_: steps.append((done, total))  # noqa: E731
    colors = 0.5 + 0.7 * SH_C0 * truth.sh[:, 0]
    trained = train_keyframe(before, noisy_points(), colors, settings, seed=1, progress=told)
    assert len(trained) == 180, "the second round only removes what is too many"
    assert loss_of(trained, before) < 0.5 * loss_of(truth[:1], before)
    assert [done for done, _ in steps] == list(range(1, steps[-1][0] + 1))
    assert steps[-1][0] == steps[-1][1] == 170


def test_same_seed_same_bits(after: list[TrainingView]) -> None:
    truth = ball(torch.zeros(3))
    settings = SETTINGS.replace(motion_iterations=5, finetune_iterations=5)
    one, two, other = (train_interframe(truth, after, settings, seed=seed) for seed in (7, 7, 8))
    assert same_splats(one, two)
    assert not torch.equal(one.means, other.means)


def test_cancel_passes_through(after: list[TrainingView]) -> None:
    with pytest.raises(Cancelled):
        train_interframe(ball(torch.zeros(3)), after, SETTINGS, progress=cancel_at(3))


def test_invalid_input(before: list[TrainingView]) -> None:
    with refuses("training.too_few_points", value=2):
        train_keyframe(before, torch.zeros(2, 3), torch.zeros(2, 3), SETTINGS)
    with refuses("training.points_not_finite", value=9):
        train_keyframe(before, torch.full((9, 3), float("nan")), torch.zeros(9, 3), SETTINGS)
    with refuses("training.no_views", setting="capture.held_out"):
        train_keyframe([], torch.rand(9, 3), torch.zeros(9, 3), SETTINGS)
    with refuses_setting("sh_degree"):
        TrainSettings(sh_degree=7)


def test_a_keyframe_resumes_bit_for_bit(before: list[TrainingView], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.training.densify.RESET_EVERY", 8)
    monkeypatch.setattr("v3studio.studio.training.settings.CHECKPOINT_EVERY", 1)
    points, colors, kept = noisy_points(), torch.full((300, 3), 0.5), Checkpoints()
    chosen = {"keyframe_iterations": 20, "densify_from": 3, "densify_until": 16, "densify_every": 5, "max_splats": 200}
    chosen |= {"densify_max_splats": 400, "prune_finetune_iterations": 4, "sh_degree": 1, "sh_degree_every": 6}
    settings = SETTINGS.replace(**chosen)
    unbroken = train_keyframe(before, points, colors, settings, seed=5, checkpoint=kept)
    assert max(kept) == 20 + 4 * int(kept[20]["rounds"])
    for step in (4, 12, 20, 23, 24, max(kept)):
        resumed = train_keyframe(before, points, colors, settings, seed=5, resume=kept[step])
        assert same_splats(unbroken, resumed), step
    with refuses("training.checkpoint_incomplete", value="rounds"):
        train_keyframe(before, points, colors, settings, resume={"done": torch.tensor(3)})
