"""The worst evaluated frames by camera, as images, and a table of the cameras; choosing one shows it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from open3d.visualization import gui

from v3studio.gui.drawing.canvas import Canvas, line_height
from v3studio.gui.drawing.compare import ALONE, Box, Mode, boxes, label
from v3studio.gui.drawing.palette import DIALOG, DIM, HELD_OUT, RAISED, TEXT
from v3studio.gui.figures import QualityFigures
from v3studio.gui.models.evaluation import Evaluation, WorstFrame
from v3studio.gui.models.loop import LOOP
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.thumbnails import Thumbnails
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.picture import ImagePanel
from v3studio.studio.comparison.metrics import EVALUATED, MAIN

NAME = "worst"
MOST = 9  # frames that are shown
SIZE, TABLE = (66, 30, 8.5), 22
"""Width and height of the image, height of the rest of the dialog, and width of the table in the image; em."""

COLUMNS = ("camera", "mean", "lowest", "frame")
PLACES = (0.5, 0.76, 1.0)  # where the columns of numbers end, shares of the table's width

Pictures = Callable[[WorstFrame, tuple[int, int]], np.ndarray | None]
"""The image of a frame as a camera sees it, in a size; None while it is being rendered."""


@dataclass(frozen=True)
class WorstSheet:
    """The image in the dialog. `number`: gives the number by which people know a frame."""

    size: tuple[int, int]
    em: float
    evaluation: Evaluation
    number: Callable[[int], int]

    @cached_property
    def frames(self) -> Sequence[tuple[WorstFrame, Box]]:
        """The frames, the worst first, and where each is."""
        worst = self.evaluation.worst(MOST)
        room = (round(self.size[0] - TABLE * self.em), self.size[1])
        return list(zip(worst, boxes(room, max(len(worst), 1), 1.0), strict=False))

    def draw(self, pictures: Pictures) -> np.ndarray:
        """(height, width, 3) uint8."""
        canvas, em, small = Canvas(*self.size, DIALOG), self.em, round(0.8 * self.em)
        step = line_height(small) + 0.3 * em
        held_out = self.evaluation.held_out
        for frame, box in self.frames:
            canvas.rect(box.x, box.y, box.width, box.height, RAISED)
            picture = pictures(frame, (box.width, box.height))
            if picture is not None:
                canvas.image(box.x, box.y, picture)
            label(canvas, box.x, box.y, MAIN.text(frame.value), size=small)
            words = f"frame {self.number(frame.frame)}, camera {frame.camera}"
            color = HELD_OUT if held_out else TEXT
            label(canvas, box.x, box.y + box.height - 2 * step, words, color=color, size=small)
            label(canvas, box.x, box.y + box.height - step, _parts(frame), color=DIM, size=small)
        self._table(canvas, self.size[0] - (TABLE - 1.5) * em, (TABLE - 1.5) * em, small)
        return canvas.pixels

    def _table(self, canvas: Canvas, left: float, width: float, size: int) -> None:
        step, y = line_height(size) + 2, 0.0
        rows = [COLUMNS]
        for worst in self.evaluation.worst_by_camera():
            mean = self.evaluation.mean(worst.camera)
            words = "" if mean is None else MAIN.text(mean)
            rows.append((worst.camera, words, MAIN.text(worst.value), str(self.number(worst.frame))))
        for at, (name, *numbers) in enumerate(rows):
            canvas.text(left, y, name, size, TEXT if at else DIM, width=0.25 * width)
            for words, place in zip(numbers, PLACES, strict=True):
                canvas.text(left + place * width, y, words, size, TEXT if at else DIM, "right")
            y += step


def _parts(frame: WorstFrame) -> str:
    """The parts of the main metric: a low one along the outline is an error of the mask or of the cameras, a low one
    inside of the splats."""
    parts = [metric for metric in EVALUATED if metric is not MAIN and metric.title.startswith(MAIN.title)]
    known = [(metric, frame.measures.get(f"{metric.name}_decoded")) for metric in parts]
    return ", ".join(
        f"{metric.title.removeprefix(MAIN.title).strip()} {value:.1f}" for metric, value in known if value is not None
    )


class WorstActions:
    """Shows the worst frames in a dialog, each compared with the footage of its camera once it is clicked.
    `look_through`: shows the performer from a camera."""

    def __init__(
        self, player: PlayerPresenter, quality: QualityFigures, thumbnails: Thumbnails, dialogs: Dialogs,
        look_through: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._player, self.quality, self._thumbnails = player, quality, thumbnails
        self._dialogs, self._look_through = dialogs, look_through
        self._images: dict[tuple[int, ...], gui.UIImage] = {}  # of all openings
        thumbnails.changed.connect(self._update)

    def show(self) -> None:
        dialogs, evaluation = self._dialogs, self.quality.evaluation
        sheet = self._sheet = WorstSheet(dialogs.fitting(*SIZE), dialogs.em, evaluation, self._player.transport.number)
        self._picture = ImagePanel(self._on_mouse, self._images)
        self._picture.show(sheet.draw(self._image))
        words = (
            f"{MAIN.title} of decoded frames in {evaluation.kind} cameras, the lowest first. Click one to compare it."
        )
        parts = [dialogs.label(words), self._picture.widget]
        earlier = " of an earlier bake" if evaluation.stale else ""
        dialogs.show(NAME, f"Worst frames{earlier}", parts, [("close", "Close", dialogs.close)], 110, dialogs.close)
        dialogs.widgets["sheet"] = self._picture.widget
        dialogs.pictures = [self._picture]
        dialogs.parts["sheet"] = lambda: {
            f"{worst.camera} {worst.frame}": box.middle(sheet.size) for worst, box in sheet.frames
        }

    def _update(self) -> None:
        """Another image has been rendered."""
        if self._dialogs.name == NAME:
            self._picture.show(self._sheet.draw(self._image))

    def _image(self, worst: WorstFrame, size: tuple[int, int]) -> np.ndarray | None:
        player = self._player
        if player.opened is None or player.opened.rig is None or worst.camera not in player.camera_names:
            return None
        camera = player.opened.rig[worst.camera].undistorted()
        view = ImageZoom.around(player.points, camera, *size).camera(camera, *size)
        return self._thumbnails.get(player.opened.path, player.contents, view, worst.frame, size)

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        frame = next((frame for frame, box in self._sheet.frames if box.holds(x, y)), None)
        if event.type == gui.MouseEvent.Type.BUTTON_UP and frame is not None:  # until then, it holds the pressed widget
            LOOP.post(lambda: self._choose(frame))  # the toolkit still uses the widget that would be closed
        return event.type != gui.MouseEvent.Type.MOVE

    def _choose(self, worst: WorstFrame) -> None:
        player = self._player
        self._dialogs.close()
        self._look_through(worst.camera)
        if player.mode in ALONE:
            player.choose_mode(Mode.SIDE_BY_SIDE)
        player.transport.pause()
        player.transport.seek(worst.frame)
