"""Splats that are too faint to be drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from studio.gaussians import Gaussians
from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.encode.paths import carry_hidden_splats


def test_hidden_splats_take_the_motion_of_their_surroundings() -> None:
    generator = np.random.default_rng(1)
    keyframe = generator.uniform(-1, 1, (300, 3))
    left = keyframe[:, 0] < 0
    shift = np.where(left[:, None], (0.0, 0.3, 0.0), (0.1, 0.0, 0.0))
    positions = np.stack([keyframe, keyframe + shift, keyframe + 2 * shift])
    opacities = np.full((3, 300), 0.2)
    lost = np.flatnonzero(np.abs(keyframe[:, 0]) > 0.5)[:20]
    positions[1:, lost] += 7.0
    opacities[1:, lost] = 0.0025
    carried = carry_hidden_splats(positions, opacities)
    np.testing.assert_allclose(carried, [keyframe, keyframe + shift, keyframe + 2 * shift], atol=1e-12)
    seen = opacities >= 1 / 255
    np.testing.assert_array_equal(carried[seen], positions[seen])


def test_without_hidden_splats_nothing_changes() -> None:
    positions = np.random.default_rng(2).normal(size=(3, 50, 3))
    assert carry_hidden_splats(positions, np.full((3, 50), 1 / 255)) is positions
    assert carry_hidden_splats(positions, np.zeros((3, 50))) is positions, "there is nothing to move with"


def test_a_stream_does_not_show_splats_that_have_strayed_unseen(tmp_path: Path) -> None:
    generator = torch.Generator().manual_seed(3)
    means = torch.rand(400, 3, generator=generator)
    quats, scales = torch.tensor([[1.0, 0, 0, 0]]).repeat(400, 1), torch.full((400, 3), 0.02)
    frames = []
    for frame in range(4):
        moved, opacities = means + frame * torch.tensor([0.05, 0, 0]), torch.full((400,), 0.3)
        if frame:
            moved[:9] += 3.0 * frame
            opacities[:9] = 0.0025
        frames.append(Gaussians.from_activated(moved, quats, scales, opacities, torch.zeros(400, 1, 3)))
    settings = BakeSettings(quality=30, preset="ultrafast")
    entry = bake_group(frames, tmp_path, 0, 0, settings, fps=10.0)
    write_manifest(tmp_path, [entry], 10.0, settings)
    with StreamReader.open(tmp_path, threads=1) as reader:
        assert max(reader.manifest.bounding_box.max) < 1.3
        for frame in range(4):
            assert float(reader.gaussians(frame).means.max()) < 1.3
