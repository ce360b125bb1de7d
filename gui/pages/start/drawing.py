"""Draws the start page, and tells what is where."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from v3studio.gui.drawing.areas import Areas, Box
from v3studio.gui.drawing.canvas import ROUND, Canvas, line_height, text_width, wrapped
from v3studio.gui.drawing.palette import (
    ACCENT,
    ACCENT_DARK,
    BAD,
    BORDER,
    DIM,
    GOOD,
    GROUND,
    LINE,
    PANEL,
    RAISED,
    RGB,
    STATE_COLORS,
    TEXT,
    State,
)
from v3studio.gui.models.take.take_queue import QueueRow
from v3studio.gui.pages.start.cards import Card, CardKind, date_words
from v3studio.gui.pages.start.page import StartPage
from v3studio.studio.comparison.metrics import MAIN

_NO_IMAGE = {CardKind.WEB: "stream on the web", CardKind.MISSING: "missing", CardKind.UNKNOWN: ""}
BUTTONS = (
    ("new", "New take from footage", "From a folder of videos or images"),
    ("open", "Open take", "Or the folder of a stream"),
    ("address", "Open stream", "By its URL"),
    ("sample", "Try the sample capture", "16 cameras, 30 frames"),
)
NO_SAMPLE = "Comes with the source of V3 Studio"

HINTS = {
    "back": "Go back to the open take or stream (H, Escape)",
    "forget": "Remove entries that no longer exist from the list; no file is touched",
    "remove": "Remove it from the list (Delete); no file is touched",
    "queue": "Add, move, remove and retry takes (Q)",
    "start": "Run the takes of the queue one after another, even while the window is closed",
    "stop": "Stop; the take that runs keeps finished work and waits again",
}

CARD, GAP = 15.5, 1.0  # least width of a card, and the room between cards, em
QUEUE, WIDE = 20.0, 62.0  # width of the column of the queue, and of the page from which on there is one, em

KEYS = "Arrow keys and Enter: choose    Delete: remove from the list    Ctrl+V: open a copied path    ?: all shortcuts"


@dataclass
class StartImage:
    """The image of the page, and its parts."""

    width: int
    height: int
    em: float
    down: float = 0.0
    full: float = 0.0  # height of the page without scrolling, pixels
    # what can be chosen, in the order of reading, by name: "back", a key of `BUTTONS`, "card 0", "forget", "queue",
    # "start", "stop"
    boxes: Areas[str] = field(default_factory=Areas)
    crosses: Areas[str] = field(default_factory=Areas)  # those that remove a card: "remove 0"

    @property
    def most_down(self) -> float:
        """Return how far the page can be scrolled, pixels."""
        return max(self.full + self.down - self.height, 0.0)

    def at(self, x: float, y: float) -> str:
        """The name of the button or card at a position; "" if there is none."""
        return self.crosses.at(x, y) or self.boxes.at(x, y) or ""

    def scrolled_to(self, name: str) -> float:
        """Return how far the page must be scrolled down to show the button or card with a name."""
        for (_, y, _, high), other in self.boxes.all:
            if other == name:
                above, below = min(y - self.em, 0.0), max(y + high + 3 * self.em - self.height, 0.0)
                return min(max(self.down + (above or below), 0.0), self.most_down)
        return self.down

    def draw(self, page: StartPage, hover: str = "", line: str = "") -> np.ndarray:
        """(height, width, 3) uint8: the page. `line`: a passing notice, at the lower edge instead of the keys."""
        self.boxes, self.crosses = Areas(), Areas()
        canvas, em = Canvas(self.width, self.height, GROUND), self.em
        pad = 1.8 * em
        inner = self.width - 2 * pad
        y = 1.3 * em - self.down
        canvas.text(pad, y, "V3 Studio", round(1.75 * em), TEXT)
        if page.back:
            words = f"Back to {page.back} (H)"
            self._button(canvas, pad + inner, y, words, "back", hover, right=True, most=0.6 * inner)
        y += 2.7 * em
        words = "From synchronized multi-camera footage of a performer to a streamable Gaussian video"
        canvas.text(pad, y, words, round(0.94 * em), DIM, width=inner)
        y = self._buttons(canvas, page, pad, y + 2.2 * em, inner, hover) + 1.6 * em
        wide = inner >= WIDE * em
        cards_width = inner - (QUEUE + 1.6) * em if wide else inner
        if wide:
            end = self._cards(canvas, page, pad, y, cards_width, hover)
            end = max(self._queue(canvas, page, pad + cards_width + 1.6 * em, y, QUEUE * em, hover), end)
        else:
            if page.queue.view.rows:
                y = self._queue(canvas, page, pad, y, inner, hover) + 1.4 * em
            end = self._cards(canvas, page, pad, y, cards_width, hover)
        foot = 2.1 * em
        self.full = end + foot + 0.6 * em
        for box, name in self.boxes.all:
            if name == page.focus:
                canvas.rounded(*box, ROUND * em, None, ACCENT, max(round(0.13 * em), 2))
        canvas.rect(0, self.height - foot, self.width, foot, PANEL)
        words, shade = (line, TEXT) if line else (KEYS, DIM)
        canvas.text(pad, self.height - foot + 0.45 * em, words, round(0.88 * em), shade, width=inner)
        return canvas.pixels

    def _buttons(self, canvas: Canvas, page: StartPage, x: float, y: float, width: float, hover: str) -> float:
        em, gap = self.em, 0.8 * self.em
        count = len(BUTTONS) if width >= len(BUTTONS) * 13.5 * em else 2
        wide, high = (width - (count - 1) * gap) / count, 3.7 * em
        for number, (name, label, hint) in enumerate(BUTTONS):
            left, top = x + number % count * (wide + gap), y + number // count * (high + gap)
            on = name != "sample" or page.sample
            ground = ACCENT_DARK if name == "new" else RAISED if name == hover and on else PANEL
            canvas.rounded(left, top, wide, high, ROUND * em, ground, ACCENT if name == hover and on else LINE)
            room = wide - 1.8 * em
            canvas.text(left + 0.9 * em, top + 0.55 * em, label, round(1.05 * em), TEXT if on else DIM, width=room)
            words = hint if on else NO_SAMPLE
            small = round(0.85 * em)
            canvas.text(left + 0.9 * em, top + 2.05 * em, words, small, TEXT if name == "new" else DIM, width=room)
            if on:
                self.boxes.add((left, top, wide, high), name)
        return y + -(-len(BUTTONS) // count) * (high + gap) - gap

    def _cards(self, canvas: Canvas, page: StartPage, x: float, y: float, width: float, hover: str) -> float:
        em, gap = self.em, GAP * self.em
        canvas.text(x, y, "Recent", round(1.1 * em), TEXT)
        if any(card.kind == CardKind.MISSING for card in page.cards.values()):
            self._button(canvas, x + width, y - 0.2 * em, "Remove missing", "forget", hover, right=True)
        y += 2.2 * em
        if not page.places:
            words = "Takes and streams that you open are listed here, with their state, quality and size."
            return self._lines(canvas, words, x, y, width, DIM)
        count = max(int((width + gap) / (CARD * em + gap)), 1)
        wide = (width - (count - 1) * gap) / count
        high = wide * 9 / 16 + 6.5 * em
        for number, place in enumerate(page.places):
            box = (x + number % count * (wide + gap), y + number // count * (high + gap), wide, high)
            card = page.cards.get(place) or Card(place, CardKind.UNKNOWN, "reading ...")
            if box[1] < self.height and box[1] + high > 0:
                self._card(canvas, card, page.pictures.get(place), box, number, hover)
            self.boxes.add(box, f"card {number}")
        return y + -(-len(page.places) // count) * (high + gap) - gap

    def _card(self, canvas: Canvas, card: Card, picture: np.ndarray | None, box: Box, number: int, hover: str) -> None:
        em, (x, y, wide, high) = self.em, box
        under = hover in (f"card {number}", f"remove {number}")
        canvas.rect(x, y, wide, high, RAISED if under else PANEL)
        canvas.frame(x, y, wide, high, ACCENT if under else LINE)
        tall, pad, small = wide * 9 / 16, 0.7 * em, round(0.85 * em)
        if picture is not None:
            size = (max(round(wide) - 2, 1), max(round(tall), 1))
            inter = cv2.INTER_AREA if picture.shape[1] > size[0] else cv2.INTER_LINEAR
            canvas.image(x + 1, y + 1, cv2.resize(picture, size, interpolation=inter))
        else:
            canvas.rect(x + 1, y + 1, wide - 2, tall, GROUND)
            canvas.text(x + wide / 2, y + 0.45 * tall, _NO_IMAGE.get(card.kind, "no image"), small, DIM, "middle")
        top, room = y + tall + 0.5 * em, wide - 2 * pad
        date = date_words(card.changed)
        normal = round(em)
        canvas.text(x + pad, top, card.name, normal, TEXT, width=room - text_width(date, small) - 0.6 * em)
        canvas.text(x + wide - pad, top + 0.1 * em, date, small, DIM, "right")
        top += 1.55 * em
        canvas.dot(x + pad + 0.3 * em, top + 0.58 * em, 0.27 * em, STATE_COLORS[card.state])
        color = BAD if card.state == State.FAILED else TEXT
        canvas.text(x + pad + 0.95 * em, top, card.words, small, color, width=room - em)
        top += 1.35 * em
        current = card.state == State.DONE  # otherwise it may be of earlier settings
        quality = "" if card.quality is None else MAIN.text(card.quality)
        across = canvas.text(x + pad, top, quality, small, GOOD if current else DIM)
        gap = 0.8 * em if across else 0.0
        canvas.text(x + pad + across + gap, top, card.sizes, small, DIM, width=room - across - gap)
        canvas.text(x + pad, top + 1.35 * em, card.folder, small, DIM, width=room)
        if under or card.kind in (CardKind.MISSING, CardKind.DAMAGED):
            side = 1.6 * em
            cross = (x + wide - side, y, side, side)
            canvas.rect(*cross, RAISED)
            canvas.icon(cross[0] + 0.35 * em, cross[1] + 0.35 * em, "row remove", side - 0.7 * em)
            self.crosses.add(cross, f"remove {number}")

    def _queue(self, canvas: Canvas, page: StartPage, x: float, y: float, width: float, hover: str) -> float:
        em, queue = self.em, page.queue
        canvas.text(x, y, "Queue of takes", round(1.1 * em), TEXT)
        y += 2.2 * em
        rows = queue.view.rows
        if queue.view.error or not rows:
            words = queue.view.error or (
                "The queue is empty. Takes in it run one after another, even while the window is closed."
            )
            y = self._lines(canvas, words, x, y, width, BAD if queue.view.error else DIM) + 0.5 * em
        for row in rows:
            y = self._queue_row(canvas, row, x, y, width)
        if rows:
            y = self._lines(canvas, queue.words, x, y + 0.2 * em, width, DIM) + 0.5 * em
        if queue.message:
            y = self._lines(canvas, queue.message, x, y, width, BAD) + 0.5 * em
        across = x
        if queue.running:
            across += self._button(canvas, across, y, "Stop", "stop", hover) + 0.5 * em
        elif any(row.state in (State.WAITING, State.RUNNING) for row in rows):
            across += self._button(canvas, across, y, "Start", "start", hover) + 0.5 * em
        self._button(canvas, across, y, "Edit queue (Q)", "queue", hover)
        return y + 1.9 * em

    def _queue_row(self, canvas: Canvas, row: QueueRow, x: float, y: float, width: float) -> float:
        em, small = self.em, round(0.88 * self.em)
        running = row.state == State.RUNNING
        color = {State.DONE: GOOD, State.FAILED: BAD, State.RUNNING: ACCENT}.get(row.state, DIM)
        words = (row.words or row.state) if running else row.state
        shown = min(text_width(words, small), round(0.62 * width))
        canvas.text(x, y, row.take.name, small, TEXT, width=width - shown - 0.8 * em)
        canvas.text(x + width, y, words, small, color, "right", width=0.62 * width)
        y += line_height(small)
        if running:
            canvas.rect(x, y, width, 0.3 * em, RAISED)
            canvas.rect(x, y, width * (row.fraction or 0.0), 0.3 * em, ACCENT)
            y += 0.6 * em
        if row.state == State.FAILED and row.words:
            y = self._lines(canvas, row.words, x, y, width, DIM, most=3)
        return y + 0.35 * em

    def _lines(
        self, canvas: Canvas, words: str, x: float, y: float, width: float, color: RGB, most: int | None = None
    ) -> float:
        size = round(0.88 * self.em)
        return canvas.lines(x, y, wrapped(" ".join(words.split()), size, width)[:most], size, color)

    def _button(
        self, canvas: Canvas, x: float, y: float, label: str, name: str, hover: str, right: bool = False,
        most: float | None = None,
    ) -> float:  # fmt: skip
        em, size = self.em, round(0.9 * self.em)
        wide, high = text_width(label, size) + 1.4 * em, 1.75 * em
        wide = wide if most is None else min(wide, most)
        left = x - wide if right else x
        canvas.button(left, y, wide, high, label, size, border=ACCENT if name == hover else BORDER)
        self.boxes.add((left, y, wide, high), name)
        return wide
