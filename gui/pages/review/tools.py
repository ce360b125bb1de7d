"""The tools of the edits: their buttons, what they say, and the limits that are proposed for floaters."""

from dataclasses import dataclass

from v3studio.gui.pages.choices import Button, Choice
from v3studio.pipelines.takes.authored.edits import limit_words
from v3studio.studio.counts import counted
from v3studio.studio.edits.edit_list import Floaters


class Tool(Button):
    """The tools by which the mouse changes the edits."""

    ORBIT = "orbit", "Drags turn the view"
    CROP = "crop", "Drag the faces of a box; splats outside are removed", "Drag the dots on the faces."
    GROUND = "ground", "Drag a plane up or down; splats below are removed", "Drag the dot up or down."
    FLOATERS = "floaters", "Select small clusters and faint splats; the histogram and Numbers set the limits"
    LASSO = "lasso", "Draw around splats to select them; right drags pan", "Draw around what should go."
    BRUSH = (
        "brush",
        "Paint over splats to select them; right drags pan",
        "Paint what should go; - and + set the size.",
    )
    ORIGIN = "origin", "Click the point that becomes the origin", "Click the new origin."
    UP = "up", "Click a point, then one straight above it: up becomes +y", "Click a point, then one straight above it."
    SCALE = "scale", "Click two points, and say how far apart they are", "Click two points whose distance you know."
    DETAIL = (
        "detail",
        "Click a face or a hand: training gives it more splats",
        "Click a face or a hand; drag its dot.",
    )


def _buttons(*tools: Tool) -> tuple[Choice, ...]:
    """The buttons of tools, after a gap."""
    return (("", "", ""), *((tool, tool.capitalize(), tool.tooltip) for tool in tools))


EDIT_CHOICES: tuple[Choice, ...] = (
    ("done", "Done", "Leave the edits and show the take again"),
    ("", "", ""),
    ("in", "Trim in", "In point: the first frame to keep is this one"),
    ("out", "Trim out", "Out point: the last frame to keep is this one"),
    *_buttons(Tool.ORBIT, Tool.CROP, Tool.GROUND, Tool.FLOATERS, Tool.LASSO, Tool.BRUSH),
    ("", "", ""),
    ("remove", "Remove", "Remove what is selected"),
    *_buttons(Tool.ORIGIN, Tool.UP, Tool.SCALE),
    *_buttons(Tool.DETAIL),
    ("", "", ""),
    ("numbers", "Numbers", "Set the crop box, ground, floaters, world or a detail in numbers"),
    ("list", "List", "List the edits, and take some back"),
    ("removed", "Removed", "Draw what is removed in red"),
)
DRAWS = (Tool.LASSO, Tool.BRUSH)  # tools that select by drawing on the image
PLACES = (Tool.ORIGIN, Tool.UP, Tool.SCALE)  # tools that place the world
PICKS = (*PLACES, Tool.DETAIL)  # tools that are used by clicking on the performer
BRUSH = 0.03  # radius of the brush at first, relative to the height of the image
LEAST_BRUSH, MOST_BRUSH = 0.002, 0.5  # limits of it
BRUSH_STEP = 1.25  # what a key press multiplies or divides it by

FLOATERS = (Floaters(opacity=0.02, share=0.005), Floaters(opacity=0.05, share=0.01), Floaters(opacity=0.1, share=0.02))
"""Limits to propose, from careful to bold: the first that select anything."""


@dataclass(frozen=True)
class Stroke:
    """A line that is being drawn, in pixels of the image. `points`: (x, y). `radius`: of the brush; None: a lasso."""

    points: tuple[tuple[float, float], ...]
    radius: float | None


def hint(tool: Tool, selected: int | None, back: int, floaters: Floaters | None, in_use: bool) -> str:
    """The next step, in words; "" if there is nothing to say. Numbers of splats in the group: `selected`, None if
    nothing was tried; `back`: no longer removed. `in_use`: these limits are among the take's edits already."""
    words = tool.hint
    if selected is None:
        return words
    says = f"{counted(selected, 'splat') if selected else 'No splats'} selected"
    if tool == Tool.FLOATERS:
        limits = "no limits" if floaters is None else ", ".join(limit_words(floaters))
        if in_use:
            return f"Removed already: {limits}. Change the limits with Numbers."
        more = f", {back:,} no longer removed" if back else ""
        return f"{says}{more}: {limits}. Press Remove, or change the limits with Numbers."
    return f"{says}. Press Remove. {words}" if selected else f"{says}. {words}"
