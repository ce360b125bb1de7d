"""Gaussians in another world."""

import math
from dataclasses import replace

import torch

from studio.formats.rigid_motion import turned
from studio.gaussians import Gaussians
from studio.similarity import Similarity


def moved(gaussians: Gaussians, similarity: Similarity) -> Gaussians:
    """Splats of the old world in the new one, including their spherical harmonics.

    `similarity.camera` sees of them what the camera sees of `gaussians`.
    """
    if similarity.is_identity:
        return gaussians
    found = turned(gaussians, similarity.rotation)
    translation = torch.from_numpy(similarity.translation).to(found.means)
    return replace(
        found,
        means=found.means * similarity.scale + translation,
        log_scales=found.log_scales + math.log(similarity.scale),
    )
