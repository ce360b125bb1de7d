"""Makes the images of gui/help from runs of the sample capture: good ones, and bad ones with wrong settings.

    python scripts/help_pictures.py TAKE WORK

TAKE is a finished take of the sample capture (`make demo`). The takes with wrong settings are made in the folder WORK,
which is kept: running it again only draws. Takes about a quarter of an hour on two cores.
"""

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from v3studio.gui.drawing.compare import difference, heat
from v3studio.gui.models.scene.compose import draw
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.models.worker import close_all
from v3studio.gui.pages.calibrate.view import CalibrateView
from v3studio.gui.pages.initialize import InitializeView
from v3studio.pipelines.config import load_config
from v3studio.pipelines.stages.compared_view import performer_over
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.stream import StreamReader

ROOT = Path(__file__).resolve().parent.parent
CONFIG = ROOT / "sample_configs" / "quickstart.yaml"
SIZE = (560, 400)
FRAME, CAMERA = 14, "cam05"  # held out
SHORT = (
    "--capture.frames",
    "14:16",
    "--capture.set",
    "none",
    "--run.check_rig",
    "false",
    "--train.group_size",
    "2",
    "--run.threads",
    "1",
)
SWAPPED = ("cam03", "cam04")
WRONG: dict[str, tuple[str, ...]] = {
    "masks": (*SHORT, "--until", "initialize", "--capture.mask_sensitivity", "0.5"),
    "swapped": (*SHORT, "--until", "initialize"),
    "few": (
        *SHORT, "--initialize.points", "2000", "--train.max_splats", "1500", "--train.densify_max_splats", "2000",
        "--train.keyframe_iterations", "300", "--train.densify_from", "50", "--train.densify_until", "200",
        "--train.prune_finetune_iterations", "50",
    ),
    "late": (
        *SHORT, "--capture.offsets", "{cam01: 4, cam04: 4, cam07: 4, cam10: 4, cam13: 4}", "--initialize.points",
        "20000", "--train.max_splats", "20000", "--train.densify_max_splats", "24000", "--train.keyframe_iterations",
        "700", "--train.densify_from", "100", "--train.densify_until", "500", "--train.prune_finetune_iterations",
        "100",
    ),
}  # fmt: skip
"""Options of the takes with wrong settings."""


def run(take: Path, *options: str) -> None:
    """Run a take; what is finished is not run again."""
    program = Path(sys.executable).with_name("v3studio")
    source = take / "config.yaml" if (take / "config.yaml").is_file() else CONFIG
    subprocess.run([str(program), "run", str(source), "--take", str(take), *options], check=True)


def swapped_cameras(work: Path) -> Path:
    """The capture's camera file with two cameras swapped."""
    cameras = json.loads((ROOT / "sample_captures" / "dance16" / "cameras.json").read_text(encoding="utf-8"))
    names = dict(zip(SWAPPED, reversed(SWAPPED), strict=True))
    for camera in cameras["cameras"]:
        camera["name"] = names.get(camera["name"], camera["name"])
    work.mkdir(parents=True, exist_ok=True)
    path = work / "swapped_cameras.json"
    path.write_text(json.dumps(cameras), encoding="utf-8")
    return path


def context_of(take: Path) -> Inputs:
    """Collect the facts about a take that the help's images show."""
    return Inputs(Take(take), load_config(Take(take).config))


def outline(take: Path) -> np.ndarray:
    """Footage with the mask's outline, cut out around the performer."""
    import cv2

    from v3studio.gui.drawing.palette import ACCENT

    footage = context_of(take).calibrated_footage
    image = footage.raw_image(CAMERA, FRAME).astype(np.float32)
    mask = footage.raw_mask(CAMERA, FRAME)[..., None] / np.float32(255)
    shown = (image * (0.35 + 0.65 * mask)).astype(np.uint8)
    edge = cv2.morphologyEx((mask > 0.5).astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((2, 2), np.uint8)) > 0
    shown[edge] = ACCENT
    return shown


def performer_box(good: Path) -> tuple[slice, slice]:
    """Rows and columns around the performer in the camera's footage, of the images' shape."""
    mask = context_of(good).calibrated_footage.raw_mask(CAMERA, FRAME)
    rows, columns = np.flatnonzero((mask > 127).any(1)), np.flatnonzero((mask > 127).any(0))
    high = (rows[-1] - rows[0]) * 1.15
    high = max(high, (columns[-1] - columns[0]) * 1.1 * SIZE[1] / SIZE[0])
    high = min(high, mask.shape[0], mask.shape[1] * SIZE[1] / SIZE[0])
    wide = high * SIZE[0] / SIZE[1]
    y, x = (rows[0] + rows[-1]) / 2, (columns[0] + columns[-1]) / 2
    top = int(np.clip(y - high / 2, 0, mask.shape[0] - high))
    left = int(np.clip(x - wide / 2, 0, mask.shape[1] - wide))
    return slice(top, top + int(high)), slice(left, left + int(wide))


def stage_picture(take: Path, kind: type[CalibrateView | InitializeView], frame: int = 0) -> np.ndarray:
    """A image of the window's view of a stage."""
    workspace = Workspace()
    workspace.open(Take(take))
    view = kind(workspace)
    view.em, view.frame = 12.0, frame
    try:
        pixels = view.draw(SIZE, view.state())
    finally:
        close_all()
        view.forget()
    return np.asarray(pixels)


def render(take: Path, baked: bool, number: int) -> np.ndarray:
    """A held-out camera's render of a trained or decoded frame, counted from the take's first."""
    inputs = context_of(take)
    if baked:
        with StreamReader.open(inputs.take.stream) as reader:
            gaussians = reader.gaussians(number)
    else:
        gaussians = read_frame(inputs.take.trained_files()[0][number])
    return draw(gaussians, inputs.calibrated_footage.rig[CAMERA], (0.0, 0.0, 0.0))


def difference_map(take: Path, number: int, good: Path) -> np.ndarray:
    """Heat map of a held-out camera's render against its footage of the frame, over black."""
    footage = performer_over(context_of(good).calibrated_footage, CAMERA, FRAME, (0.0, 0.0, 0.0))
    return heat(difference(render(take, True, number), footage))


def save(path: Path, pixels: np.ndarray) -> None:
    import cv2

    shown = cv2.resize(pixels, SIZE, interpolation=cv2.INTER_CUBIC if pixels.shape[1] < SIZE[0] else cv2.INTER_AREA)
    cv2.imwrite(str(path), shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 82])
    print(path, path.stat().st_size)


def pictures(take: Path, work: Path) -> Iterator[tuple[str, np.ndarray]]:
    """(name, pixels) of every image."""
    box = performer_box(take)
    group_1 = 15  # its first frame
    yield "capture_good", outline(take)[box]
    yield "capture_bad", outline(work / "masks")[box]
    yield "calibrate_good", stage_picture(take, CalibrateView)
    yield "calibrate_bad", stage_picture(work / "swapped", InitializeView)
    yield "initialize_good", stage_picture(take, InitializeView, frame=group_1)
    yield "initialize_bad", stage_picture(work / "masks", InitializeView)
    yield "train_good", render(take, False, FRAME)[box]
    yield "train_bad", render(work / "few", False, 0)[box]
    yield "bake_good", render(take, True, FRAME)[box]
    yield "bake_bad", render(work / "coarse", True, FRAME)[box]
    yield "review_good", difference_map(take, FRAME, take)[box]
    yield "review_bad", difference_map(work / "late", 0, take)[box]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("work", type=Path)
    options = parser.parse_args()
    for name, values in WRONG.items():
        rig = ("--capture.rig", str(swapped_cameras(options.work))) if name == "swapped" else ()
        run(options.work / name, *values, *rig)
    coarse = options.work / "coarse"
    if not coarse.exists():
        shutil.copytree(options.take, coarse)
    run(coarse, "--bake.quality", "44")
    for name, pixels in pictures(options.take, options.work):
        save(ROOT / "gui" / "help" / f"{name}.jpg", pixels)


if __name__ == "__main__":
    main()
