"""Use your own matting function.

The function takes an (H, W, 3) uint8 RGB image and returns an (H, W) mask, 0 to 1, 1 = performer. It could run a
network or call a service. Here it compares the image with a clean plate.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

import v3studio as v3

SAMPLE = Path(__file__).resolve().parents[1] / "sample_captures" / "walk16"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--camera", default="cam03")
    parser.add_argument("--out", type=Path, help="write the mask to this PNG file")
    arguments = parser.parse_args()

    plate = cv2.imread(str(SAMPLE / "clean_plates" / f"{arguments.camera}.png"))[:, :, ::-1].astype(np.float32)

    def mask_of(image: np.ndarray) -> np.ndarray:
        difference = np.abs(image.astype(np.float32) - plate).max(axis=2)
        return np.clip((cv2.GaussianBlur(difference, (0, 0), 1.5) - 8) / 24, 0, 1)

    settings = v3.CaptureSettings(root=SAMPLE, masks="none", cameras=(arguments.camera,))
    rig = v3.read_rig(SAMPLE / "cameras.json").subset([arguments.camera])
    footage = v3.open_footage(settings, rig).with_mask_source(
        v3.FunctionMaskSource(mask_of, "difference from the clean plate")
    )
    view = footage.view(arguments.camera, footage.frames[0])
    print(f"{arguments.camera}: {view.mask.shape[1]}x{view.mask.shape[0]}, {(view.mask > 127).mean():.1%} performer")
    assert 0.01 < (view.mask > 127).mean() < 0.5
    if arguments.out:
        cv2.imwrite(str(arguments.out), view.mask)


if __name__ == "__main__":
    main()
