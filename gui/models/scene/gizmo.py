"""The view axes in a corner of the scene: they turn with the view, and a click on an end looks along that axis."""

import math
from dataclasses import replace

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, text_width
from v3studio.gui.drawing.palette import AXES, GROUND, RGB
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.studio.cameras import Camera

SIZE = 2.6  # length of an axis, em

NAMES = ("x", "y", "z")


def draw_gizmo(canvas: Canvas, view: Camera, em: float) -> list[tuple[str, np.ndarray]]:
    """Draw the axes in the upper right corner; names ("+x") and corners (4, 2) of the ends, front ones last."""
    middle = np.array([canvas.width - 4.2 * em, 4.2 * em])
    places: list[tuple[str, np.ndarray]] = []
    ends = [(axis, sign, sign * view.rotation[:, axis]) for axis in range(3) for sign in (1, -1)]
    small = round(0.8 * em)
    for axis, sign, direction in sorted(ends, key=lambda end: -end[2][2]):
        x, y = middle + SIZE * em * direction[:2]
        color: RGB = AXES[axis]
        if sign > 0:
            canvas.line([tuple(middle), (x, y)], color, 2)
            canvas.dot(x, y, 0.62 * em, color)
            canvas.text(x - text_width(NAMES[axis], small) / 2, y - 0.58 * em, NAMES[axis], small, GROUND)
        else:
            dim = tuple(round(0.45 * channel + 0.55 * ground) for channel, ground in zip(color, GROUND, strict=True))
            canvas.dot(x, y, 0.42 * em, (dim[0], dim[1], dim[2]))
        half = 0.7 * em
        name = f"{'+' if sign > 0 else '-'}{NAMES[axis]}"
        places.append((name, np.array([x, y]) + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])))
    return places


def along(orbit: OrbitCamera, name: str) -> OrbitCamera:
    """The view from the end of an axis of the world, such as "+x", at the same distance from the same target."""
    direction = np.zeros(3)
    direction[NAMES.index(name[1])] = 1.0 if name[0] == "+" else -1.0
    if abs(direction @ orbit.up) > math.cos(math.radians(1.0)):
        # from straight above or below the yaw would be lost
        away = math.copysign(math.radians(89.0), float(direction @ orbit.up))
        return replace(orbit, pitch=away)
    return OrbitCamera.from_to(orbit.target + orbit.distance * direction, orbit.target, orbit.up, orbit.fov)
