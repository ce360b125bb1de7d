"""Cameras in scripts of Nuke: the nodes Camera2 and Camera3, with knobs that are constant or have a key on every frame.

Sources: Nuke's reference guide on the Camera node, and scripts that its users published. Cameras look along -z with y
up; `rot_order` names the axes in the order in which they are applied; pixels are square, and `haperture` is the width
of the image. Numbers after `xN` are those of the frames from N on.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from v3studio.studio.camera_files.common import read_text
from v3studio.studio.cameras import OPENGL_AXES, Camera
from v3studio.studio.errors import StudioError

_NODES = ("Camera", "Camera2", "Camera3")
_PARENTS = ("Axis", "Axis2", "Axis3", "TransformGeo")
_DEFAULTS = {
    "translate": 0.0, "rotate": 0.0, "scaling": 1.0, "uniform_scale": 1.0, "skew": 0.0, "pivot": 0.0, "focal": 50.0,
    "haperture": 24.576, "win_translate": 0.0, "win_scale": 1.0, "winroll": 0.0,
}  # fmt: skip
_UNSUPPORTED = {  # and how many components they have
    "scaling": 3, "uniform_scale": 1, "skew": 3, "pivot": 3, "win_translate": 2, "win_scale": 2, "winroll": 1,
}  # fmt: skip
_WORDS = {"xform_order": "SRT", "projection_mode": "perspective"}
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|\{|\}|\n|[^\s{}]+')

Value = str | list["Value"]


def read_cameras(path: Path, width: int, height: int) -> dict[str, dict[int, Camera]]:
    """Cameras of a script by name and frame; one that stands still has one. Raises StudioError: `nuke.*`."""
    cameras: dict[str, dict[int, Camera]] = {}
    others: set[str] = set()
    parents = False
    for kind, knobs in _nodes(path):
        if kind in _NODES:
            name = str(knobs.get("name", kind))
            cameras[name] = _Node(path, name, knobs, parents).cameras(width, height)
        parents = parents or kind in _PARENTS
        others.add(kind)
    if not cameras:
        problem = f"there is no node Camera2 or Camera3; it has {', '.join(sorted(others)) or 'no nodes'}"
        raise StudioError("nuke.no_camera", problem, file=path, fix="Export a classic Camera node.")
    return cameras


def _nodes(path: Path) -> Iterator[tuple[str, dict[str, Value]]]:
    """The kind and the knobs of each node, in the order of the file."""
    tokens = _TOKEN.findall(read_text(path))
    at = 0
    while at < len(tokens):
        if at + 1 < len(tokens) and tokens[at + 1] == "{" and tokens[at][0].isupper():
            knobs, end = _knobs(path, tokens, at + 2)
            yield tokens[at], knobs
            at = end
        else:
            at += 1


def _knobs(path: Path, tokens: list[str], at: int) -> tuple[dict[str, Value], int]:
    """The knobs of a node up to its closing brace, one a line, and the place after it."""
    knobs: dict[str, Value] = {}
    while at < len(tokens) and tokens[at] != "}":
        if tokens[at] == "\n":
            at += 1
            continue
        name = tokens[at]
        values: list[Value] = []
        at += 1
        while at < len(tokens) and tokens[at] not in ("\n", "}"):
            value, at = _value(path, tokens, at)
            values.append(value)
        knobs[name] = values[0] if len(values) == 1 else values
    if at >= len(tokens):
        raise StudioError("nuke.syntax", "a node has no closing brace", file=path, fix="Export the camera again.")
    return knobs, at + 1


def _value(path: Path, tokens: list[str], at: int) -> tuple[Value, int]:
    if tokens[at] != "{":
        return tokens[at], at + 1
    values: list[Value] = []
    at += 1
    while at < len(tokens) and tokens[at] != "}":
        if tokens[at] == "\n":
            at += 1
            continue
        value, at = _value(path, tokens, at)
        values.append(value)
    if at >= len(tokens):
        raise StudioError("nuke.syntax", "a brace is not closed", file=path, fix="Export the camera again.")
    return values, at + 1


class _Node:
    """One camera."""

    def __init__(self, path: Path, name: str, knobs: dict[str, Value], parents: bool) -> None:
        self._path, self._name, self._knobs = path, name, knobs
        if parents and knobs.get("inputs") != "0":
            raise self._error("it may be connected to an Axis node, whose transform would be missing", "inputs")

    def _error(self, problem: str, knob: str) -> StudioError:
        problem = f"camera {self._name}: {problem}"
        fix = "Bake the camera in Nuke: a copy without inputs, with a key on every frame."
        return StudioError("nuke.unsupported", problem, file=self._path, fix=fix, camera=self._name, knob=knob)

    def cameras(self, width: int, height: int) -> dict[int, Camera]:
        for knob, count in _UNSUPPORTED.items():
            if any(set(curve.values()) != {_DEFAULTS[knob]} for curve in self._curves(knob, count)):
                raise self._error(f"{knob} is not {_DEFAULTS[knob]:g}", knob)
        for knob, word in _WORDS.items():
            if self._knobs.get(knob, word) != word:
                raise self._error(f"{knob} is {self._knobs[knob]}, not {word}", knob)
        focal, film = self._curves("focal", 1), self._curves("haperture", 1)
        poses = self._curves("matrix", 16) if self._knobs.get("useMatrix") == "true" else []
        turns = [] if poses else [*self._curves("translate", 3), *self._curves("rotate", 3)]
        moving = [curve for curve in (*focal, *film, *poses, *turns) if len(curve) > 1]
        frames = sorted({frame for curve in moving for frame in curve}) or [0]
        cameras = {}
        for frame in frames:
            now = [_at(curve, frame) for curve in (*focal, *film)]
            pose = self._matrix([_at(curve, frame) for curve in poses]) if poses else self._placed(turns, frame)
            K = np.diag([now[0] / now[1] * width, now[0] / now[1] * width, 1.0])
            K[:2, 2] = width / 2, height / 2
            cameras[frame] = Camera(self._name, width, height, K, np.linalg.inv(pose @ OPENGL_AXES))
        return cameras

    def _matrix(self, values: list[float]) -> np.ndarray:
        """(4, 4) camera to world, from rows."""
        pose = np.array(values).reshape(4, 4)
        linear = pose[:3, :3]
        if np.abs(linear @ linear.T - np.eye(3)).max() > 1e-3 or not np.allclose(pose[3], [0, 0, 0, 1]):
            raise self._error("its matrix scales, shears or mirrors", "matrix")
        return pose

    def _placed(self, curves: list[dict[int, float]], frame: int) -> np.ndarray:
        order = self._knobs.get("rot_order", "ZXY")
        if not isinstance(order, str) or sorted(order) != ["X", "Y", "Z"]:
            raise self._error(f"rot_order is {order}, not an order of X, Y and Z", "rot_order")
        values = np.array([_at(curve, frame) for curve in curves])
        angles = dict(zip("XYZ", values[3:], strict=True))
        pose = np.eye(4)
        # lower case: about the axes of the world, one after the other
        turn = Rotation.from_euler(order.lower(), [angles[axis] for axis in order], degrees=True)
        pose[:3, :3], pose[:3, 3] = turn.as_matrix(), values[:3]
        return pose

    def _curves(self, knob: str, count: int) -> list[dict[int, float]]:
        """The values of each component by frame; one that is constant has one."""
        value = self._knobs.get(knob)
        if value is None:
            if knob == "matrix":
                raise self._error("useMatrix is true, but it has no matrix", knob)
            return [{0: _DEFAULTS[knob]}] * count
        parts = self._flat(value) if isinstance(value, list) else [value]
        if len(parts) == 1:
            parts = parts * count  # one value for all components
        if len(parts) != count:
            raise self._error(f"{knob} has {len(parts)} values; {count} are expected", knob)
        return [self._curve(knob, part) for part in parts]

    def _flat(self, value: list[Value]) -> list[Value]:
        """The values without braces around all of them, or around rows of them."""
        if value and value[0] == "curve":
            return [value]
        return [part for item in value for part in (self._flat(item) if isinstance(item, list) else [item])]

    def _curve(self, knob: str, value: Value) -> dict[int, float]:
        if isinstance(value, str):
            return {0: self._number(knob, value)}
        keys: dict[int, float] = {}
        frame = None
        for word in value[1:]:
            if not isinstance(word, str):
                raise self._error(f"{knob} is not a curve of numbers", knob)
            if re.fullmatch(r"x-?\d+", word):
                frame = int(word[1:])
            elif re.fullmatch(r"[iKLRCSZH]", word) or (re.fullmatch(r"[stuv]-?[\d.e+-]+", word) and keys):
                continue  # how it is interpolated between keys
            else:
                frame = min(keys, default=1) if frame is None else frame
                if keys and frame <= max(keys):
                    problem = f"camera {self._name}: frame {frame} of {knob} comes after frame {max(keys)}"
                    fix = "Export the camera again."
                    raise StudioError("camera_path.times", problem, file=self._path, value=frame, fix=fix)
                keys[frame] = self._number(knob, word)
                frame += 1
        if not keys:
            raise self._error(f"{knob} is an expression or has no keys", knob)
        gaps = [at for at in sorted(keys)[:-1] if at + 1 not in keys]
        if gaps and len(set(keys.values())) > 1:
            raise self._error(f"{knob} has no key on frame {gaps[0] + 1}", knob)
        return keys

    def _number(self, knob: str, word: str) -> float:
        try:
            number = float(word)
        except ValueError:
            number = np.nan
        if not np.isfinite(number):
            raise self._error(f"{knob} is {word}, which is not a number", knob)
        return number


def _at(curve: dict[int, float], frame: int) -> float:
    """The value at a frame: that of the nearest key."""
    return curve[min(curve, key=lambda at: abs(at - frame))]
