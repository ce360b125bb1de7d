"""A take's own frame: where its cameras are moved and scaled to, so that float32, the near plane and learning rates do
not depend on where a surveyor put zero, or on the unit.

Cameras whose distance from the origin and whose size are ordinary stay as they are. Others are moved by their middle,
or scaled to the size of walk16, the capture for which the defaults of the settings were measured. The frame follows
from the cameras alone, so it need not be stored.

Imported splats have no cameras, and are treated alike by their own middle and radius.
"""

import numpy as np

from v3studio.studio.cameras import Rig
from v3studio.studio.similarity import Similarity

_LEAST, _MOST = 0.5, 32.0  # radius of a rig that is not scaled, in its units
_USUAL = 3.3259015  # radius of one that is: walk16's, in meters
_SPLATS_LEAST, _SPLATS_MOST, _SPLATS_USUAL = 0.03, 300.0, 1.0  # the same for splats: a person, or a scene around one
_FARTHEST = 64.0  # distance of the middle from the origin, in radii; float32 then has 18 bits for a radius


def own_frame(rig: Rig) -> Similarity:
    """The transform from the cameras' world to the take's own frame: the identity for ordinary places and sizes. With
    a single camera, or all in one place, nothing says how large the scene is, and it is only moved."""
    centers = rig.centers
    middle = centers.mean(axis=0)
    radius = float(np.linalg.norm(centers - middle, axis=1).max())
    return _frame(middle, radius, _LEAST, _MOST, _USUAL)


def splats_frame(middle: np.ndarray, radius: float) -> Similarity:
    """The frame of splats, chosen as `own_frame` does, from their (3,) middle and the radius around it within which
    nearly all of them are."""
    return _frame(middle, radius, _SPLATS_LEAST, _SPLATS_MOST, _SPLATS_USUAL)


def _frame(middle: np.ndarray, radius: float, least: float, most: float, usual: float) -> Similarity:
    scale = 1.0 if least <= radius <= most or radius == 0 else usual / radius
    far = np.linalg.norm(middle) > _FARTHEST * (radius or usual)
    return Similarity(scale, translation=-scale * middle if far else np.zeros(3))


def in_own_frame(rig: Rig) -> Rig:
    """The cameras in the take's own frame; the same object if that is their world."""
    frame = own_frame(rig)
    return rig if frame.is_identity else frame.rig(rig)


def undone(frame: Similarity, *, placed: bool) -> Similarity:
    """The transform from the world of a take's streams to the user's own, which exports apply. `frame`: from
    `own_frame`; `placed`: an edit has placed the world's origin, so only the unit is undone."""
    return Similarity(1 / frame.scale) if placed else frame.inverse


def frame_sentence(frame: Similarity, whose: str = "take", of: str = "cameras") -> str | None:
    """A sentence on the frame, for logs and checks; None: it does nothing. Nouns: `whose` has it, `of` (plural) are far
    away."""
    if frame.is_identity:
        return None
    x, y, z = frame.inverse.translation
    moved = f"zero is at ({x:.6g}, {y:.6g}, {z:.6g}) of the {of}' world" if frame.translation.any() else ""
    scaled = f"one unit of that world is {frame.scale:g} units" if frame.scale != 1 else ""
    what = ", and ".join(part for part in (moved, scaled) if part)
    why = f"the {of} are far from zero, very large or very small"
    return f"The {whose} has a frame of its own, because {why}: {what}. Exports undo it."
