"""The help on each stage, what to look for: a few sentences, and images of a good and a bad result.

`scripts/help_pictures.py` makes the images from runs of the sample capture, the bad ones with wrong settings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height, wrapped
from v3studio.gui.drawing.palette import BAD, DIALOG, DIM, GOOD, TEXT

PICTURES = Path(__file__).parents[1] / "help"  # folder of the images: STAGE_good.jpg and STAGE_bad.jpg

KINDS = {"good": ("Good", GOOD), "bad": ("Bad", BAD)}


@dataclass(frozen=True)
class StageHelp:
    """Help of a stage. `settings`: dotted names of settings to try if it looks bad."""

    points: Sequence[str]
    good: str
    bad: str
    settings: Sequence[str]


HELP: Mapping[str, StageHelp] = {  # by key of `TITLES`
    "capture": StageHelp(
        (
            "The outline follows the performer in every camera, with nothing missing inside and no background outside.",
            "All cameras show the same moment: compare a fast hand or foot across them.",
            "Scrub through the take; masks often fail in single frames. Check reads all of the footage.",
        ),
        "The outline follows the body, the hands and the hair.",
        "A sensitivity that is too low: parts of the body count as background.",
        ("capture.masks", "capture.mask_sensitivity", "capture.offsets"),
    ),
    "calibrate": StageHelp(
        (
            "Every camera is where it stood, and faces the performer.",
            "Reprojection errors are below 0.5 px; a single bad camera has usually moved or has another zoom.",
            "Cameras from a file have no such errors: read the verdict in Report, and look at the hull in Initialize.",
        ),
        "Calibrated from the footage: all cameras on their ring, with small errors.",
        "Two cameras swapped in the camera file: the hull in Initialize is distorted and lacks an arm.",
        ("calibrate.camera_model", "calibrate.frame_count", "calibrate.shared_intrinsics"),
    ),
    "initialize": StageHelp(
        (
            "The hull has all limbs and props; it may be thicker than the performer.",
            "A missing limb means a mask that misses it in at least one camera.",
            "A hull with sheets or blocks around it means background in the masks, or wrong cameras.",
        ),
        "Head, both arms, both legs and the skirt are there.",
        "Masks with holes: what one camera misses is carved away.",
        ("capture.mask_sensitivity", "initialize.tolerance", "initialize.resolution"),
    ),
    "train": StageHelp(
        (
            "The held-out camera beside its footage: edges, face and hands are as sharp as in the footage.",
            "The loss of each group falls and flattens. A group that ends far above the others has a bad keyframe.",
            "PSNR is of the training cameras, and higher than that of held-out ones.",
        ),
        "A held-out camera after the whole schedule.",
        "Too few splats and steps: blurred, and edges dissolve.",
        ("train.max_splats", "train.keyframe_iterations", "train.finetune_iterations"),
    ),
    "bake": StageHelp(
        (
            "Decoded splats look like trained ones: wipe between them in Review.",
            "Noise on smooth surfaces and ragged edges mean that QP is too high.",
            "'Try other QPs' measures bytes against PSNR on this take; take the point before the curve falls.",
        ),
        "QP 24: no visible loss.",
        "QP 44: smaller, but noisy, with spikes at edges.",
        ("bake.quality", "bake.attribute_qps"),
    ),
    "review": StageHelp(
        (
            "The difference from a held-out camera is thin and even along edges. Areas mean wrong shape or color.",
            "A frame whose PSNR drops on the timeline: step to it, and look at fast parts first.",
            "Play it from a free view: flicker between groups is visible only in motion.",
        ),
        "Differences only where hands and skirt are fast.",
        "A third of the cameras are four frames late: limbs are blurred and differ all over.",
        ("capture.offsets", "train.group_size", "bake.quality"),
    ),
}


def help_image(stage: str, width: int, em: float) -> np.ndarray:
    """(H, width, 3) uint8: sentences above the images, in the window's font size. `stage`: a key of `HELP`."""
    topic, size, small = HELP[stage], round(0.95 * em), round(0.85 * em)
    step = line_height(size)
    points = [wrapped(point, size, width - 1.2 * em) for point in topic.points]
    each = (width - em) / 2
    read = {kind: cv2.imread(str(path)) for kind in KINDS for path in PICTURES.glob(f"{stage}_{kind}.jpg")}
    pictures = {kind: pixels[..., ::-1] for kind, pixels in read.items() if pixels is not None}
    high = max((each * picture.shape[0] / picture.shape[1] for picture in pictures.values()), default=0.0)
    captions = {kind: wrapped(getattr(topic, kind), small, each) for kind in pictures}
    below = max(map(len, captions.values()), default=0) * line_height(small)
    above = sum(map(len, points)) * step + 0.35 * em * len(points)
    canvas = Canvas(width, above + 0.4 * em + step + high + 0.3 * em + below, DIALOG)
    y = 0.0
    for lines in points:
        canvas.dot(0.35 * em, y + 0.62 * size, 0.16 * em, DIM)
        y = canvas.lines(em, y, lines, size, TEXT) + 0.35 * em
    y += 0.4 * em
    for number, kind in enumerate(pictures):
        (title, color), left = KINDS[kind], number * (each + em)
        canvas.text(left, y, title, size, color)
        canvas.fit_image(left, y + step, each, high, pictures[kind])
        canvas.lines(left, y + step + high + 0.3 * em, captions[kind], small, DIM)
    return canvas.pixels
