"""Train: live curves, and the latest render of a held-out camera next to its footage."""

from collections.abc import Hashable
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height
from v3studio.gui.drawing.compare import boxes
from v3studio.gui.drawing.palette import DIM, GROUND, RAISED, TEXT
from v3studio.gui.drawing.plots import curve, legend
from v3studio.gui.models.scene.compose import draw
from v3studio.gui.models.stages import performer_over
from v3studio.gui.models.take.run_state import Curve
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.stage_view import Size, StageView, sentence
from v3studio.pipelines.runs.staleness import MISSING
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers, frames_so_far
from v3studio.studio.errors import StudioError

CURVES = (
    ("loss", "Loss", "{:.4f}"),
    ("psnr", "PSNR of the training views (dB)", "{:.2f}"),
    ("splats", "Splats", "{:,.0f}"),
)

NOT_RUN = "No values yet."


class TrainView(StageView):
    """The curves of the run, and its newest render beside the footage."""

    modes = (ViewMode.PROGRESS, ViewMode.CAMERA_COLORS)  # the last is `CameraColorsView`'s

    def state(self) -> Hashable:
        """The run's metrics and previews, and the trained frames."""
        run, take = self.workspace.run, self.workspace.take
        preview = max((event.time for event in run.previews.values()), default=0.0)
        points = sum(len(line.positions) for lines in list(run.curves.values()) for line in list(lines.values()))
        what = (take, self.workspace.problem, run.results, preview, points, run.stage, run.outcome)
        return (*what, self.nothing, self.em)

    @property
    def nothing(self) -> str:
        """The words instead of curves where there are none."""
        status = self.workspace.assessment.stages.get("train")
        return NOT_RUN if status is not None and status.state == MISSING else "The last run has trained nothing."

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        context = self.workspace.context
        if context is None:
            return sentence(size, self.workspace.without_settings, self.em)
        canvas = Canvas(*size, GROUND)
        run, em = self.workspace.run, self.em
        if not any(run.curves.values()):  # more room for the images
            canvas.text(em, 0.7 * em, self.nothing, round(0.85 * em), DIM)
            self._pictures(canvas, 2.4 * em)
            return canvas.pixels
        share = 0.44 * size[1]
        each = (size[0] - 4 * em) / 3
        small, top = round(0.85 * em), 0.7 * em
        numbers = [f"{group}" for group in sorted(run.curves.get("loss", {}))]
        if len(numbers) > 1:  # their curves have different colors
            legend(canvas, em, 0.5 * em, size[0] - 2 * em, small, "Groups", numbers)
            top += line_height(small)
        for number, (name, title, form) in enumerate(CURVES):
            groups = sorted(run.curves.get(name, {}).items())
            lines = [line for _, line in groups]
            last = max((line for line in lines if line.values), key=lambda line: line.positions[-1], default=None)
            newest = form.format(last.values[-1]) if last is not None else ""
            area = (em + number * (each + em), top, each, share - top - 0.3 * em)
            if name == "splats" and last is not None and last.values[-1] > context.config.train.max_splats:
                title += " before pruning"  # which leaves so many: densification may make more
            short = title if each > 15 * em else title.split(" of ")[0]
            series = [snapshot(line) for line in lines]
            curve(canvas, area, short, series, em, newest, self.nothing)
        self._pictures(canvas, share)
        return canvas.pixels

    def _pictures(self, canvas: Canvas, top: float) -> None:
        """Draw the newest render beside its footage."""
        em, small = self.em, round(0.85 * self.em)
        try:
            words, render, footage = self._newest()
        except StudioError as error:
            words = str(error)
            canvas.text(em, top + em, words[:1].upper() + words[1:], small, DIM, width=canvas.width - 2 * em)
            return
        canvas.text(em, top, words, small, DIM, width=canvas.width - 2 * em)
        top, below = top + line_height(small), line_height(small)
        room = (round(canvas.width - 2 * em), round(canvas.height - top - em))
        cells = boxes(room, 2, render.shape[1] / render.shape[0], below)
        for (name, picture), box in zip((("footage", footage), ("trained", render)), cells, strict=True):
            x, y, high = em + box.x, top + box.y, box.height - below
            if picture is None:
                canvas.rect(x, y, box.width, high, RAISED)
                name = "footage cannot be read"
            else:
                canvas.fit_image(x, y, box.width, high, picture)
            canvas.text(x + box.width / 2, y + high + 2, name, small, TEXT, "middle", box.width)

    def _newest(self) -> tuple[str, np.ndarray, np.ndarray | None]:
        """Caption, latest render from a held-out camera, and the camera's footage."""
        take, context = self.workspace.take, self.workspace.context
        if take is None or context is None:
            raise StudioError("gui.no_take", "no take is open", fix="Open a take.")
        if not take.rig.is_file():
            fix = "They appear here as Train and the stages before it run."
            raise StudioError("take.no_cameras", "no trained frames and no cameras yet", fix=fix)
        footage = context.trained_footage
        held_out = footage.measured_cameras
        run = self.workspace.run
        preview = max(run.previews.values(), key=lambda event: event.time, default=None)
        if preview is not None and Path(preview.path).is_file() and preview.camera and preview.frame is not None:
            pixels = cv2.imread(preview.path)
            if pixels is not None and preview.camera in footage.camera_names and preview.frame in footage.frames:
                step = f", step {preview.iteration}" if preview.iteration is not None else ""
                render = np.ascontiguousarray(pixels[..., ::-1])
                words = f"{_kind(preview.camera, held_out)}, frame {preview.frame}{step}"
                return words, render, self._footage(preview.camera, preview.frame)
        files, groups = frames_so_far(take)
        if not files:
            raise StudioError("take.not_trained", "no trained frames yet", fix="They appear here as Train runs.")
        camera = (*held_out, *footage.train_cameras)[0]
        index = max(files)
        view = footage.rig[camera]
        view = view.scaled(min(1.0, 640 / view.width))
        background = context.config.evaluate.background
        render = draw(read_frame(files[index]), view, background)
        number = FrameNumbers.of(groups).number(index)
        return f"{_kind(camera, held_out)}, frame {number}", render, self._footage(camera, number)

    def _footage(self, camera: str, frame: int) -> np.ndarray | None:
        """A camera's image of a frame, by its number in the footage; None if it cannot be read."""
        context = self.workspace.context
        assert context is not None
        with suppress(StudioError):
            return performer_over(context.trained_footage, camera, frame, context.config.evaluate.background)
        return None

    @property
    def status(self) -> str:
        """The current training step."""
        progress = self.workspace.run.progress
        return progress.label if progress is not None and progress.stage == "train" else ""


def snapshot(line: Curve) -> tuple[list[float], list[float]]:
    """Positions and values, of equal length although the window's thread may be appending."""
    xs, ys = list(line.positions), list(line.values)
    count = min(len(xs), len(ys))
    return xs[:count], ys[:count]


def _kind(camera: str, held_out: tuple[str, ...]) -> str:
    return f"{'held-out' if camera in held_out else 'training'} camera {camera}"
