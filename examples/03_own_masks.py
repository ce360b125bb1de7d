"""Use your own source of masks in a take.

The function receives each image with its camera and frame, and returns a mask from 0 to 1, 1 = performer. It could run
a network or call a service. Here it compares the image with a clean plate.

`@v3.FunctionMaskSource` makes it a source that `capture.masks` can name, here as the function itself. In a YAML file
and on the command line, it is `capture.masks: 03_own_masks:performer`, with this file's folder in PYTHONPATH.
"""

import argparse
import functools
import tempfile
from pathlib import Path

import cv2
import numpy as np

import v3studio as v3

SAMPLE = Path(__file__).resolve().parents[1] / "sample_captures" / "dance16"
PLATES = SAMPLE / "clean_plates"


@functools.cache
def plate_of(camera: str) -> np.ndarray:
    """(H, W, 3) float32 RGB of the empty set."""
    return cv2.imread(str(PLATES / f"{camera}.png"))[:, :, ::-1].astype(np.float32)


@v3.FunctionMaskSource(files=sorted(PLATES.glob("*.png")))  # if one changes, the stages that use masks run again
def performer(image: np.ndarray, camera: str, frame: int) -> np.ndarray:
    """(H, W) floats from (H, W, 3) uint8 RGB. Called from several threads."""
    difference = np.abs(image.astype(np.float32) - plate_of(camera)).max(axis=2)
    return np.clip((cv2.GaussianBlur(difference, (0, 0), 1.5) - 8) / 24, 0, 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--take", help="folder of the take (default: a temporary folder)")
    folder = parser.parse_args().take or f"{tempfile.mkdtemp()}/take"
    settings = {
        "capture.root": str(SAMPLE),
        "capture.masks": performer,
        "capture.cameras": [f"cam{number:02d}" for number in range(1, 16, 2)],
        "capture.frames": ":1",
        "capture.scale": 0.25,
        "initialize.points": 2000,
        "initialize.resolution": 64,
    }
    take = v3.Take.create(folder)
    v3.run(take, settings, stages=("calibrate", "initialize"))

    capture = v3.load_config(take.config).capture  # as any other program finds it
    footage = v3.open_footage(capture, v3.read_rig(take.rig))
    view = footage.view("cam03", footage.frames[0])
    print(f"masks: {capture.masks}")
    print(f"{view.camera!r}: {(view.mask > 127).mean():.1%} performer")
    assert 0.01 < (view.mask > 127).mean() < 0.5


if __name__ == "__main__":
    main()
