"""Every setting of training changes something: none is read by nobody."""

import functools
import hashlib
from typing import Any

import numpy as np
import pytest
import torch

from tests.studio.training.test_group import SHIFT, ball, cameras, noisy_points
from tests.support.splats import same_splats
from v3studio.studio.chroma import ChromaSampling
from v3studio.studio.footage import FootageView
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.settings import affected
from v3studio.studio.similarity import Similarity
from v3studio.studio.training import (
    Correction,
    LearningRates,
    TrainingView,
    TrainSettings,
    train_interframe,
    train_jointly,
    train_keyframe,
)

BASE: dict[str, Any] = {
    "keyframe_iterations": 12,
    "densify_from": 1,
    "densify_until": 11,
    "densify_every": 5,
    "densify_max_splats": 340,
    "prune_finetune_iterations": 4,
    "prune_ratio": 0.2,
    "max_splats": 5000,
    "sh_degree": 1,
    "sh_degree_every": 4,
    "motion_iterations": 3,
    "motion_views": 2,
    "finetune_iterations": 4,
    "hash_levels": 3,
    "mlp_width": 16,
}

CHANGES: dict[str, Any] = {
    "sh_degree": 0,
    "dssim_weight": 0.5,
    "alpha_weight": 0.3,
    "opacity_reg": 0.1,
    "scale_reg": 1.0,
    "background": "white",
    "dropout": 0.4,
    "dilation": 0.1,
    "refine_masks": "always",
    "chroma_siting": "center",
    "keyframe_iterations": 13,
    "densify_from": 7,
    "densify_until": 4,
    "densify_every": 3,
    "densify_max_splats": 301,
    "sh_degree_every": 6,
    "prune_by": "contribution",
    "prune_ratio": 0.4,
    "max_splats": 150,
    "prune_finetune_iterations": 5,
    "motion_iterations": 5,
    "motion_first_iterations": 6,
    "motion_learning_rate": 1e-2,
    "motion_views": 3,
    "hash_levels": 4,
    "mlp_width": 32,
    "mlp_layers": 3,
    "finetune_iterations": 6,
    "finetune_means": True,
    "entropy_weight": 1.0,
    "temporal_weight": 1.0,
    "rates.means": 1e-3,
    "rates.sh_dc": 1e-2,
    "rates.sh_rest": 1e-2,
    "rates.opacity": 0.1,
    "rates.scale": 0.05,
    "rates.rotation": 0.05,
}
"""Another value of each setting, which changes the trained splats."""


def settings(**changes: Any) -> TrainSettings:
    rates = {name.partition(".")[2]: value for name, value in changes.items() if name.startswith("rates.")}
    plain = {name: value for name, value in changes.items() if "." not in name}
    return TrainSettings(**{**BASE, **plain}, rates=LearningRates(**rates))


@functools.cache
def views(shift: float) -> tuple[TrainingView, ...]:
    """The ball in three frames, at half the size, with subsampled chroma and masks that are a bit too wide."""
    made = []
    truth = ball(shift * SHIFT)
    for camera in (one.scaled(0.5) for one in cameras()[:4]):
        render = rasterize(truth, camera)
        image = (render.image / render.alpha[..., None].clamp_min(1e-3)).clamp(0, 1)
        wide = torch.nn.functional.max_pool2d(render.alpha[None, None], 3, 1, 1)[0, 0].clamp(0, 1)
        made.append(TrainingView(camera, image, wide, chroma=ChromaSampling((2, 2), (0.0, 0.5))))
    return tuple(made)


def points() -> tuple[torch.Tensor, torch.Tensor]:
    return noisy_points(), torch.full((300, 3), 0.5)


@functools.cache
def keyframe(chosen: TrainSettings) -> Gaussians:
    return train_keyframe(views(0), *points(), chosen, seed=1)


@functools.cache
def later(chosen: TrainSettings) -> str:
    """Digest of the two frames after a keyframe."""
    first = keyframe(chosen)
    second = train_interframe(first, views(1), chosen, seed=2)
    third = train_interframe(second, views(2), chosen, before_previous=first, seed=3)
    values = [value.contiguous().numpy().tobytes() for frame in (second, third) for _, value in frame.items()]
    return hashlib.sha256(b"".join(values)).hexdigest()


def _acceleration() -> bool:
    frames = [ball(place * SHIFT) for place in (0, 1, 3)]
    earlier = {"before_previous": frames[1], "third_last": frames[0]}
    chosen = [settings(motion_acceleration=one) for one in (0.0, 0.5)]
    found = [train_interframe(frames[2], views(3), one, seed=1, **earlier) for one in chosen]
    return not same_splats(*found)


def captured() -> FootageView:
    camera = cameras()[0]
    render = rasterize(ball(torch.zeros(3)), camera)
    image, mask = ((255 * one).clamp(0, 255).to(torch.uint8).numpy() for one in (render.image, render.alpha))
    return FootageView(camera, image, mask, plate=np.full_like(image, 90))


def _joint() -> bool:
    frames = [ball(place * SHIFT) for place in (0, 1)]
    seen = [views(place) for place in (0, 1)]
    found = [train_jointly(frames, seen, settings(joint_iterations=one), seed=1)[0] for one in (1, 2)]
    return not same_splats(*found)


def _crop() -> bool:
    seen = [TrainingView.from_view(captured(), crop_margin=settings(crop_margin=one).crop_margin) for one in (0.0, 0.3)]
    return seen[0].image.shape != seen[1].image.shape


def _plates() -> bool:
    seen = [TrainingView.from_view(captured(), use_plate=settings(use_plates=one).use_plates) for one in (True, False)]
    return not torch.equal(seen[0].over(torch.zeros(3))[0], seen[1].over(torch.zeros(3))[0])


def _camera_colors() -> bool:
    """In a take: `tests/pipelines/stages/test_camera_colors.py`. Here, that a step sees the colors of its camera."""
    darker = [view.with_color(0.8 * torch.eye(3, 4)) for view in views(0)]
    return not same_splats(keyframe(settings()), train_keyframe(darker, *points(), settings(), seed=1))


def _refined_cameras() -> bool:
    """In a take: `tests/pipelines/stages/test_camera_refinement.py`. Here, that refined cameras see something else."""
    correction = Correction(Similarity(), np.array([2.0, 0.0]), 0.0, 0.0)
    moved = [TrainingView(correction.of(one.camera), one.image, one.mask) for one in views(0)]
    return not same_splats(keyframe(settings()), train_keyframe(moved, *points(), settings(), seed=1))


OTHERWISE = {
    "motion_acceleration": _acceleration,
    "joint_iterations": _joint,
    "crop_margin": _crop,
    "use_plates": _plates,
    "camera_colors": _camera_colors,
    "refine_cameras": _refined_cameras,
}
"""Settings with another observable: whether it changes."""


def test_all_frames_keep_the_dilation_that_they_were_trained_with() -> None:
    chosen = settings(dilation=0.1)
    first = keyframe(chosen)
    second = train_interframe(first, views(1), chosen, seed=2)
    assert (first.dilation, second.dilation) == (0.1, 0.1)


def test_there_is_a_row_for_every_setting() -> None:
    assert set(CHANGES) | set(OTHERWISE) == set(affected(TrainSettings))
    assert not set(CHANGES) & set(OTHERWISE)


@pytest.mark.parametrize("name", CHANGES)
def test_the_setting_changes_the_splats(name: str) -> None:
    before, after = settings(), settings(**{name: CHANGES[name]})
    if same_splats(keyframe(before), keyframe(after)):
        assert later(before) != later(after)


@pytest.mark.parametrize("name", sorted(OTHERWISE))
def test_the_setting_changes_something_else(name: str) -> None:
    assert OTHERWISE[name]()
