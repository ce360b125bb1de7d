"""What can be dragged with each tool, and what a drag changes."""

import numpy as np

from v3studio.gui.models.scene.handles import Handle, crop_handles, ground_handle, moved_crop
from v3studio.gui.pages.review.tools import Tool
from v3studio.studio.cameras import Camera
from v3studio.studio.edits.edit_list import EditList

DRAGGED = {Tool.CROP: "crop box", Tool.GROUND: "ground plane", Tool.DETAIL: "size of a detail"}
"""What a drag with a tool changes."""


def tool_handles(
    tool: Tool, edits: EditList, view: Camera, seen: np.ndarray, number: int, up: np.ndarray
) -> list[Handle]:
    """The handles of a tool, in the frame of a number. `seen`: (N, 3) splats; `up`: (3,); both world."""
    if tool == Tool.CROP and edits.crop is not None:
        handles = crop_handles(edits.crop)
    elif tool == Tool.GROUND and edits.ground is not None and len(seen):
        return [ground_handle(edits.ground, np.median(seen, axis=0))]
    elif tool == Tool.DETAIL:
        handles = [
            Handle(f"detail {index}", mark.at(number) + mark.radius * up, up)
            for index, mark in enumerate(edits.details)
        ]
    else:
        return []
    return [handle for handle in handles if handle.movable(view)]


def dragged(edits: EditList, handle: Handle, distance: float) -> EditList:
    """The edits with a handle moved by a distance, world units."""
    if handle.name == "ground" and edits.ground is not None:
        ground = edits.ground.model_copy(update={"height": edits.ground.height + distance})
        return edits.with_(ground=ground)
    if handle.name.startswith("detail"):
        index = int(handle.name.split()[1])
        mark = edits.details[index]
        radius = max(mark.radius + distance, 0.1 * mark.radius)
        resized = mark.model_copy(update={"radius": radius})
        return edits.with_(details=(*edits.details[:index], resized, *edits.details[index + 1 :]))
    return edits if edits.crop is None else edits.with_(crop=moved_crop(edits.crop, handle, distance))
