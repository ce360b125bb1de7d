"""Make deliberate mistakes in a capture whose cameras and masks are right, and print what the card says of each.

    python benchmarks/mistakes.py FOOTAGE [--cameras FILE] [--frames N] [--only WORD]

Images and masks are read once. A mistake changes what the checks are given, as a wrong file would: cameras, masks, or
the frames of one camera. Cameras that are a fraction of a frame late are real: the others are thinned to every second
or third frame, and one takes those between.
"""

import argparse
import hashlib
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from v3studio.pipelines.inspection import with_camera_file
from v3studio.studio.calibration.epipolar import PairMatches, match_images
from v3studio.studio.camera_files import read_rig
from v3studio.studio.cameras import Camera
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.card.card import Measured, measure_sample
from v3studio.studio.card.colors import DIFFERENCES
from v3studio.studio.card.sample import read_sample
from v3studio.studio.footage import Footage, open_footage
from v3studio.studio.progress import no_progress

Images = dict[str, list[np.ndarray]]
MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


class Kept:
    """Footage in memory, with what `measure` reads of it."""

    def __init__(self, rig: dict[str, Camera], images: Images, masks: Images) -> None:
        self.cameras = {name: rig[name] for name in images}
        self.images, self.masks, self.mask_source = images, masks, None
        self.camera_names = tuple(images)
        self.frames = tuple(range(min(map(len, images.values()))))

    def raw_size(self, camera: str) -> tuple[int, int]:
        height, width = self.images[camera][0].shape[:2]
        return width, height

    def image(self, camera: str, frame: int) -> np.ndarray:
        return self.images[camera][frame]

    def mask(self, camera: str, frame: int) -> np.ndarray:
        return self.masks[camera][frame]

    def measured(self, matches: dict[bytes, list[PairMatches]]) -> Measured:
        """The card; `matches` are kept by images, since most mistakes leave these as they are."""
        sample = read_sample(self, no_progress)  # type: ignore[arg-type]  # has what is read
        key = b"".join(hashlib.sha256(image.tobytes()).digest() for image in sample.images.values())
        if key not in matches:
            matches[key] = match_images(sample.images)
        return measure_sample(sample, self.cameras, matches[key])


def posed(rig: dict[str, Camera], change: Callable[[np.ndarray], np.ndarray]) -> dict[str, Camera]:
    return {name: replace(camera, world_to_camera=change(camera.world_to_camera)) for name, camera in rig.items()}


def late(images: Images, camera: str, step: int) -> Images:
    """Every `step`-th frame, of one camera the frames before them: it is 1 / `step` frames late."""
    count = (min(map(len, images.values())) - 1) // step
    return {
        name: [stack[1 - (name == camera) + step * index] for index in range(count)] for name, stack in images.items()
    }


def thinned(images: Images, camera: str) -> Images:
    """One camera drops every fourth frame after the first third."""
    count = min(map(len, images.values()))
    return _kept(images, camera, [index + max(0, (index - count // 3 + 3) // 3) for index in range(count)])


def interrupted(images: Images, camera: str) -> Images:
    """One camera lacks a quarter of the frames, those after the first third."""
    count = min(map(len, images.values()))
    return _kept(images, camera, [index + (index > count // 3) * (count // 4) for index in range(count)])


def _kept(images: Images, camera: str, kept: list[int]) -> Images:
    count = min(map(len, images.values()))
    length = sum(index < count for index in kept)
    return {
        name: [stack[kept[index] if name == camera else index] for index in range(length)]
        for name, stack in images.items()
    }


def of_one(masks: Images) -> Images:
    """The upper half in all cameras, as a tracker's mask of one of several objects."""
    found: Images = {name: [] for name in masks}
    for name, stack in masks.items():
        for mask in stack:
            rows = np.nonzero((mask > 127).any(1))[0]
            cut = mask.copy()
            if len(rows):
                cut[int(rows.mean()) :] = 0
            found[name].append(cut)
    return found


def mistakes(rig: dict[str, Camera], images: Images, masks: Images) -> Iterator[tuple[str, str, Kept]]:
    """Yield what was done, the cause that must be named ("" for none), and the footage."""
    names = list(rig)
    one = names[len(names) // 3]
    yield "none", "", Kept(rig, images, masks)
    yield "poses inverted", "inverted", Kept(posed(rig, np.linalg.inv), images, masks)
    yield "poses mirrored", "mirrored", Kept(posed(rig, lambda pose: MIRROR @ pose @ MIRROR), images, masks)
    for what, cause, change in (
        ("rotations transposed", "transposed", lambda pose: np.c_[pose[:3, :3].T, pose[:3, 3]]),
        ("places as translations", "center", lambda pose: np.c_[pose[:3, :3], -pose[:3, :3].T @ pose[:3, 3]]),
    ):
        yield what, cause, Kept(posed(rig, change), images, masks)
    shifted = {name: replace(rig[other], name=name) for name, other in zip(names, names[1:] + names[:1], strict=True)}
    yield "names shifted by one", "names", Kept(shifted, images, masks)
    factor = np.diag([0.5, 0.5, 1])
    yield "K halved", "pixels", Kept({name: replace(c, K=factor @ c.K) for name, c in rig.items()}, images, masks)
    ahead = {name: stack[1:] for name, stack in masks.items()}
    yield "masks off by one frame", "frames", Kept(rig, {name: stack[:-1] for name, stack in images.items()}, ahead)
    yield "masks inverted", "inverted", Kept(rig, images, {n: [255 - m for m in stack] for n, stack in masks.items()})
    yield "masks of one part", "object", Kept(rig, images, of_one(masks))
    yield "one camera 1 frame late", "late", Kept(rig, late(images, one, 1), late(masks, one, 1))
    for step in (2, 3):
        yield f"every {step} frames, none", "", Kept(rig, late(images, "", step), late(masks, "", step))
        yield f"one camera 1/{step} frame late", "late", Kept(rig, late(images, one, step), late(masks, one, step))
    yield "one camera drops frames", "rate", Kept(rig, thinned(images, one), thinned(masks, one))
    yield "one camera lacks frames", "rate", Kept(rig, interrupted(images, one), interrupted(masks, one))
    # as if it was coded with BT.709 and read with BT.601, the inverse of which undoes the opposite mistake
    change = DIFFERENCES["matrix"][1]
    other = [np.clip(change(image), 0, 255).round().astype(np.uint8) for image in images[one]]
    yield "one camera with another matrix", "matrix", Kept(rig, {**images, one: other}, masks)


def read(footage: Footage, frames: slice) -> tuple[dict[str, Camera], Images, Images]:
    wanted = footage.frames[frames]
    images = {name: [footage.image(name, frame) for frame in wanted] for name in footage.camera_names}
    masks = {name: [footage.mask(name, frame) for frame in wanted] for name in footage.camera_names}
    return {camera.name: camera for camera in footage.rig}, images, masks


def main() -> None:
    cv2.setNumThreads(1)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("footage", type=Path)
    parser.add_argument("--cameras", help="camera file, if it is not found by itself")
    parser.add_argument("--frames", type=int, default=30, help="frames that are read at most (default: 30)")
    parser.add_argument("--only", default="", help="mistakes whose names contain this")
    arguments = parser.parse_args()
    spec: Any = CaptureSettings(root=arguments.footage)
    given = open_footage(spec, None, strict=False)
    footage = (
        open_footage(spec, read_rig(arguments.cameras), strict=False) if arguments.cameras else with_camera_file(given)
    )
    rig, images, masks = read(footage, slice(0, arguments.frames))
    print(
        f"| mistake in {arguments.footage.name} | time | cameras | masks | color | named |\n|---|---|---|---|---|---|"
    )
    matches: dict[bytes, list[PairMatches]] = {}
    for what, cause, kept in mistakes(rig, images, masks):
        if arguments.only not in what:
            continue
        begin = time.process_time()
        card = kept.measured(matches).card
        named = {each for check in card.checks for each in check.causes}
        right = cause in named if cause else not named
        cells = [f"{check.grade} {', '.join(check.causes)}".strip() for check in card.checks]
        print(f"| {what} | {' | '.join(cells)} | {'yes' if right else 'no'} |", flush=True)
        for line in card.lines:
            print(f"<!-- {line} -->")
        print(f"<!-- {time.process_time() - begin:.1f} s of CPU time -->", flush=True)


if __name__ == "__main__":
    main()
