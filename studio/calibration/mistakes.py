"""Simple mistakes that camera files are written or read with, and how they are undone."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations, product

import numpy as np

from v3studio.studio.cameras import OPENGL_AXES, Camera

Cameras = Mapping[str, Camera]

_CONVERT = "Convert the poses in the camera file."
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])
_AXES = {
    OPENGL_AXES.tobytes(): "with the axes of OpenGL (y up, z backward)",
    np.eye(4).tobytes(): "",
}


@dataclass(frozen=True)
class Mistake:
    """A mistake in the whole rig. `kind`: a word for programs; `words`: "Taken as camera-to-world"; `fix`: what to do;
    `undo`: gives the cameras that were meant."""

    kind: str
    words: str
    fix: str
    undo: Callable[[Cameras], dict[str, Camera]]


def mistakes(names: list[str]) -> Iterator[Mistake]:
    """Mistakes without a number, the most common first."""
    yield from _poses()
    for kind, words, change in (
        ("transposed", "With the rotations transposed", lambda R, t: (R.T, t)),
        ("center", "With t taken as the camera's place", lambda R, t: (R, -R @ t)),
    ):
        yield Mistake(kind, words, _CONVERT, partial(_moved, change=change))
    for step in (1, -1, 2, -2):
        if len(names) > abs(step) + 1:
            moved = dict(zip(names, names[step:] + names[:step], strict=True))
            words = f"With the names of all cameras moved by {abs(step)}, so that {names[0]} is {moved[names[0]]}"
            yield Mistake("names", words, _RENAME, partial(_renamed, names=moved))
    in_text = sorted(names)
    if in_text != names:
        words = f"With names in alphabetical order ({', '.join(in_text[:3])}, ...)"
        yield Mistake("names", words, _RENAME, partial(_renamed, names=dict(zip(names, in_text, strict=True))))
        back = dict(zip(in_text, names, strict=True))
        yield Mistake("names", "With names in the order of their numbers", _RENAME, partial(_renamed, names=back))


_RENAME = "Correct the names in the camera file, or rename the footage; does one count from 0 and the other from 1?"


def scaled(cameras: Cameras, factor: float, *, whole: bool, names: Collection[str] | None = None) -> dict[str, Camera]:
    """Cameras, or those of `names`, with other focal lengths, or all of K if `whole`, as if images had another size."""
    steps = np.array([[factor, factor, factor if whole else 1], [1, factor, factor if whole else 1], [1, 1, 1]])
    among = cameras if names is None else names
    return {name: replace(c, K=c.K * steps) if name in among else c for name, c in cameras.items()}


def _renamed(cameras: Cameras, names: Mapping[str, str]) -> dict[str, Camera]:
    return {name: replace(cameras[names.get(name, name)], name=name) for name in cameras}


def _moved(
    cameras: Cameras, change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
) -> dict[str, Camera]:
    return {
        name: replace(camera, world_to_camera=np.c_[*change(camera.rotation, camera.translation)])
        for name, camera in cameras.items()
    }


def _posed(cameras: Cameras, axes: np.ndarray, inverse: bool) -> dict[str, Camera]:
    world = _MIRROR if np.linalg.det(axes) < 0 else np.eye(4)
    return {
        name: replace(
            camera,
            world_to_camera=axes
            @ (np.linalg.inv(camera.world_to_camera) if inverse else camera.world_to_camera)
            @ world,
        )
        for name, camera in cameras.items()
    }


def _poses() -> Iterator[Mistake]:
    """Poses inverted, mirrored, and with other axes of the camera, in all combinations."""
    every = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        axes = np.eye(4)
        axes[:3, :3] = np.diag(signs)[:, order]
        every.append(axes)
    # diagonal ones first: those of the common conventions
    every.sort(key=lambda axes: (axes.tobytes() not in _AXES, -abs(np.trace(np.abs(axes))), -np.linalg.det(axes)))
    for axes, inverse in sorted(product(every, (True, False)), key=lambda each: each[0].tobytes() not in _AXES):
        mirrored = np.linalg.det(axes) < 0
        if not inverse and np.array_equal(axes, np.eye(4)):
            continue
        named = _AXES.get(axes.tobytes())
        if named is None:
            named = f"with the camera's axes ({_letters(axes)})"
        system = "in a mirrored (left-handed) system" if mirrored else ""
        parts = [*(["Taken as camera-to-world"] if inverse else ["Taken"]), *filter(None, (system, named))]
        kind = "inverted" if inverse and not named else "mirrored" if mirrored else "axes"
        yield Mistake(kind, " ".join(parts), _CONVERT, partial(_posed, axes=axes, inverse=inverse))


def _letters(axes: np.ndarray) -> str:
    """The axes of the file that become x, y and z of OpenCV: "x, -z, y"."""
    rows = axes[:3, :3]
    return ", ".join(("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in rows)
