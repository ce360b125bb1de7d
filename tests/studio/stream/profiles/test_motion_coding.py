"""What the profile `motion` codes, as the losses see it, against a baked group and the rasterizer's covariance."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from studio.gaussians import Gaussians
from studio.stream import BakeSettings, bake_group
from studio.stream.attributes import channels
from studio.stream.manifest import MotionRendition
from studio.stream.profiles import MotionCoding, coding_of

MakeFrames = Callable[..., list[Gaussians]]


def covariances(gaussians: Gaussians) -> np.ndarray:
    rotation = Rotation.from_quat(gaussians.unit_quats.detach().double().numpy()[:, [1, 2, 3, 0]]).as_matrix()
    scales = np.exp(gaussians.log_scales.detach().double().numpy())
    return rotation @ (scales[:, :, None] ** 2 * np.swapaxes(rotation, 1, 2))


def test_decoded_splats_are_the_same_gaussians(make_frames: MakeFrames) -> None:
    before, now = make_frames(2, 300, degree=1)
    coding = coding_of("motion", before)
    decoded = coding.decode(now, coding.coded_values(now))
    expected = covariances(now)
    assert np.allclose(covariances(decoded), expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())
    assert torch.allclose(decoded.sh, now.sh, atol=1e-5)
    assert torch.allclose(decoded.opacities, now.opacities, atol=1e-5)
    assert torch.equal(decoded.means, now.means)


def test_values_and_steps_are_those_of_a_baked_keyframe(make_frames: MakeFrames, tmp_path: Path) -> None:
    keyframe = make_frames(1, 300, degree=1)[0]
    entry = bake_group([keyframe], tmp_path, 0, 0, BakeSettings(profile="motion"))
    entry = entry.best
    assert isinstance(entry, MotionRendition)
    coding = MotionCoding(keyframe)
    values = coding.coded_values(keyframe)
    offsets, steps = coding.quantizer(values)
    names = channels(1)[3:]
    assert [channel.name for channel in entry.channels[3:]] == list(names)
    assert values.shape == (300, len(names))
    for column, channel in enumerate(entry.channels[3:]):
        assert steps[column].item() == pytest.approx(channel.step, rel=1e-4), channel.name
        assert offsets[column].item() == pytest.approx(channel.offset, abs=1e-5), channel.name
    assert coding.pixels == entry.tile**2


def test_signs_and_names_of_axes_do_not_count(make_frames: MakeFrames) -> None:
    before, now = make_frames(2, 100)
    negated = Gaussians(now.means, -2 * now.quats, now.log_scales, now.logit_opacities, now.sh)
    coding = MotionCoding(before)
    assert torch.allclose(coding.coded_values(now), coding.coded_values(negated), atol=1e-5)
    # rotations of the coded form stay small: MRP of at most 63 degrees in the frame that the form is chosen on
    assert coding.coded_values(before)[:, :3].norm(dim=1).max() < np.tan(np.radians(63) / 4)


def test_gradients_pass_to_every_attribute(make_frames: MakeFrames) -> None:
    before, now = make_frames(2, 50, degree=1)
    tensors = [now.quats, now.log_scales, now.logit_opacities, now.sh]
    for tensor in tensors:
        tensor.requires_grad_(True)
    coding = MotionCoding(before)
    values = coding.coded_values(now)
    (values * torch.randn_like(values)).sum().backward()
    for tensor in tensors:
        assert tensor.grad is not None
        assert torch.isfinite(tensor.grad).all()
        assert (tensor.grad != 0).any()
