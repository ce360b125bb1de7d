"""Crops, compositing and clean plates of training views."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from tests.support.splats import round_splats
from v3studio.studio.cameras import Camera
from v3studio.studio.footage import FootageView
from v3studio.studio.training import TrainingView, TrainSettings
from v3studio.studio.training.step import Stepper
from v3studio.studio.training.views import mask_box, over_color

SIZE = 120


def captured(with_plate: bool) -> FootageView:
    """A gray rectangle with half-covered border pixels in front of a bright, noisy wall."""
    rng = np.random.default_rng(0)
    plate = rng.integers(120, 250, (SIZE, SIZE, 3)).astype(np.uint8)
    mask = np.zeros((SIZE, SIZE), np.uint8)
    mask[40:80, 50:70] = 128
    mask[41:79, 51:69] = 255
    alpha = mask[..., None] / 255
    image = np.rint(60 * alpha + plate * (1 - alpha)).astype(np.uint8)
    K = np.array([[100.0, 0, SIZE / 2], [0, 100.0, SIZE / 2], [0, 0, 1]])
    return FootageView(Camera("a", SIZE, SIZE, K, np.eye(4)), image, mask, 0, plate if with_plate else None)


def test_box_is_padded_and_clipped() -> None:
    mask = captured(False).mask
    assert mask_box(mask, 0.1, "a") == (50 - 18, 40 - 20, 20 + 36, 40 + 40)
    full = np.full((30, 20), 255, np.uint8)
    assert mask_box(full, 0.5, "a") == (0, 0, 20, 30)
    with refuses("mask.empty", camera="a"):
        mask_box(np.zeros_like(mask), 0.1, "a")


def test_crop_keeps_where_points_project() -> None:
    view = captured(False)
    cropped = TrainingView.from_view(view, crop_margin=0.1)
    point = np.array([[0.1, 0.2, 2.0]])
    pixel, _ = view.camera.project(point)
    inside, _ = cropped.camera.project(point)
    assert pixel - inside == pytest.approx(np.array([[32.0, 20.0]]))
    assert torch.equal(cropped.image, torch.from_numpy(view.image[20:100, 32:88]).float() / 255)


@pytest.mark.usefixtures("instruction_set")
@pytest.mark.parametrize("size", [(1, 1), (7, 5), (131, 77), (400, 517)])
def test_images_over_a_color(size: tuple[int, int]) -> None:
    generator = torch.Generator().manual_seed(sum(size))
    image, rest = torch.rand(*size, 3, generator=generator), torch.rand(*size, 1, generator=generator)
    color = torch.tensor([0.2, 0.9, 0.4])
    found = over_color(image, rest, color)
    torch.testing.assert_close(found.double(), image.double() + rest.double() * color.double(), rtol=1e-6, atol=1e-7)
    turned = over_color(image.transpose(0, 1), rest.transpose(0, 1), color)
    assert torch.equal(turned, found.transpose(0, 1)), "also of views that are not contiguous"
    exact = over_color(image.double(), rest.double(), color.double())
    assert torch.equal(exact, torch.addcmul(image.double(), rest.double(), color.double()))


def test_truth_drawn_over_the_plate_equals_the_target_even_where_the_mask_is_wrong() -> None:
    source = captured(True)
    truth = torch.from_numpy(source.mask).float()[..., None] / 255
    wrong = source.mask.copy()
    wrong[40:80, 70:73] = 255  # three columns too many
    wrong[40:80, 50:52] = 0  # and two too few
    view = TrainingView.from_view(FootageView(source.camera, source.image, wrong, 0, source.plate))
    color = torch.tensor([0.2, 0.9, 0.4])
    backdrop = view.over(color)[1]
    drawn = 60 / 255 * truth + (1 - truth) * backdrop
    assert torch.allclose(drawn, view.over(color)[0], atol=0.5 / 255 + 1e-6)
    plain = TrainingView.from_view(FootageView(source.camera, source.image, wrong))
    assert (60 / 255 * truth + (1 - truth) * color - plain.over(color)[0]).abs().max() > 0.2


def test_an_estimated_plate_is_used_where_it_is_reliable_at_the_outline() -> None:
    source = captured(True)
    mask = np.zeros_like(source.mask)
    mask[30:90, 40:80] = 255
    reliable = np.full_like(mask, 255)
    reliable[:60] = 0
    estimated = np.dstack([source.plate, reliable])
    view = TrainingView.from_view(FootageView(source.camera, source.image, mask, 0, estimated))
    color = torch.tensor([0.2, 0.9, 0.4])
    target, backdrop = view.over(color)
    plate = torch.from_numpy(source.plate) / 255
    places = ((75, 38, 1, 0), (75, 42, 1, 1), (75, 60, 0, 1), (45, 38, 0, 0), (45, 42, 0, 1))
    for row, column, over_plate, cut in places:
        behind = plate[row, column] if over_plate else color
        assert torch.allclose(backdrop[row, column], behind, atol=1e-6)
        seen = view.image[row, column] if over_plate or cut else color
        assert torch.allclose(target[row, column], seen, atol=1e-6)
    nothing = view.with_mask(torch.zeros_like(view.mask))
    assert torch.allclose(nothing.over(color)[0][75, 60], color), "another mask cuts out less"
    assert torch.equal(nothing.over(color)[0][75, 38], target[75, 38])


@pytest.mark.parametrize("plate", [False, True])
def test_several_steps_are_those_of_single_calls(plate: bool) -> None:
    """Views, backgrounds, losses and gradients are equal to the last bit."""
    views = [TrainingView.from_view(captured(plate)), TrainingView.from_view(captured(plate), crop_margin=0.1)]
    found = []
    for together in (True, False):
        means = torch.tensor([[0.0, 0.0, 2.0], [0.1, 0.2, 2.5]], requires_grad=True)
        two = round_splats(means, -2.0)
        generator = torch.Generator().manual_seed(5)
        stepper = Stepper(views, TrainSettings(alpha_weight=0.1), generator)
        steps = stepper.several(two, 5) if together else [stepper(two) for _ in range(5)]
        torch.stack([step.loss for step in steps]).mean().backward()  # type: ignore[no-untyped-call]
        found.append((steps, means.grad, torch.rand(1, generator=generator)))
    assert [step.view for step in found[0][0]] == [step.view for step in found[1][0]]
    assert all(torch.equal(one.image, other.image) for one, other in zip(found[0][0], found[1][0], strict=True))
    assert len({step.loss.item() for step in found[0][0]}) == 5, "no two steps are alike"
    assert torch.equal(found[0][1], found[1][1])  # type: ignore[arg-type]
    assert torch.equal(found[0][2], found[1][2])


def test_training_does_not_see_hidden_pixels() -> None:
    """The loss does not depend on what the image and the mask show there."""
    view = TrainingView.from_view(captured(False)).with_hidden(0)
    assert 0.1 < float(view.hidden.float().mean()) < 0.15
    spoiled = captured(False)
    hidden = view.hidden.numpy()
    spoiled.image[hidden], spoiled.mask[hidden] = 200, 255

    def gradient(seen: TrainingView) -> torch.Tensor:
        means = torch.tensor([[0.0, 0.0, 2.0]], requires_grad=True)
        stepper = Stepper([seen], TrainSettings(alpha_weight=0.1), torch.Generator().manual_seed(0))
        stepper(round_splats(means, -1.0)).loss.backward()
        return means.grad

    other = TrainingView.from_view(spoiled)
    assert torch.allclose(gradient(view), gradient(other.with_hidden(0)), atol=1e-7)
    assert not torch.allclose(gradient(view), gradient(other), atol=1e-4)


@pytest.mark.parametrize("estimated", [False, True])
def test_where_the_footage_contradicts_the_mask_it_has_no_say(estimated: bool) -> None:
    """The mask lost the lower half of the rectangle, and has a part of the wall."""
    whole = captured(True)
    assert whole.plate is not None
    plate = whole.plate if not estimated else np.dstack([whole.plate, np.full((SIZE, SIZE), 255, np.uint8)])
    mask, doubted = whole.mask.copy(), np.zeros((SIZE, SIZE), bool)
    mask[60:], mask[20:30, 20:30] = 0, 255
    doubted[60:80, 50:70] = doubted[20:30, 20:30] = True
    lost, kept = np.s_[66:76, 54:66], np.s_[22:28, 22:28]
    view = TrainingView.from_view(replace(whole, mask=mask, plate=plate, doubted=doubted))
    blind = TrainingView.from_view(replace(whole, mask=mask, plate=plate))
    image, wall = torch.from_numpy(whole.image).float() / 255, torch.from_numpy(whole.plate).float() / 255
    red = torch.tensor([1.0, 0.0, 0.0])
    target, behind = view.over(red)
    for part in (lost, kept):
        torch.testing.assert_close(target[part], image[part])
        torch.testing.assert_close(behind[part], wall[part])
    assert bool((blind.over(red)[0][lost] == red).all()), "else the lost part has to be empty"
    settings = TrainSettings(alpha_weight=100.0, dssim_weight=0.0)
    empty = round_splats(torch.tensor([[0.0, 0.0, -9.0]]))  # behind the camera
    losses = [float(Stepper([each], settings, torch.Generator().manual_seed(0))(empty).loss) for each in (view, blind)]
    assert losses[1] - losses[0] > 100 * 90 / SIZE**2, "what it kept is not asked for"
    small = TrainingView.from_view(replace(whole, mask=mask, plate=plate, doubted=doubted), crop_margin=0.0)
    assert small.mask.shape == (60 + 32, 50 + 32), "crops have what may be lost"
