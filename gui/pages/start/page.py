"""StartPage: the cards of recent takes and streams, the queue of takes, and the keyboard focus."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.gui.drawing.areas import Box
from v3studio.gui.drawing.palette import State
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.take.take_queue import TakeQueue
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.gui.pages.start.cards import Card, CardKind, describe, fingerprint
from v3studio.gui.pages.start.thumbnail import thumbnail
from v3studio.studio.stream import is_address

LOOK_EVERY = 3.0  # seconds between two looks at a card's files


@dataclass(frozen=True)
class _Request:
    place: str
    known: object = None
    picture: bool = False


_Facts = tuple[object, Card | None] | np.ndarray | None  # a stamp, and a card unless nothing has changed; or an image


def _look(request: _Request) -> _Facts:
    if request.picture:
        return thumbnail(request.place)
    stamp = "web" if is_address(request.place) else fingerprint(request.place)
    return stamp, None if stamp == request.known else describe(request.place)


class StartPage:
    """The contents of the start page. Call `look` now and then while it is on screen; it does not block.

    Signals:
        changed: a card, an image or the queue has changed.
    """

    def __init__(self, queue: TakeQueue, sample: bool) -> None:
        self.queue, self.sample = queue, sample  # sample: whether the sample capture is there
        self.changed: Signal[[]] = Signal()
        queue.changed.connect(self.changed.emit)
        self.places: tuple[str, ...] = ()
        self.cards: dict[str, Card] = {}  # by place, as far as they are known
        self.pictures: dict[str, np.ndarray | None] = {}  # thumbnails by place; None where there is nothing to see
        # focus: name of the button or card with the keyboard focus, see `drawing`: "new", "card 0",
        self.focus, self.back = "new", ""
        self._stamps: dict[str, object] = {}
        self._looked: dict[str, float] = {}
        self._pictured: dict[str, object] = {}
        self._worker: LatestWorker[_Request, _Facts] = LatestWorker(_look, "v3studio start", self._found)
        self._asked: _Request | None = None

    def look(self, places: Sequence[str]) -> None:
        """Read the cards and images that are missing or may have changed, the newest first, one by one on a thread."""
        if tuple(places) != self.places:
            self.places = tuple(places)
            for known in (self.cards, self.pictures, self._stamps, self._looked, self._pictured):
                for gone in set(known) - set(places):
                    del known[gone]
            self.changed.emit()
        if self._asked is None:
            self._asked = self._next()
            if self._asked is not None:
                self._worker.ask(self._asked)

    def _found(self, done: Done[_Request, _Facts]) -> None:
        self._asked = None
        place, facts = done.request.place, done.result
        if place in self.places:
            if isinstance(facts, tuple):
                self._stamps[place], card = facts
                self.cards[place] = card or self.cards[place]
            elif done.request.picture:
                self.pictures[place] = facts
            else:
                self._stamps[place] = "failed"
                self.cards[place] = Card(place, CardKind.DAMAGED, f"cannot be read: {done.error}", State.FAILED)
            self.changed.emit()
        self.look(self.places)

    def _next(self) -> _Request | None:
        """The next thing to read: cards that are not known, then images, then cards that may have changed."""
        now = time.monotonic()
        for place in self.places:
            if place not in self.cards:
                self._looked[place] = now
                return _Request(place)
        for place in self.places:
            card = self.cards[place]
            wanted = (card.kind, card.stream_bytes, card.changed if card.state != State.RUNNING else None)
            if self._pictured.get(place) != wanted and card.kind in (CardKind.TAKE, CardKind.STREAM):
                self._pictured[place] = wanted
                return _Request(place, picture=True)
        for place in self.places:
            if now >= self._looked.get(place, now) + LOOK_EVERY:
                self._looked[place] = now
                return _Request(place, self._stamps.get(place))
        return None

    @property
    def shown(self) -> list[Card]:
        """The cards that are known, newest first."""
        return [self.cards[place] for place in self.places if place in self.cards]

    @property
    def running(self) -> tuple[str, str, float | None] | None:
        """Name, stage and fraction of the take of the queue that runs; None if none does."""
        for row in self.queue.view.rows:
            if row.state == State.RUNNING and self.queue.view.is_run:
                return row.take.name, row.stage, row.fraction
        return None

    def state(self) -> tuple[object, ...]:
        """Everything that the page shows except sizes and pointer; compared for equality."""
        pictures = tuple((place, id(picture)) for place, picture in self.pictures.items())
        return (self.places, tuple(self.cards.items()), pictures, self.focus, self.queue.state, self.sample, self.back)

    def move(self, boxes: Sequence[tuple[Box, str]], across: int, down: int) -> None:
        """Move the focus to the nearest box in a direction, if there is one. `across`, `down`: -1, 0 or 1."""
        at = {name: (x + width / 2, y + height / 2) for (x, y, width, height), name in boxes}
        if self.focus not in at:
            self.focus = next(iter(at), "new")
            return
        x, y = at[self.focus]
        best = None
        for name, (other_x, other_y) in at.items():
            ahead = (other_x - x) * across + (other_y - y) * down
            aside = abs((other_x - x) * down) + abs((other_y - y) * across)
            if ahead > 1 and (across == 0 or aside < ahead) and (best is None or ahead + 2 * aside < best[0]):
                best = (ahead + 2 * aside, name)
        if best is not None:
            self.focus = best[1]

    def step(self, boxes: Sequence[tuple[Box, str]], by: int) -> None:
        """Move the focus to the next (1) or previous (-1) in order, around the end."""
        names = [name for _, name in boxes]
        if names:
            at = names.index(self.focus) if self.focus in names else -1
            self.focus = names[(at + by) % len(names)]
