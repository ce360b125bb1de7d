"""Counts the wrong rigs that the check of cameras and masks finds, and the correct ones that it suspects.

    python benchmarks/rigs.py SETTINGS.yaml [SETTINGS.yaml ...]

Each settings file names a capture with a correct camera file, masks and at least six frames, for example
sample_configs/quickstart.yaml and the exact.yaml of benchmarks/make_hard.py. Per capture, 20 rigs are made wrong in
known ways and must be called so for the right reason: as a whole, or by naming the camera. Ten correct ones (other
frames, fewer cameras, another world, cameras that are slightly off) must be called good, or usable without a camera in
doubt. The exit code is 1 if one is missed.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from v3studio.pipelines.config import load_config
from v3studio.pipelines.stages.rig_check import judge_views
from v3studio.studio.calibration.epipolar import PairMatches, match_images
from v3studio.studio.calibration.report import RigVerdict
from v3studio.studio.camera_files import read_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.footage import Footage, FootageView, open_footage
from v3studio.studio.similarity import Similarity

LATE = 5
"""Frames by which a camera is late: in one frame of 25 fps, a performer moves by less than the masks' tolerance."""
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])

Views = dict[str, FootageView]
Near = Callable[[str], Mapping[int, np.ndarray]]


@dataclass(frozen=True)
class Trial:
    """A rig, and what should be said of it."""

    what: str  # how it was made
    views: Views  # by camera
    same_images: bool  # whether the images are those of the capture, so that their matches are known
    right: Callable[[RigVerdict], bool]  # whether a verdict is right
    near: Near = lambda name: {}  # masks of a camera in other frames, by frame


def whole(*words: str) -> Callable[[RigVerdict], bool]:
    """The rig, or its masks, are wrong as a whole; the reason has one of the words."""
    return lambda found: found.grade == "wrong" and any(word in found.reason for word in words or ("",))


def names(*cameras: str, blamed: str = "", says: str = "") -> Callable[[RigVerdict], bool]:
    """These cameras are named, and at most one other; the reason or the fix says this."""

    def right(found: RigVerdict) -> bool:
        named = set(found.doubtful)
        fewest = set(cameras) <= named and len(named) <= len(cameras) + 1
        return fewest and blamed in found.blamed and says in found.reason + found.fix

    return right


def fine(found: RigVerdict) -> bool:
    """No camera is in doubt."""
    return found.grade != "wrong" and not found.doubtful


def posed(view: FootageView, pose: np.ndarray) -> FootageView:
    return replace(view, camera=replace(view.camera, world_to_camera=pose))


def turned(view: FootageView, about: np.ndarray, axis: np.ndarray, degrees: float) -> FootageView:
    """A view whose camera is turned about a point of the world."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    motion[:3, 3] = about - motion[:3, :3] @ about
    return posed(view, view.camera.world_to_camera @ np.linalg.inv(motion))


def zoomed(view: FootageView, factor: float) -> FootageView:
    K = view.camera.K.copy()
    K[:2, :2] *= factor
    return replace(view, camera=replace(view.camera, K=K))


def mirrored(view: FootageView) -> FootageView:
    return replace(view, image=view.image[:, ::-1].copy(), mask=view.mask[:, ::-1].copy())


def exchanged(views: Views, first: str, second: str) -> Views:
    """Two cameras have each other's calibration."""
    cameras = {first: replace(views[second].camera, name=first), second: replace(views[first].camera, name=second)}
    return views | {name: replace(views[name], camera=camera) for name, camera in cameras.items()}


def wrong(footage: Footage, views: Views) -> Iterator[Trial]:
    """Twenty rigs that are wrong."""
    first, late = footage.frames[0], footage.frames[LATE]
    rig = Rig(tuple(view.camera for view in views.values()))
    order, middle, up = list(views), rig.focus, rig.up
    a, b, c, d = (order[int(len(order) * part)] for part in (0.1, 0.35, 0.6, 0.85))
    poses = {name: view.camera.world_to_camera for name, view in views.items()}

    for degrees in (25, 60, 100):
        folded = views | {name: turned(views[name], middle, up, degrees) for name in order[::2]}
        yield Trial(f"folded by {degrees} degrees", folded, True, whole("This rig is wrong"))
    for camera, other in ((a, b), (b, d), (c, order[order.index(c) + 1])):
        yield Trial(
            "two cameras exchanged", exchanged(views, camera, other), True, names(camera, other, says="are exchanged")
        )
    for factor in (0.7, 1.1, 1.3):
        scaled = {name: zoomed(view, factor) for name, view in views.items()}
        yield Trial(f"all focal lengths x {factor}", scaled, True, whole("focal lengths"))
    for name, factor in ((b, 1.2), (d, 0.8)):
        yield Trial(
            f"one focal length x {factor}", views | {name: zoomed(views[name], factor)}, True, names(name, blamed="cam")
        )
    yield Trial(
        "all images mirrored", {name: mirrored(view) for name, view in views.items()}, False, whole("This rig is wrong")
    )
    yield Trial("one image mirrored", views | {c: mirrored(views[c])}, False, names(c))
    inverse = {name: posed(view, np.linalg.inv(poses[name])) for name, view in views.items()}
    yield Trial("camera-to-world", inverse, True, whole("camera-to-world"))
    opengl = {name: posed(view, FLIP @ poses[name]) for name, view in views.items()}
    yield Trial("axes of OpenGL", opengl, True, whole("OpenGL"))
    aside = views | {a: turned(views[a], views[a].camera.center, up, 5)}
    yield Trial("one camera looks 5 degrees aside", aside, True, names(a, blamed="cam"))

    def masks_of(other: str, shift: int) -> Near:
        """The masks of a camera, taken from another camera or another time."""
        near = range(-shift, 9)
        return lambda name: {first + at: footage.mask(other, first + shift + at) for at in near if at}

    for name in (b, d):
        off = replace(footage.view(name, late), camera=views[name].camera)
        yield Trial(
            f"one camera {LATE} frames late",
            views | {name: off},
            False,
            names(name, says=f"Out of time: {name}"),
            masks_of(name, late - first),
        )
    others = replace(views[a], mask=views[c].mask)
    yield Trial(
        "another camera's masks", views | {a: others}, True, names(a, blamed="masks", says="Look at"), masks_of(c, 0)
    )
    shifted = {name: replace(views[name], mask=views[order[at - 1]].mask) for at, name in enumerate(order)}
    yield Trial("masks of the next camera, all", shifted, True, whole("masks"))


def correct(footage: Footage, views: Views) -> Iterator[Trial]:
    """Ten rigs that are right, or off by less than matters."""
    order, random = list(views), np.random.default_rng(0)
    for frame in footage.frames[1:5]:
        yield Trial("another frame", views_of(footage, frame), False, fine)
    for left_out in (0, 3):
        fewer = {name: views[name] for at, name in enumerate(order) if at % 6 != left_out}
        yield Trial("fewer cameras", fewer, True, fine)
    for scale, degrees in ((1.0, 90.0), (0.01, 30.0)):
        world = Similarity(scale, Rotation.from_rotvec([np.radians(degrees), 0, 0]).as_matrix(), np.array([1.0, 2, 3]))
        moved = {name: replace(view, camera=world.camera(view.camera)) for name, view in views.items()}
        yield Trial("another world", moved, True, fine)
    for degrees in (0.05, 0.1):
        axes = {name: random.normal(size=3) for name in order}
        off = {name: turned(view, view.camera.center, axes[name], degrees) for name, view in views.items()}
        yield Trial(f"each camera off by {degrees} degrees", off, True, fine)


def views_of(footage: Footage, frame: int) -> Views:
    return {name: footage.view(name, frame) for name in footage.rig.names}


def matches(views: Views) -> list[PairMatches]:
    return match_images({name: view.image for name, view in views.items()})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("settings", nargs="+", type=Path, help="captures with correct cameras and masks")
    totals = {True: [0, 0], False: [0, 0]}
    for path in parser.parse_args().settings:
        capture = load_config(path).capture
        footage = open_footage(capture, read_rig(capture.root / str(capture.rig)))
        views = views_of(footage, footage.frames[0])
        pairs = matches(views)
        print(f"{path}: {len(views)} cameras, {len(pairs)} pairs of images")
        for broken, trials in ((True, wrong(footage, views)), (False, correct(footage, views))):
            for trial in trials:
                cameras = {name: view.camera for name, view in trial.views.items()}
                matched = pairs if trial.same_images else matches(trial.views)
                verdict = judge_views(cameras, matched, list(trial.views.values()), trial.near)
                right = trial.right(verdict)
                totals[broken][0] += right
                totals[broken][1] += 1
                print(f"{'ok' if right else 'MISSED':7} {trial.what:34} {verdict.grade:7} {verdict.reason}", flush=True)
    called, kept = totals[True], totals[False]
    print(f"wrong rigs: {called[0]} of {called[1]} called wrong for the right reason")
    print(f"correct rigs: {kept[0]} of {kept[1]} not suspected")
    return 0 if called[0] == called[1] and kept[0] == kept[1] else 1


if __name__ == "__main__":
    sys.exit(main())
