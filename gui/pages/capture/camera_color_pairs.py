"""Train, camera colors: every camera's image as filmed, and in the colors of the mean camera."""

import time
from collections.abc import Hashable

import cv2
import numpy as np
import torch

from v3studio.gui.drawing.canvas import Canvas, wrapped
from v3studio.gui.drawing.compare import boxes
from v3studio.gui.drawing.palette import BAD, DIM, GROUND, RAISED, TEXT
from v3studio.gui.models.stages import Inputs
from v3studio.gui.models.take.workspace import Workspace, modified
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.stage_view import Size, StageView, rectangle, sentence
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.results.stage_files import CameraColors
from v3studio.studio.cameras import FootageView
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.memory_cache import MemoryCache

OFF = (
    "The colors of the cameras are not corrected. If cameras differ in exposure, white balance or model, set "
    "'camera colors'; their images are then compared here."
)

NOT_YET = "The colors of the cameras are fitted at the start of training. Run Train."

TALLEST = 320  # most rows of an image
SECONDS = 0.7  # images are read for so long before what there is so far is drawn
MARGIN = 0.08  # space around the performer, as a share of its size


_Pictures = dict[str, tuple[np.ndarray, np.ndarray] | str]  # by camera, (H, W, 3) uint8; or why there are none


class CameraColorsView(StageView):
    """Draws the pairs; images are read bit by bit, as the state changes with each camera whose images were read."""

    modes = (ViewMode.CAMERA_COLORS,)

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._fits: MemoryCache[Hashable, tuple[CameraColors, _Pictures]] = MemoryCache(1)

    def state(self) -> Hashable:
        """The fit, and how many cameras' images were read."""
        context = self.workspace.context
        if context is None:
            return self.em
        of = self._of(context)
        fit = self._fits.get(of)
        return (of, len(fit[1]) if fit is not None else 0, self.em)

    def _of(self, context: Inputs) -> tuple[Hashable, ...]:
        path = context.take.camera_colors
        return (path, modified(path), context.config.train.camera_colors, context.config.capture.model_dump_json())

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        """Draw the pairs. Raises StudioError: the file of the colors is damaged, or there is no footage."""
        context, em = self.workspace.context, self.em
        self.places = []
        if context is None:
            return sentence(size, self.workspace.without_settings, em)
        if context.config.train.camera_colors is None:
            return sentence(size, OFF, em)
        if not context.take.camera_colors.is_file():
            return sentence(size, NOT_YET, em)
        path = context.take.camera_colors
        colors, pictures = self._fits.get_or_make(self._of(context), lambda _: (read_model(path, CameraColors), {}))
        self._read(context, colors, pictures)
        return self._drawn(size, colors, pictures)

    def _read(self, context: Inputs, colors: CameraColors, pictures: _Pictures) -> None:
        footage, frame = context.calibrated_footage, context.groups[0].keyframe
        until = time.monotonic() + SECONDS
        for name in [camera for camera in colors.cameras if camera not in pictures]:
            try:
                missing = name not in footage.camera_names
                pictures[name] = "not in the footage" if missing else pair(footage.view(name, frame), colors)
            except StudioError as error:
                pictures[name] = str(error)
            if time.monotonic() > until:
                return

    def _drawn(self, size: Size, colors: CameraColors, pictures: _Pictures) -> np.ndarray:
        canvas, em = Canvas(*size, GROUND), self.em
        small = round(0.85 * em)
        names = list(colors.cameras)
        words = (
            "Left: as filmed. Right: in the colors of the mean camera, as in the stream. Below: how far off a middle "
            "gray is, out of 255 levels."
        )
        top = 0.3 * em + canvas.lines(em, 0.5 * em, wrapped(words, small, size[0] - 2 * em), small, DIM)
        there = [images for images in pictures.values() if not isinstance(images, str)]
        aspect = float(np.median([2 * images[0].shape[1] / images[0].shape[0] for images in there])) if there else 1.0
        below = small + 8  # of the names
        for name, box in zip(names, boxes((size[0], round(size[1] - top)), len(names), aspect, below), strict=True):
            x, y, width, high = box.x, top + box.y, box.width, box.height - below
            self.places.append((name, rectangle(x, y, width, box.height)))
            images = pictures.get(name)
            if images is None or isinstance(images, str):
                canvas.rect(x, y, width, high, RAISED)
                if images is not None:
                    canvas.lines(x + 6, y + 6, wrapped(images, small, width - 12), small, BAD)
            else:
                for side, picture in enumerate(images):
                    canvas.fit_image(x + side * width / 2, y, width / 2 - 1, high, picture)
            caption = f"{name}: {counted(round(colors.off_on_gray(name)), 'level')}"
            canvas.text(x + width / 2, y + high + 2, caption, small, TEXT, align="middle", width=width)
        return canvas.pixels


def pair(view: FootageView, colors: CameraColors) -> tuple[np.ndarray, np.ndarray]:
    """A camera's image and the image in the colors of the mean camera, (H, W, 3) uint8, cropped to the performer."""
    from v3studio.studio.color_fit import uncorrected
    from v3studio.studio.training.views import mask_box

    name = view.camera.name
    left, top, width, height = mask_box(view.mask, MARGIN, name)
    inside = (slice(top, top + height), slice(left, left + width))
    seen = torch.from_numpy(np.ascontiguousarray(view.image[inside])) / 255
    colors_seen = uncorrected(seen, torch.tensor(colors.cameras[name])).clamp(0, 1)
    corrected = (255 * colors_seen).round().byte().numpy()
    scale = min(1.0, TALLEST / height)
    small = (max(round(scale * width), 1), max(round(scale * height), 1))
    filmed, corrected = (
        cv2.resize(image, small, interpolation=cv2.INTER_AREA) for image in (view.image[inside], corrected)
    )
    return filmed, corrected
