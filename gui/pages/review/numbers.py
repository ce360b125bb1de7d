"""The numbers of edits as texts of fields, and back."""

from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from pydantic import ValidationError

from v3studio.studio.edits.edit_list import CropBox, DetailMark, EditList, Floaters, Ground, World
from v3studio.studio.errors import violation
from v3studio.studio.rotations import matrices_to_quats

Field = tuple[str, str, str]

TITLES = {
    "crop": ("Crop box", "Lowest and highest corner, x y z in the new world. Empty: no box."),
    "ground": ("Ground", "Height along up, in the new world. Empty: no ground plane."),
    "floaters": ("Floaters", "Splats that are removed in every group. Empty: no such limit."),
    "world": ("World", "World of streams and exports. Up and origin: x y z in the world of the capture."),
    "details": ("Detail", "The detail marked last. Weight: how much more it counts in training. Leave empty for none."),
}


def fields_of(edits: EditList, kind: str, up: np.ndarray) -> list[Field]:
    """Key, label and text of each number of an edit. `kind`: a key of `TITLES`. `up`: (3,) unit vector."""
    world = edits.similarity
    if kind == "crop":
        low = high = ""
        if edits.crop is not None:
            corners = world.points(edits.crop.corners)
            low, high = _text(corners.min(axis=0)), _text(corners.max(axis=0))
        return [("low", "Min corner", low), ("high", "Max corner", high)]
    if kind == "ground":
        height, ground = "", edits.ground
        if ground is not None:
            height = f"{world.points(ground.height * ground.unit) @ world.directions(up):.4g}"
        return [("height", "Height", height)]
    if kind == "floaters":
        now = edits.floaters
        return [
            (key, label, "" if now is None or getattr(now, key) is None else f"{getattr(now, key):g}")
            for key, label in (
                ("opacity", "Splats that stay below this opacity (0 to 1)"),
                ("share", "Clusters with less than this share of the splats (0 to 1)"),
                ("splats", "Clusters with fewer splats than"),
                ("distance", "Distance within clusters, in units of the capture"),
            )
        ]
    if kind == "world":
        placed = edits.world or World()
        return [
            ("up", "Up", "" if placed.up is None else _text(np.array(placed.up))),
            ("origin", "Origin", _text(np.array(placed.origin))),
            ("scale", "Scale", f"{placed.scale:.6g}"),
        ]
    last = edits.details[-1] if edits.details else None
    return [
        ("radius", "Radius, in the new world", "" if last is None else f"{world.scale * last.radius:.4g}"),
        ("weight", "Weight (1 to 100)", "" if last is None else f"{last.weight:g}"),
    ]


def with_numbers(edits: EditList, kind: str, texts: Mapping[str, str], up: np.ndarray) -> EditList | str:
    """The edits with what was typed into the fields (`texts`, by key); a sentence if it makes no sense."""
    try:
        return _with_numbers(edits, kind, {key: text.strip() for key, text in texts.items()}, up)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or kind
        words = f"{where} {violation(first)}"
    except ValueError as error:
        words = str(error)
    return f"{words[:1].upper()}{words[1:]}."


def _with_numbers(edits: EditList, kind: str, texts: dict[str, str], up: np.ndarray) -> EditList:
    if kind == "details":
        return _with_detail(edits, texts)
    if not any(texts.values()):
        return edits.with_(**{kind: None})
    back = edits.similarity.inverse
    if kind == "crop":
        low, high = (_vector(texts[key], key) for key in ("low", "high"))
        box = edits.crop
        if box is not None and [text for _, _, text in fields_of(edits, kind, up)] == [texts["low"], texts["high"]]:
            return edits  # a turned box has no such corners
        new = {
            "center": back.points((low + high) / 2).tolist(),
            "size": (back.scale * (high - low)).tolist(),
            "rotation": matrices_to_quats(back.rotation).tolist(),
            "training": box is not None and box.training,
        }
        return edits.with_(crop=CropBox.model_validate(new))
    if kind == "ground":
        placed_up = edits.similarity.directions(up)
        point = back.points(_number(texts["height"], "height") * placed_up)
        return edits.with_(ground=Ground.model_validate({"normal": up.tolist(), "height": float(point @ up)}))
    if kind == "floaters":
        limits = {key: _number(text, key) for key, text in texts.items() if text}
        return edits.with_(floaters=Floaters.model_validate(limits))
    placed = {
        "up": _vector(texts["up"], "up").tolist() if texts["up"] else None,
        "origin": _vector(texts["origin"] or "0 0 0", "origin").tolist(),
        "scale": _number(texts["scale"] or "1", "scale"),
    }
    world = World.model_validate(placed)
    return edits.with_(world=None if world == World() else world)


def _with_detail(edits: EditList, texts: dict[str, str]) -> EditList:
    if not edits.details:
        raise ValueError("there is no detail yet: take the tool Detail, and click on the performer")
    *others, last = edits.details
    if any(texts.values()):
        changed = {key: _number(text, key) for key, text in texts.items()}
        same = f"{edits.similarity.scale * last.radius:.4g}" == texts["radius"]
        changed["radius"] = last.radius if same else edits.similarity.inverse.scale * changed["radius"]
        others.append(DetailMark.model_validate(last.model_dump() | changed))
    return edits.with_(details=tuple(others))


def _text(numbers: np.ndarray) -> str:
    least = 1e-9 * max(float(np.abs(numbers).max()), 1e-9)
    return " ".join(f"{0.0 if abs(value) < least else value:.4g}" for value in numbers)


def _number(text: str, key: str) -> float:
    with suppress(ValueError):
        if np.isfinite(value := float(text)):
            return value
    raise ValueError(f"{key}: '{text}' is not a number")


def _vector(text: str, key: str) -> np.ndarray:
    parts = text.replace(",", " ").split()
    if len(parts) != 3:
        raise ValueError(f"{key}: '{text}' is not three numbers; example: 0 1.5 0")
    return np.array([_number(part, key) for part in parts])
