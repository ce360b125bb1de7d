"""Masks refined from the splats, on a ball whose exact masks are known."""

import math

import numpy as np
import pytest
import torch

from tests.studio.training.test_group import HEIGHT, WIDTH, cameras
from tests.support.splats import Checkpoints, same_splats
from v3studio.studio.cameras import Camera
from v3studio.studio.chroma import ChromaSampling, resampled
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.training import LearningRates, TrainingView, TrainSettings, refine, train_keyframe
from v3studio.studio.training.refine import Refinement, chroma_shift, drawn_mask
from v3studio.studio.training.step import Stepper

SETTINGS = TrainSettings(
    keyframe_iterations=150,
    densify_until=0,
    prune_finetune_iterations=100,
    prune_ratio=0.05,
    opacity_reg=0.0,
    refine_masks="auto",
    chroma_siting="auto",
    rates=LearningRates(opacity=0.15, means=2e-4),
)
SAMPLING = ChromaSampling((2, 2), (0.0, 0.5), "left")


@pytest.fixture(autouse=True)
def constants_for_small_images(monkeypatch: pytest.MonkeyPatch) -> None:
    """The images are small, and outlines soft."""
    monkeypatch.setattr(refine, "RAGGED_ABOVE", 8.0)
    monkeypatch.setattr(refine, "REFINE_EVERY", 25)


def sphere(camera: Camera) -> tuple[torch.Tensor, torch.Tensor]:
    """(H, W, 3) colors and (H, W) exact mask of a shaded sphere of radius 0.5, from four by four rays per pixel."""
    steps = (np.arange(4) + 0.5) / 4
    x = (np.arange(WIDTH)[:, None] + steps).ravel()
    y = (np.arange(HEIGHT)[:, None] + steps).ravel()
    rays = np.stack([*np.meshgrid((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy), np.ones((len(y), len(x)))])
    rays = np.tensordot(camera.rotation.T, rays / np.linalg.norm(rays, axis=0), 1)
    along = -np.tensordot(camera.center, rays, 1)
    inside = along**2 - camera.center @ camera.center + 0.5**2
    normals = 2 * (camera.center[:, None, None] + rays * (along - np.sqrt(np.maximum(inside, 0))))
    colors = 0.5 + 0.4 * np.sin(4 * normals + np.array([0.3, 1.1, 2.0])[:, None, None])

    def mean(values: np.ndarray) -> torch.Tensor:
        pixels = values.reshape(*values.shape[:-2], HEIGHT, 4, WIDTH, 4).mean((-3, -1))
        return torch.from_numpy(pixels.astype(np.float32))

    alpha = mean((inside > 0).astype(float))
    return (mean(colors * (inside > 0)) / alpha.clamp_min(1e-3)).permute(1, 2, 0), alpha


def shadowed(plates: bool) -> tuple[list[TrainingView], list[torch.Tensor]]:
    """Views of the sphere in a noisy room, with masks that are wrong in another way in each; and the exact masks."""
    random = torch.Generator().manual_seed(4)
    views, exact = [], []
    for index, camera in enumerate(cameras()):
        plate = 0.3 + 0.4 * torch.rand(HEIGHT, WIDTH, 3, generator=random)
        colors, mask = sphere(camera)
        image = colors * mask[..., None] + plate * (1 - mask[..., None])
        exact.append(mask)
        wrong = torch.nn.functional.avg_pool2d(mask[None, None], 3, 1, 1)[0, 0]  # too soft
        wrong = (wrong + 0.6 * (wrong > 0.02) * torch.rand(mask.shape, generator=random)).clamp(0, 1)  # and ragged
        left = 28 if index % 2 else 22
        wrong[36 : 38 + index % 3, left : left + 12] = 1  # a shadow below it
        views.append(TrainingView(camera, image, wrong, plate if plates else None))
    return views, exact


def errors(masks: list[torch.Tensor], exact: list[torch.Tensor]) -> float:
    return float(torch.stack([(one - other).abs().mean() for one, other in zip(masks, exact, strict=True)]).mean())


def start() -> tuple[torch.Tensor, torch.Tensor]:
    """1500 points on the sphere, and its colors."""
    index = torch.arange(1500) + 0.5
    polar, turn = torch.acos(1 - 2 * index / 1500), math.pi * (1 + 5**0.5) * index
    unit = torch.stack([polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin()], -1)
    return 0.49 * unit, 0.5 + 0.4 * torch.sin(4 * unit + torch.tensor([0.3, 1.1, 2.0]))


@pytest.fixture(scope="module")
def trained() -> Gaussians:
    """Splats that were trained with exact masks."""
    views, exact = shadowed(plates=True)
    views = [view.with_mask(mask) for view, mask in zip(views, exact, strict=True)]
    return train_keyframe(views, *start(), SETTINGS.replace(alpha_weight=1.0, refine_masks="never"))


@pytest.mark.parametrize("plates", [True, False])
def test_refined_masks_are_closer_to_the_truth(plates: bool) -> None:
    views, exact = shadowed(plates)
    given = errors([view.mask for view in views], exact)
    trained = train_keyframe(views, *start(), SETTINGS)
    refined = errors([drawn_mask(trained, view) for view in views], exact)
    assert refined < (0.85 if plates else 0.97) * given


def test_auto_keeps_exact_masks_and_refines_others(trained: Gaussians) -> None:
    views, exact = shadowed(plates=True)
    for masks, refined in ((exact, False), ([view.mask for view in views], True)):
        given = [view.with_mask(mask) for view, mask in zip(views, masks, strict=True)]
        stepper = Stepper(given, SETTINGS, torch.Generator())
        refinement = Refinement(stepper, SETTINGS)
        refinement.begin(trained)
        assert refinement.refined == refined
        found = [view.mask for view in stepper.views]
        assert errors(found, exact) <= errors(masks, exact)
        assert all(torch.equal(one, other) for one, other in zip(found, masks, strict=True)) != refined


def test_an_interrupted_keyframe_continues_to_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.training.settings.CHECKPOINT_EVERY", 5)
    views, _ = shadowed(plates=True)
    settings, kept = SETTINGS.replace(keyframe_iterations=30, prune_finetune_iterations=60, dilation=0.1), Checkpoints()
    whole = train_keyframe(views, *start(), settings, checkpoint=kept)
    for step in (30, 40, 55, 75):  # before, within and after the first masks; in the last part
        again = train_keyframe(views, *start(), settings, resume=kept[step])
        assert same_splats(whole, again)
        assert again.dilation == 0.1
    assert float(kept[75]["refinement.splats.dilation"]) == 0.1


def as_left(images: list[torch.Tensor]) -> list[TrainingView]:
    """Views with these images, decoded as if samples were at the left."""
    views, _ = shadowed(plates=True)
    return [TrainingView(v.camera, image, v.mask, v.plate, SAMPLING) for v, image in zip(views, images, strict=True)]


@pytest.mark.parametrize(("siting", "expected"), [("auto", 0.5), ("left", 0.0), ("center", 0.5), ("none", 0.0)])
def test_siting_is_found_from_the_footage(siting: str, expected: float, trained: Gaussians) -> None:
    """Footage that is decoded as left, and that was made with samples in the middle."""
    views = as_left([resampled(view.image, SAMPLING, 0.5) for view in shadowed(plates=True)[0]])
    assert chroma_shift(trained, views, siting) == expected


@pytest.mark.parametrize(("keyframe_off", "refined"), [(None, True), (60.0, True), (0.0, False)])
def test_a_group_does_what_its_keyframe_showed(keyframe_off: float | None, refined: bool, trained: Gaussians) -> None:
    """None: the keyframe itself, whose masks are ragged."""
    views = as_left([view.image for view in shadowed(plates=True)[0]])
    stepper = Stepper(views, SETTINGS, torch.Generator())
    Refinement(stepper, SETTINGS, keyframe_off).begin(trained)
    assert (stepper.views is not views) == refined
    assert (stepper.chroma_shift is not None) == refined
