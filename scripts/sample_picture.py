"""Renders the image in the README from a finished take.

    python scripts/sample_picture.py TAKE docs/images/sample.jpg [--frame 14]

Each held-out camera has one row: footage, performer cut out with the exact mask, trained Gaussians, decoded stream,
and the difference between performer and decoded stream, multiplied by 4.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from gui.drawing.canvas import Canvas
from pipelines.config import load_config
from pipelines.reports.images import render, to_bytes
from pipelines.stages.inputs import Inputs
from pipelines.takes.frame_files import read_frame
from pipelines.takes.take import Take
from studio.comparison import padded_box
from studio.stream import StreamReader

HEIGHT, GAP, HEADER = 300, 6, 34
TITLES = ("held-out footage", "performer", "trained", "decoded stream", "difference x4")


def row(context: Inputs, camera: str, index: int) -> list[np.ndarray]:
    """The five images of one camera, cropped to the performer, HEIGHT pixels high."""
    footage = context.footage.trained
    frame = footage.frames[index]
    group = next(one for one in context.groups if index in one.indices)
    view = footage.view(camera, frame)
    exact = footage.evaluation_mask(camera, frame)
    mask = exact.astype(np.float32)[..., None] / 255
    performer = view.image * mask
    trained = read_frame(context.take.finished_frame(group.index, index))
    with StreamReader.open(context.take.stream) as reader:
        decoded = reader.gaussians(index)
    rendered = [to_bytes(render(splats, footage.rig[camera], (0.0, 0.0, 0.0), "cpu")) for splats in (trained, decoded)]
    error = np.abs(performer - rendered[1]).mean(2)
    heat = cv2.applyColorMap(np.clip(4 * error, 0, 255).astype(np.uint8), cv2.COLORMAP_INFERNO)[..., ::-1]
    box = padded_box(exact, context.config.evaluate.crop_padding)
    if box is None:
        raise SystemExit(f"{camera} does not see the performer in frame {frame}; choose another with --frame.")
    images = [view.image, performer, *rendered, heat]
    cropped = [np.ascontiguousarray(image[box]).astype(np.uint8) for image in images]
    scale = HEIGHT / cropped[0].shape[0]
    return [cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) for picture in cropped]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frame", type=int, default=14, help="index in the take (default %(default)s)")
    options = parser.parse_args()
    take = Take.open(options.take)
    context = Inputs(take, load_config(take.config))
    rows = [row(context, camera, options.frame) for camera in context.footage.trained.held_out_cameras]
    width = max(picture.shape[1] for pictures in rows for picture in pictures)
    canvas = Canvas(5 * (width + GAP), HEADER + len(rows) * (HEIGHT + GAP), (0, 0, 0))
    canvas.rect(0, 0, canvas.width, HEADER, (26, 26, 28))
    for number, title in enumerate(TITLES):
        canvas.text(number * (width + GAP) + 8, 8, title, 16, (235, 235, 235))
    for line, pictures in enumerate(rows):
        for number, picture in enumerate(pictures):
            x = number * (width + GAP) + (width - picture.shape[1]) // 2
            y = HEADER + line * (HEIGHT + GAP)
            canvas.pixels[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
    cv2.imwrite(str(options.out), canvas.pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])


if __name__ == "__main__":
    main()
