"""The panel of the camera path: its views as a list, instead of the inspector."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from open3d.visualization import gui

from v3studio.gui.drawing.areas import Areas
from v3studio.gui.drawing.canvas import Canvas, line_height, text_width, wrapped
from v3studio.gui.drawing.palette import ACCENT, ACCENT_DARK, BAD, BORDER, DIM, FAINT, LINE, PANEL, RAISED, TEXT
from v3studio.gui.models.camera_path import PathEditor
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.thumbnails import Thumbnails
from v3studio.gui.widgets.picture import ImagePanel
from v3studio.studio.formats.camera_path import Key

THUMBNAIL = (16, 9)  # shape of a thumbnail

EASING_WORDS = {"smooth": "smooth", "ease": "slow ends", "linear": "straight", "hold": "hold"}
BUTTONS = (("add", "Add"), ("preview", "Preview"), ("export", "Export..."), ("clear", "Clear"))
ROW_BUTTONS = ("up", "down", "view", "remove")
HINTS = {
    "add": "Add the view on screen, after the selected one (K)",
    "preview": "Play the path in the viewport; a click stops it",
    "export": "Write a movie along the path",
    "clear": "Remove all views",
    "close": "Show the inspector again (P)",
    "row": "Go to this view",
    "time": "When it is reached; later views move by as much",
    "easing": "How the camera moves to the next view; a click changes it",
    "up": "Move it before the one above",
    "down": "Move it behind the one below",
    "view": "Replace it by the view on screen",
    "remove": "Remove it",
}


@dataclass
class PathList:
    """The image of the list, and its parts. `areas`: what can be clicked: key of `HINTS`, and row, -1 for none."""

    width: int
    height: int
    em: float
    down: float = 0.0
    areas: Areas[tuple[str, int]] = field(default_factory=Areas)

    @property
    def thumbnail_size(self) -> tuple[int, int]:
        """(width, height) of a thumbnail, pixels."""
        wide = max(round(5.2 * self.em), 16)
        return wide, wide * THUMBNAIL[1] // THUMBNAIL[0]

    @property
    def row_height(self) -> float:
        """Pixels."""
        return self.thumbnail_size[1] + 0.6 * self.em

    def most_down(self, count: int) -> float:
        """Return how far the rows can be scrolled, pixels."""
        return max(count * self.row_height - (self.height - self._top), 0.0)

    def _buttons(self) -> list[tuple[float, float, float]]:
        """Left, top and width of each of `BUTTONS`, in lines."""
        places, x, y = [], 0.6 * self.em, 2.3 * self.em
        for _, label in BUTTONS:
            wide = text_width(label, round(0.9 * self.em)) + 1.1 * self.em
            if x + wide > self.width - 0.6 * self.em:
                x, y = 0.6 * self.em, y + 1.95 * self.em
            places.append((x, y, wide))
            x += wide + 0.35 * self.em
        return places

    @property
    def _top(self) -> float:
        return self._buttons()[-1][1] + 2.2 * self.em

    def draw(
        self,
        keys: Sequence[Key],
        thumbnails: Sequence[np.ndarray | None],
        selected: int | None,
        previewing: bool,
        message: str = "",
    ) -> np.ndarray:
        """(height, width, 3) uint8: the list. `message`: shown instead of it."""
        self.areas = Areas()
        canvas, em = Canvas(self.width, self.height, PANEL), self.em
        pad, normal = 0.6 * em, round(0.94 * em)
        self._rows(canvas, keys, thumbnails, selected)
        canvas.rect(0, 0, self.width, self._top - 2, PANEL)
        canvas.text(pad, 0.4 * em, "Camera path", normal, TEXT)
        seconds = keys[-1].time if keys else 0.0
        words = f"{len(keys)} view{'s' * (len(keys) != 1)}, {seconds:.1f} s"
        canvas.text(self.width - pad - 1.6 * em, 0.4 * em, words, normal, DIM, align="right")
        canvas.icon(self.width - pad - 0.9 * em, 0.55 * em, "row remove", 0.85 * em)
        self.areas.add((self.width - pad - 1.3 * em, 0, 1.9 * em, 1.9 * em), ("close", -1))
        canvas.rect(pad, 1.95 * em, self.width - 2 * pad, 1, LINE)
        size = round(0.9 * em)
        for (key, label), (x, y, wide) in zip(BUTTONS, self._buttons(), strict=True):
            enabled = key == "add" or len(keys) > (0 if key == "clear" else 1)
            pressed = key == "preview" and previewing
            ground, color, border = ACCENT_DARK if pressed else RAISED, *((TEXT, BORDER) if enabled else (FAINT, FAINT))
            canvas.button(x, y, wide, 1.7 * em, "Stop" if pressed else label, size, ground, color, border)
            if enabled:
                self.areas.add((x, y, wide, 1.7 * em), (key, -1))
        if message or not keys:
            words = message or "Choose a view and a frame, then press Add or K. Two views make a movie."
            lines = wrapped(words, normal, self.width - 2 * pad)
            canvas.lines(pad, self._top, lines, normal, BAD if message else DIM)
        return canvas.pixels

    def _rows(
        self, canvas: Canvas, keys: Sequence[Key], thumbnails: Sequence[np.ndarray | None], selected: int | None
    ) -> None:
        em, small, first = self.em, round(0.85 * self.em), self._top
        wide, high = self.thumbnail_size
        for number, (key, picture) in enumerate(zip(keys, thumbnails, strict=True)):
            y = first + number * self.row_height - self.down
            if y + self.row_height < first or y > self.height:
                continue
            if number == selected:
                canvas.rect(0, y, self.width, self.row_height, RAISED)
                canvas.rect(0, y, 3, self.row_height, ACCENT)
            self.areas.add((0, y, self.width, self.row_height), ("row", number))
            left, top = 0.6 * em, y + 0.3 * em
            if picture is None:
                canvas.rect(left, top, wide, high, LINE)
            else:
                canvas.image(left, top, picture)
            x = left + wide + 0.6 * em
            canvas.text(x, top, f"{number + 1}", small, DIM)
            self._link(canvas, x + 1.4 * em, top, f"{key.time:.2f} s", small, "time" if number else "", number)
            canvas.text(self.width - 0.6 * em, top, f"frame {key.frame}", small, DIM, align="right")
            if number + 1 < len(keys):
                self._link(canvas, x, top + 1.5 * em, EASING_WORDS[key.easing], small, "easing", number)
            if number == selected:
                self._row_buttons(canvas, top + 1.35 * em, number, len(keys))

    def _row_buttons(self, canvas: Canvas, y: float, number: int, count: int) -> None:
        em, side = self.em, 1.45 * self.em
        x = self.width - 0.5 * em - len(ROW_BUTTONS) * side
        for name in ROW_BUTTONS:
            enabled = not (name == "up" and number == 0) and not (name == "down" and number == count - 1)
            canvas.icon(x + 0.3 * em, y + 0.3 * em, f"row {name}", 0.85 * em, TEXT if enabled else FAINT)
            if enabled:
                self.areas.add((x, y, side, side), (name, number))
            x += side

    def _link(self, canvas: Canvas, x: float, y: float, words: str, size: int, key: str, row: int) -> None:
        wide = canvas.text(x, y, words, size, ACCENT if key else TEXT)
        if key:
            self.areas.add((x - 2, y - 2, wide + 4, line_height(size) + 2), (key, row))


class PathPanel:
    """Shows the views of the camera path. `act`: called with a key of `HINTS` for a click, and the view or -1."""

    def __init__(
        self, player: PlayerPresenter, editor: PathEditor, thumbnails: Thumbnails, em: float,
        act: Callable[[str, int], None], changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self._player, self._editor, self._thumbnails = player, editor, thumbnails
        self._em, self._act, self._changed = em, act, changed
        self.shown = False
        self.picture = ImagePanel(self._on_mouse)
        self.picture.widget.visible = False
        self._down = 0.0
        self.list = PathList(16, 16, em)

    def _pictures(self) -> list[np.ndarray | None]:
        """Thumbnails of the views, None while they are being drawn, and while frames are played."""
        player, editor = self._player, self._editor
        opened = player.opened
        if opened is None or player.transport.playing:
            return [None] * len(editor.keys)
        return [
            None
            if frame is None
            else self._thumbnails.get(opened.path, player.contents, key.camera, frame, self.list.thumbnail_size)
            for key, frame in zip(editor.keys, editor.frames, strict=True)
        ]

    def update(self, previewing: bool) -> bool:
        """Draw what has changed; returns whether anything did."""
        if not self.picture.widget.visible:
            return False
        editor, size, thumbnails = self._editor, self.picture.size, self._pictures()
        state = (
            size, editor.keys, editor.selected, editor.error, previewing, self._down,
            [id(thumbnail) for thumbnail in thumbnails],
        )  # fmt: skip

        def draw() -> np.ndarray:
            self.list = PathList(*size, self._em, self._down)
            self._down = self.list.down = min(self._down, self.list.most_down(len(editor.keys)))
            return self.list.draw(editor.keys, thumbnails, editor.selected, previewing, editor.error)

        return self.picture.update(state, draw)

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        if event.type == kind.WHEEL:
            most = self.list.most_down(len(self._editor.keys))
            self._down = min(max(self._down - 2 * self._em * event.wheel_dy, 0.0), most)
            self._changed()
            return True
        hit = self.list.areas.at(x, y)
        if event.type == kind.MOVE:
            self.picture.widget.tooltip = HINTS[hit[0]] if hit is not None else ""
        if event.type != kind.BUTTON_DOWN or hit is None:
            return False
        self._act(*hit)
        self._changed()
        return True
