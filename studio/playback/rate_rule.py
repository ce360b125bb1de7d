"""Chooses the rendition to fetch next: a buffer-based rule with throughput and dropped frames as further inputs.

The rule is BOLA-BASIC (Spiteri, Urgaonkar and Sitaraman, "BOLA: Near-Optimal Bitrate Adaptation for Online Videos",
INFOCOM 2016) with the parameters chosen as dash.js chooses them (its BolaRule), the paper's BOLA-O against oscillation,
and dash.js's DroppedFramesRule. Until the buffer has reached the level at which BOLA takes what the throughput allows,
throughput alone decides.
"""

import math
from collections import deque
from collections.abc import Sequence

_MINIMUM = 4.0  # seconds of buffer below which the smallest rendition is taken; dash.js has 10, but groups are short
_PER_RUNG = 1.0  # seconds of buffer that each rendition adds to the target; dash.js has 2
_SAMPLES = 5
_SAFETY = 0.9  # share of the measured throughput that is counted on, as in dash.js
_PROBING = 0.9  # of the target
_FIRST_PAUSE, _LONGEST_PAUSE = 4, 64  # groups between two tries; each doubles it
_DROPPED_SHARE = 0.15  # dash.js, DroppedFramesRule
_DROPPED_SAMPLE = 90  # frames; dash.js waits for 375, but groups of splats are short and decoding is the bottleneck


class RateRule:
    """Chooses among renditions with these `bandwidths`, bits per second in the order of the manifest. `played` may be
    called on another thread. `target`: seconds of buffer to fill; at that, the best rendition is taken."""

    def __init__(self, bandwidths: Sequence[int]) -> None:
        # by rate, which need not be the order of the manifest
        self._order = sorted(range(len(bandwidths)), key=lambda number: bandwidths[number])
        self._rates = [float(bandwidths[number]) for number in self._order]
        self.target = _MINIMUM + _PER_RUNG * len(bandwidths)
        self._utilities = [math.log(rate / self._rates[0]) + 1 for rate in self._rates]
        self._gp = (self._utilities[-1] - 1) / (self.target / _MINIMUM - 1)
        self._throughput: deque[tuple[int, float]] = deque(maxlen=_SAMPLES)
        self._frames = [[0, 0] for _ in bandwidths]  # shown and dropped, by rate
        self._filling = True
        self._last = 0
        self._patience, self._pause = _FIRST_PAUSE, 0

    def fetched(self, size: int, seconds: float) -> None:
        """A group of `size` bytes took so long to arrive."""
        self._throughput.append((size, max(seconds, 1e-6)))

    def played(self, rendition: int, shown: int, dropped: int) -> None:
        """Frames of a rendition were shown, or were dropped since decoding was late."""
        counts = self._frames[self._order.index(rendition)]
        counts[0] += shown
        counts[1] += dropped

    def choose(self, buffered: float) -> int:
        """Position of the rendition to fetch next in the manifest's order, with `buffered` seconds of frames that are
        fetched and not yet shown."""
        by_rate = self._sustained()
        choice = by_rate
        bola = self._bola(buffered)
        if self._filling and (bola > by_rate or bola == by_rate > 0):
            self._filling = False
        if not self._filling:
            # BOLA-O: not above what arrives in time, unless it is already there. The throughput of short downloads
            # is mostly latency, so with a full buffer one step up is tried.
            choice = max(min(bola, by_rate), min(bola, self._last))
            if bola > choice and buffered >= _PROBING * self.target and self._pause <= 0:
                choice += 1
                self._pause = self._patience = min(2 * self._patience, _LONGEST_PAUSE)
        self._pause -= 1
        choice = min(choice, self._decodable())
        self._last = choice
        return self._order[choice]

    def _bola(self, buffered: float) -> int:
        if self._gp == 0:  # all rates are equal
            return len(self._rates) - 1
        weight = _MINIMUM / self._gp
        scores = [
            (weight * (utility + self._gp) - buffered) / rate
            for utility, rate in zip(self._utilities, self._rates, strict=True)
        ]
        return max(range(len(scores)), key=lambda number: (scores[number], number))

    def _sustained(self) -> int:
        """The highest rate below the throughput of the last groups; the lowest where nothing is known yet."""
        if not self._throughput:
            return 0
        # the harmonic mean weighted by size, which outliers of small files do not raise
        throughput = 8 * sum(size for size, _ in self._throughput) / sum(seconds for _, seconds in self._throughput)
        return max((n for n, rate in enumerate(self._rates) if rate <= _SAFETY * throughput), default=0)

    def _decodable(self) -> int:
        """The highest rate below the first one of which too many frames were dropped."""
        for number, (shown, dropped) in enumerate(self._frames):
            if number and shown + dropped >= _DROPPED_SAMPLE and dropped > _DROPPED_SHARE * (shown + dropped):
                return number - 1
        return len(self._rates) - 1
