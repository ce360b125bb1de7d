"""The edits of a take in words, for the command line and the window."""

from __future__ import annotations

from collections.abc import Sequence

from studio.edits.edit_list import CropBox, DetailMark, EditList, Floaters, Ground, Region, Trim, World

NAMES = ("trim", "crop", "ground", "floaters", "regions", "world", "details")
"""Edits, in the order in which they are listed."""


def describe(edits: EditList) -> dict[str, str]:
    """What is edited, by name; a region counts as `regions 1`, `regions 2`, ..., a
    detail as `details 1`."""
    found: dict[str, str] = {}
    for name in NAMES:
        value = getattr(edits, name)
        if isinstance(value, tuple):
            found |= {f"{name} {number}": words_of(region) for number, region in enumerate(value, 1)}
        elif value is not None:
            found[name] = words_of(value)
    return found


def words_of(edit: Trim | CropBox | Ground | Floaters | Region | World | DetailMark) -> str:
    """An edit in a few words."""
    match edit:
        case Trim():
            return f"frames {edit.first} to {edit.last}"
        case CropBox():
            size = " x ".join(f"{value:.4g}" for value in edit.size)
            return f"box of {size} around {_point(edit.center)}{', also for training' if edit.training else ''}"
        case Ground():
            return f"nothing below {edit.height:.4g} along {_point(edit.normal)}"
        case Floaters():
            return ", ".join(_limits(edit))
        case Region():
            kind = "lasso" if edit.radius is None else "brush"
            depth = "" if edit.far is None else f", depth {edit.near:.4g} to {edit.far:.4g}"
            if edit.frames is None:
                return f"{kind}, all frames{depth}"
            first, last = edit.frames
            return f"{kind}, {f'the group of frame {first}' if first == last else f'frames {first} to {last}'}{depth}"
        case DetailMark():
            frame, place = edit.path[0]
            return f"radius {edit.radius:.4g}, weight {edit.weight:g}, in frame {frame} at {_point(place)}"
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


def _point(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.4g}' for value in values)})"
