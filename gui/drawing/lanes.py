"""Draws the groups of a run on several machines as lanes: where each is, how far, and how well."""

from collections import Counter
from collections.abc import Collection
from itertools import pairwise

from v3studio.gui.drawing.canvas import Canvas, line_height
from v3studio.gui.drawing.palette import DIM, RAISED, STATE_COLORS, TEXT
from v3studio.pipelines.events import GroupState

_ORDER = ("failed", "running", "retried", "done", "queued")
"""From top to bottom: of many groups, those that have something to tell are seen."""

_HEADS = ("group", "state", "node", "frames", "PSNR", "s/frame")
_COLUMNS = (0.0, 0.12, 0.32, 0.54, 0.72, 0.85, 1.0)
"""Left edges of the columns and the right edge of the last, as shares of the width."""


def draw_lanes(
    canvas: Canvas, area: tuple[float, float, float, float], lanes: Collection[GroupState], em: float
) -> None:
    """Draw one row per group with its latest state, those that fit in x, y, width and height in pixels; the last row
    counts the others. A number after the state is that of the attempt, from the second one."""
    x, y, width, height = area
    small = round(0.85 * em)
    row = line_height(small) + 0.5 * em
    counts = Counter(lane.state for lane in lanes)
    counted = ", ".join(f"{counts[state]} {state}" for state in _ORDER if counts[state])
    canvas.text(x, y, f"Groups: {counted}", small, DIM, width=width)
    y += row
    for head, share in zip(_HEADS, _COLUMNS, strict=False):
        canvas.text(x + share * width, y, head, small, DIM, width=0.18 * width)
    y, height = y + row, height - 2 * row
    ordered = sorted(lanes, key=_place)
    fit = max(0, int(height // row))
    shown = ordered if len(ordered) <= fit else ordered[: max(0, fit - 1)]
    for lane in shown:
        _lane(canvas, x, y, width, lane, em, small)
        y += row
    if len(shown) < len(ordered) and fit:
        canvas.text(x, y, f"and {len(ordered) - len(shown)} more", small, DIM, width=width)


def _place(lane: GroupState) -> tuple[int, float]:
    """Finished groups with the newest first, others by number."""
    order = _ORDER.index(lane.state) if lane.state in _ORDER else 0
    return order, -lane.time if lane.state == "done" else lane.group


def _lane(canvas: Canvas, x: float, y: float, width: float, lane: GroupState, em: float, small: int) -> None:
    color = STATE_COLORS.get(lane.state, DIM)
    at = [x + share * width for share in _COLUMNS]
    room = [after - before - 0.5 * em for before, after in pairwise(at)]
    again = f" ({lane.attempt})" if lane.attempt > 1 else ""
    canvas.text(at[0], y, str(lane.group), small, TEXT, width=room[0])
    canvas.text(at[1], y, f"{lane.state}{again}", small, color, width=room[1])
    node = f"{lane.node}, GPU {lane.gpu}" if lane.gpu else lane.node
    canvas.text(at[2], y, node, small, DIM, width=room[2])
    if lane.state in ("retried", "failed") and lane.message:
        canvas.text(at[3], y, lane.message, small, color, width=sum(room[3:]) + em)
        return
    bar = 0.5 * em
    top = y + 0.5 * (line_height(small) - bar)
    canvas.rect(at[3], top, room[3], bar, RAISED)
    canvas.rect(at[3], top, room[3] * min(1.0, lane.frames_done / max(1, lane.frames)), bar, color)
    if lane.psnr is not None:
        canvas.text(at[4], y, f"{lane.psnr:.1f}", small, TEXT, width=room[4])
    if lane.seconds_per_frame is not None:
        canvas.text(at[5], y, f"{lane.seconds_per_frame:.1f}", small, TEXT, width=room[5])
