"""What each profile codes per splat and with which steps: the one definition for the baker and the training losses."""

from __future__ import annotations

from studio.gaussians import Gaussians
from studio.stream.profiles.coding import SplatCoding
from studio.stream.profiles.motion import MotionCoding
from studio.stream.profiles.planes import PlanesCoding

CODINGS: dict[str, type[SplatCoding]] = {"planes": PlanesCoding, "motion": MotionCoding}


def coding_of(profile: str, previous: Gaussians) -> SplatCoding:
    """The coding of a profile, "planes" or "motion", for the frame that follows `previous`."""
    return CODINGS[profile](previous)


__all__ = ["CODINGS", "MotionCoding", "PlanesCoding", "SplatCoding", "coding_of"]
