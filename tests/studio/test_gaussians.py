"""The dilation of Gaussians: every way of making splats from others keeps it, and no other one is drawn by mistake."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from tests.support.splats import cloud
from v3studio.studio.formats.rigid_motion import placed, turned
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.similarity import Similarity
from v3studio.studio.training import LearningRates
from v3studio.studio.training.offsets import SplatOffsets
from v3studio.studio.training.splat_optimizer import SplatOptimizer


def splats(dilation: float) -> Gaussians:
    return replace(cloud(6, degree=1), dilation=dilation)


def optimized(gaussians: Gaussians) -> Gaussians:
    optimizer = SplatOptimizer(gaussians, LearningRates(), 1.0)
    optimizer.append(gaussians)
    optimizer.keep(torch.arange(3))
    return optimizer.gaussians


WAYS: dict[str, Callable[[Gaussians], Gaussians]] = {
    "index": lambda one: one[2],
    "mask": lambda one: one[torch.arange(6) > 2],
    "to": lambda one: one.to(torch.float64),
    "detach": Gaussians.detach,
    "clone": Gaussians.clone,
    "degree": lambda one: one.with_sh_degree(2),
    "cat": lambda one: Gaussians.cat(one, one),
    "state": lambda one: Gaussians.from_state_dict(one.state_dict()),
    "turned": lambda one: turned(one, np.eye(3)),
    "placed": lambda one: placed(one, Similarity(2.0)),
    "offsets": lambda one: SplatOffsets.zeros(torch.arange(2), 1).applied(one[:2]),
    "optimizer": optimized,
}


@pytest.mark.parametrize("way", WAYS)
def test_splats_made_from_others_keep_their_dilation(way: str) -> None:
    assert WAYS[way](splats(0.07)).dilation == 0.07
    assert WAYS[way](splats(0.3)).dilation == 0.3


def test_the_usual_dilation_is_not_stored() -> None:
    assert "dilation" not in splats(0.3).state_dict()
    stored = splats(0.1).state_dict()
    assert float(stored["dilation"]) == 0.1
    for bad in (torch.tensor([0.1, 0.2]), torch.tensor(0.0), torch.tensor(torch.nan)):
        with refuses("gaussians.dilation"):
            Gaussians.from_state_dict({**stored, "dilation": bad})


def test_one_picture_has_one_dilation() -> None:
    assert Gaussians.cat(splats(0.1), splats(0.1)).dilation == 0.1
    with refuses("gaussians.dilations_differ", value=[0.1, 0.3]):
        Gaussians.cat(splats(0.3), splats(0.1))
