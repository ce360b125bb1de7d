"""Colors of what no camera sees, on a ball with one camera on one side, and through joint training."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.studio.training.test_group import ball, cameras, views_of
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.training import TrainSettings, joint, train_jointly
from v3studio.studio.training.unseen import cameras_that_see, settled_colors

SETTINGS = TrainSettings(joint_iterations=2)
MARK = torch.tensor([3.0, -3.0, -3.0])


def closed_ball(offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Gaussians:
    """A ball without gaps between its splats."""
    made = ball(torch.tensor(offset))
    return replace(made, log_scales=made.log_scales + 0.7)


def inner(gaussians: Gaussians) -> Gaussians:
    """The splats and a marked one in the middle, which the others hide."""
    middle = gaussians[:1]
    middle = replace(middle, means=torch.zeros(1, 3), log_scales=torch.full((1, 3), -4.0), sh=MARK.reshape(1, 1, 3))
    return Gaussians.cat(gaussians, middle)


def test_a_camera_counts_as_far_as_it_sees_a_splat() -> None:
    one, other = (cameras()[number].scaled(10.0) for number in (0, 4))
    surface = closed_ball()
    gaussians = inner(surface)
    found = cameras_that_see(gaussians, [one])
    for number in (5, 60, 123, 222, 299):
        alone = gaussians[number : number + 1]
        black = replace(gaussians, sh=torch.full_like(gaussians.sh, -0.5 / 0.28209479))
        black.sh[number] = 0.5 / 0.28209479
        with torch.no_grad():
            lit, whole = float(rasterize(black, one).image[..., 0].sum()), float(rasterize(alone, one).alpha.sum())
        assert found[number] == pytest.approx(lit / whole, abs=0.03)
    toward = surface.means.numpy() @ one.center / 1.5
    assert found[:-1][toward > 0.9].min() > 0.3, "the front"
    assert found[:-1][toward < -0.5].max() < 0.01, "the back"
    assert found[-1] < 0.01, "the middle"
    assert cameras_that_see(gaussians, [one, other]) == pytest.approx(found + cameras_that_see(gaussians, [other]))


def test_only_what_is_not_seen_gets_the_colors_around_it() -> None:
    one = cameras()[0].scaled(10.0)
    gaussians = closed_ball()
    gaussians.sh[:] = torch.tensor([1.0, 0.5, -0.5])
    toward = gaussians.means @ torch.from_numpy(one.center).float() / 1.5
    back, front = toward < -0.5, toward > 0.9
    spotted = replace(gaussians, sh=gaussians.sh.clone())
    spotted.sh[back & (gaussians.means[:, 1] > 0)] = MARK
    spotted.sh[front] = -MARK
    found = settled_colors(spotted, [one])
    assert torch.allclose(found[back], gaussians.sh[back], atol=0.1), "the spot on the back is gone"
    assert torch.allclose(found[front], spotted.sh[front], atol=0.3), "the other one is still there"


def test_joint_training_settles_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint, "_LEFT_OUT", 0)
    moved = [closed_ball(), closed_ball((0.02, 0.0, 0.0))]
    trained = train_jointly([inner(one) for one in moved], [views_of(one) for one in moved], SETTINGS)
    assert all(torch.equal(frame.sh, trained[0].sh) for frame in trained)
    assert np.abs(trained[0].sh[-1, 0].numpy() - MARK.numpy()).min() > 1
