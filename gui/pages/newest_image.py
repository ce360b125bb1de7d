"""NewestImage: what the view shows while the chosen image is being rendered: the last one, dimmed, with a word."""

import time

import numpy as np

from v3studio.gui.drawing.palette import GROUND
from v3studio.gui.pages.stage_view import waiting
from v3studio.pipelines.reports.terminal import duration

LOADING = "loading"  # what the empty view says while its very first image is being rendered

DIMMED_AFTER, FRAME_DIMMED_AFTER = 0.1, 0.5
"""Seconds after which an image of something else, or of another frame, is dimmed: not at every quick change."""

TOLD_AFTER = 5.0  # seconds after which the time that the image takes is told

SLOW_TICK = 0.25
"""Seconds between two ticks from which on a wrong image is dimmed at once, since it would stay for another draw."""


class NewestImage:
    """Keeps the last image, and dims it while another one is wanted."""

    def __init__(self) -> None:
        self._shown: object = None
        self._pixels: np.ndarray | None = None
        self._missing_since: float | None = None
        self._updated = time.monotonic()
        self._words = ""

    @property
    def loading(self) -> bool:
        """Whether the view is empty and says so."""
        return self._words.startswith(LOADING)

    def update(
        self,
        pixels: np.ndarray | None,
        wanted: object,
        right_frame: bool,
        doing: str,
        message: str,
        size: tuple[int, int],
        em: float,
    ) -> np.ndarray | None:
        """The image to show, if it changes. Call at each tick. `right_frame`: the newest image shows the current frame;
        `doing`: what is being done for the wanted image; "" if nothing is."""
        before, self._updated = self._updated, time.monotonic()
        if pixels is not None:
            self._shown, self._pixels, self._missing_since, self._words = wanted, pixels, None, ""
            return pixels
        first = self._pixels is None
        if first and (message or not doing):  # there will be none
            said, self._words, self._missing_since = self._words, "", None
            return _empty(size) if said else None
        if not first and wanted == self._shown and right_frame:
            self._missing_since = None
            return None
        now = self._updated
        if self._missing_since is None:
            self._missing_since = before if now - before >= SLOW_TICK else now
        if now - self._missing_since < (DIMMED_AFTER if first or wanted != self._shown else FRAME_DIMMED_AFTER):
            return None
        words, took = LOADING if first else doing or "not available", now - self._missing_since
        if doing and took >= TOLD_AFTER:
            words = f"{words}{f' ({doing})' * first}, {duration(int(took))} so far"
        if words == self._words:
            return None
        self._words = words
        last = _empty(size) if self._pixels is None or (message and wanted != self._shown) else self._pixels
        return waiting(last, "" if message else words, em)


def _empty(size: tuple[int, int]) -> np.ndarray:
    return np.full((size[1], size[0], 3), GROUND, np.uint8)
