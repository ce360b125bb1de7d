"""What masks do to a picture: crops of held-out cameras after training with own, refined and exact masks.

    python benchmarks/matte_crops.py OUT [--config FILE] [--figure FILE.jpg] [--threads N]

Trains the first frame of the sample capture (`sample_configs/quickstart.yaml`, full schedule of the keyframe, one seed)
three times, into OUT/own, OUT/refined and OUT/exact; takes that are there are kept. Then draws a figure: one row per
crop, one column per take, the first one the footage cut out with the exact mask, all over black and twice enlarged,
and prints the PSNR of each crop against that. The held-out cameras and the crops below are those of the sample.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from studio.environment import passive_openmp

passive_openmp()  # before torch is imported

ROOT = Path(__file__).parents[1]
ENLARGED = 2
VARIANTS = {
    "own": (),
    "refined": ("train.refine_masks=always",),
    "exact": ("capture.masks=files", "capture.mask_files=mattes/{camera}.mkv", "train.refine_masks=always"),
}
"""Overrides by name. With exact masks, refinement is on as well, so that coverage has the same weight in both."""


@dataclass(frozen=True)
class Crop:
    """A part of a held-out camera's image; corner and size in pixels."""

    name: str
    camera: str
    left: int
    top: int
    width: int
    height: int

    def of(self, image: np.ndarray) -> np.ndarray:
        """That part of an (H, W, ...) image."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]


CROPS = (
    Crop("face", "cam12", 288, 92, 100, 70),
    Crop("hand", "cam12", 328, 192, 100, 70),
    Crop("shoe", "cam12", 268, 266, 100, 70),
    Crop("outline", "cam05", 300, 125, 100, 70),
)


def train(out: Path, config: Path, threads: int) -> dict[str, Path]:
    """Train the takes that are missing; their folders by name."""
    takes = {}
    for name, options in VARIANTS.items():
        takes[name] = out / name
        command = [sys.executable, "-m", "pipelines.cli", "run", str(config), "--take", str(takes[name])]
        command += ["--until", "train"]
        for option in ("capture.stop=1", f"run.threads={threads}", *options):
            command += ["--set", option]
        subprocess.run(command, cwd=ROOT, check=True)
    return takes


def views(take: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """By held-out camera: footage cut out with the exact mask, and the splats; (H, W, 3) float32 over black."""
    from pipelines.config import load_config
    from pipelines.stages.inputs import Inputs
    from pipelines.takes.frame_files import read_frame
    from pipelines.takes.take import Take
    from studio.comparison import ViewPair

    inputs = Inputs(Take.open(take), load_config(Take.open(take).config))
    footage = inputs.footage.calibrated
    gaussians = read_frame(inputs.take.trained_frame(0, 0))
    found = {}
    for camera in dict.fromkeys(crop.camera for crop in CROPS):
        frame = footage.frames[0]
        image, mask = footage.image(camera, frame), footage.evaluation_mask(camera, frame)
        pair = ViewPair.of(gaussians, footage.rig[camera], image, mask, (0, 0, 0))
        found[camera] = (pair.truth, pair.drawn)
    return found


def psnr(drawn: np.ndarray, truth: np.ndarray) -> float:
    """In dB, of two images in 0 to 1."""
    import torch

    from studio import metrics

    return float(metrics.psnr(torch.from_numpy(drawn), torch.from_numpy(truth)))


def figure(seen: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]) -> np.ndarray:
    """(H, W, 3) uint8: a row for each crop, a column for the footage and for each take."""
    rows = []
    for crop in CROPS:
        truth = crop.of(next(iter(seen.values()))[crop.camera][0])
        cells = [labeled(f"{crop.name}, {crop.camera}: footage", truth)]
        for name, images in seen.items():
            drawn = crop.of(images[crop.camera][1])
            cells.append(labeled(f"{name}: {psnr(drawn, truth):.1f} dB", drawn))
        rows.append(np.concatenate(cells, axis=1))
    return np.concatenate(rows)


def labeled(text: str, image: np.ndarray) -> np.ndarray:
    """The image, enlarged without smoothing, below a line of text."""
    import cv2

    large = np.repeat(np.repeat((image.clip(0, 1) * 255 + 0.5).astype(np.uint8), ENLARGED, 0), ENLARGED, 1)
    strip = np.full((18, large.shape[1], 3), 255, np.uint8)
    cv2.putText(strip, text, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return np.pad(np.concatenate([strip, large]), [(0, 2), (0, 2), (0, 0)], constant_values=255)


def main() -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--config", type=Path, default=ROOT / "sample_configs" / "quickstart.yaml")
    parser.add_argument("--figure", type=Path, help="JPEG to write (default OUT/crops.jpg)")
    parser.add_argument("--threads", type=int, default=1, help="CPU threads of training (default %(default)s)")
    arguments = parser.parse_args()

    from pipelines.reports.pictures import encode

    takes = train(arguments.out.absolute(), arguments.config.absolute(), arguments.threads)
    seen = {name: views(take) for name, take in takes.items()}
    print(f"{'crop':<10} {'camera':<8} " + " ".join(f"{name:>9}" for name in seen) + "   (PSNR in dB)")
    for crop in CROPS:
        values = [psnr(crop.of(drawn), crop.of(truth)) for truth, drawn in (one[crop.camera] for one in seen.values())]
        print(f"{crop.name:<10} {crop.camera:<8} " + " ".join(f"{value:>9.2f}" for value in values))
    path = arguments.figure or arguments.out / "crops.jpg"
    path.write_bytes(encode(figure(seen), ".jpg", 88))
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
