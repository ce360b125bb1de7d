"""Renders the image in the README from a finished take.

    python scripts/sample_picture.py TAKE docs/images/sample.jpg [--frame 14]

Each held-out camera has one row: footage, performer cut out with the exact mask, trained Gaussians, decoded stream,
and the difference between performer and decoded stream, multiplied by 4.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from v3studio.pipelines.config import load_config
from v3studio.pipelines.stages.compared_view import compared_cameras, compared_view
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.stream import StreamReader

TITLES = ("held-out footage", "performer", "trained", "decoded stream", "difference x4")


def row(inputs: Inputs, camera: str, index: int) -> list[np.ndarray]:
    """The five images of one camera, cropped to the performer."""
    view = compared_view(inputs, camera, inputs.trained_footage.frames[index])
    if view is None:
        raise SystemExit(f"{camera} does not see the performer in frame {index}; choose another with --frame.")
    trained = view.pair(read_frame(inputs.take.trained_files()[0][index]))
    with StreamReader.open(inputs.take.stream) as reader:
        decoded = view.pair(reader.gaussians(index))
    error = np.minimum(4 * np.abs(decoded.footage - decoded.rendered).mean(2), 1)
    return [view.image[view.box], trained.footage, trained.rendered, decoded.rendered, error]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frame", type=int, default=14, help="index in the take (default %(default)s)")
    options = parser.parse_args()
    take = Take.open(options.take)
    inputs = Inputs(take, load_config(take.config))
    rows = [row(inputs, camera, options.frame) for camera in compared_cameras(inputs.trained_footage)]
    figure = Figure(figsize=(9, 3 * len(rows)), layout="compressed", facecolor="black")
    for line, places in zip(rows, figure.subplots(len(rows), len(TITLES), squeeze=False), strict=True):
        for image, title, axes in zip(line, TITLES, places, strict=True):
            axes.imshow(image, cmap="inferno", vmin=0, vmax=1)
            axes.set_title(title if line is rows[0] else "", color="white")
            axes.axis("off")
    figure.savefig(options.out, dpi=150, bbox_inches="tight")


if __name__ == "__main__":
    main()
