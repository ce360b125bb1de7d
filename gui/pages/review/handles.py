"""Handles to drag with each tool, and what a drag changes; details, balls that training gives more splats."""

import numpy as np

from v3studio.gui.drawing.palette import RGB
from v3studio.gui.models.scene.contents import Lines
from v3studio.gui.models.scene.handles import Handle, crop_handles, ground_handle, moved_crop
from v3studio.gui.pages.review.tools import Tool
from v3studio.pipelines.takes.frames.edited import followed
from v3studio.pipelines.takes.take import Take
from v3studio.studio.cameras import Camera
from v3studio.studio.edits.edit_list import DETAIL_WEIGHT, DetailMark, EditList

DRAGGED = {Tool.CROP: "crop box", Tool.GROUND: "ground plane", Tool.DETAIL: "size of a detail"}
"""The object that a drag with a tool changes."""

SIZE = 0.1  # radius of a new ball, relative to the performer's largest extent: a little more than a head's
_DEEP = 0.6  # how far behind the clicked point the middle of a ball is, in radii
_CIRCLE = 48  # lines of a circle


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


def marked(take: Take, frame: int, means: np.ndarray, point: np.ndarray, eye: np.ndarray) -> DetailMark:
    """A ball around the part of the performer, whose splats are at means (N, 3), at a point that was clicked from an
    eye, both (3,) world. Raises StudioError, see `followed`."""
    # without the few farthest: a stray splat would make the performer large
    extent = float(np.ptp(np.quantile(means, (0.005, 0.995), axis=0), axis=0).max())
    radius = max(SIZE * extent, 1e-6)
    inward = (point - eye) / max(float(np.linalg.norm(point - eye)), 1e-12)
    return followed(take, frame, point + _DEEP * radius * inward, radius, DETAIL_WEIGHT)


def detail_lines(mark: DetailMark, frame: int, eye: np.ndarray, color: RGB) -> Lines:
    """The outline of a ball, as seen from a point."""
    center = mark.at(frame)
    toward = eye - center
    across = np.cross(toward, np.eye(3)[np.abs(toward).argmin()])
    down = np.cross(toward, across)
    turns = np.linspace(0, 2 * np.pi, _CIRCLE + 1)[:, None]
    points = center + mark.radius * (
        np.cos(turns) * across / np.linalg.norm(across) + np.sin(turns) * down / np.linalg.norm(down)
    )
    return Lines.of(np.stack([points[:-1], points[1:]], axis=1), color, 2.0)
