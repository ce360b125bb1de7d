"""Where the capture cameras' frusta are in the image of the scene."""

from __future__ import annotations

import numpy as np

from gui.drawing.painter import NEAR, frustum
from gui.models.scene.contents import SceneContents
from studio.cameras import Camera


def frusta_places(contents: SceneContents, view: Camera) -> list[tuple[str, np.ndarray]]:
    """Name and (5, 2) pixels of each camera's frustum, those in front last; without those partly behind the viewer."""
    found: list[tuple[float, str, np.ndarray]] = []
    for one in contents.cameras:
        center, corners = frustum(one.camera, contents.length)
        pixels, depth = view.project(np.vstack([center[None], corners]))
        if (depth > NEAR).all():
            found.append((float(depth.mean()), one.camera.name, pixels))
    return [(name, pixels) for _, name, pixels in sorted(found, key=lambda item: -item[0])]
