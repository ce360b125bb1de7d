"""The edits of a take in words, for the command line and the window."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from studio.edits.edit_list import CropBox, DetailMark, EditList, Floaters, Ground, Region, Trim, World
from studio.similarity import Similarity

NAMES = ("trim", "crop", "ground", "floaters", "regions", "world", "details")
"""Edits, in the order in which they are listed."""


def describe(edits: EditList) -> dict[str, str]:
    """What is edited, by name; a region counts as `regions 1`, `regions 2`, ..., a detail as `details 1`.

    Positions and sizes are in the world that the edits place, as `v3studio edit` takes them.
    """
    placed = edits.similarity
    found: dict[str, str] = {}
    for name in NAMES:
        value = getattr(edits, name)
        if isinstance(value, tuple):
            found |= {f"{name} {number}": words_of(one, placed) for number, one in enumerate(value, 1)}
        elif value is not None:
            found[name] = words_of(value, placed)
    return found


def words_of(edit: Trim | CropBox | Ground | Floaters | Region | World | DetailMark, placed: Similarity) -> str:
    """An edit in a few words, with positions and sizes in the world to which `placed` leads from the capture's.

    The world itself is described in that of the capture, and distances between clusters are in its units.
    """
    match edit:
        case Trim():
            return f"frames {edit.first} to {edit.last}"
        case CropBox():
            size = " x ".join(f"{placed.scale * value:.4g}" for value in edit.size)
            center = _point(placed.points(np.array(edit.center)))
            return f"box of {size} around {center}{', also for training' if edit.training else ''}"
        case Ground():
            normal = placed.directions(np.array(edit.normal))
            height = placed.points(edit.height * np.array(edit.normal)) @ normal
            return f"nothing below {height:.4g} along {_point(normal)}"
        case Floaters():
            return ", ".join(_limits(edit))
        case Region():
            kind = "lasso" if edit.radius is None else "brush"
            near, far = (placed.scale * (limit or 0.0) for limit in (edit.near, edit.far))
            depth = "" if edit.far is None else f", depth {near:.4g} to {far:.4g}"
            if edit.frames is None:
                return f"{kind}, all frames{depth}"
            first, last = edit.frames
            return f"{kind}, {f'the group of frame {first}' if first == last else f'frames {first} to {last}'}{depth}"
        case DetailMark():
            (first, place), (last, _) = edit.path[0], edit.path[-1]
            frames = f"frame {first}" if first == last else f"frames {first} to {last}, in the first"
            ball = f"radius {placed.scale * edit.radius:.4g}, weight {edit.weight:g}"
            return f"{ball}, {frames} at {_point(placed.points(np.array(place)))}"
        case World():
            parts = [] if edit.up is None else [f"up {_point(edit.up)}"]
            parts += [f"origin {_point(edit.origin)}"] if any(edit.origin) else []
            parts += [f"scale {edit.scale:.6g}"] if edit.scale != 1 else []
            return ", ".join(parts) or "as captured"


def _limits(floaters: Floaters) -> list[str]:
    found = [] if floaters.opacity is None else [f"splats that never reach opacity {floaters.opacity:.4g}"]
    if floaters.splats is not None:
        found.append(f"clusters of fewer than {floaters.splats} splats")
    if floaters.share is not None:
        found.append(f"clusters of less than {100 * floaters.share:.4g}% of the splats")
    if floaters.distance is not None:
        found.append(f"clusters {floaters.distance:.4g} apart")
    return found


def _point(values: Sequence[float] | np.ndarray) -> str:
    # zero must not be "-0", as turns make of it
    return f"({', '.join(f'{value + 0.0:.4g}' for value in np.round(values, 12))})"
