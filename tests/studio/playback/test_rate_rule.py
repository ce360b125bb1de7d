"""The rule that changes renditions, on a simulated network and in the player."""

import math
from itertools import pairwise
from pathlib import Path

import pytest

from tests.studio.stream.conftest import turned_bodies, write_stream
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.playback import RateRule, play_headless
from v3studio.studio.stream import FolderSource, StreamReader

RATES = (8_000_000, 4_000_000, 2_000_000, 500_000)  # as in a manifest: the best first


class Network:
    """A link in simulated time: seconds that a download takes, begun at a time, at a rate that changes."""

    def __init__(self, rate, round_trip=0.06):
        self.rate, self.round_trip = rate, round_trip

    def seconds(self, begin, size):
        now, left = begin + self.round_trip, 8.0 * size
        while left > 0:
            step = min(left, self.rate(now) * 0.01)
            left -= step
            now += step / self.rate(now)
        return now - begin


def play(rule, network, groups=30, seconds=1 / 3):
    """A player with enough memory: the renditions in the order of the groups, and how many seconds it stood still."""
    now, runs_out, chosen, stalled = 0.0, None, [], 0.0
    for _ in range(groups):
        buffered = 0.0 if runs_out is None else max(runs_out - now, 0.0)
        if buffered > rule.target:
            now += buffered - rule.target
            buffered = rule.target
        chosen.append(rule.choose(buffered))
        size = int(RATES[chosen[-1]] * seconds / 8)
        took = network.seconds(now, size)
        rule.fetched(size, took)
        now += took
        if runs_out is None:
            runs_out = now
        stalled += max(now - runs_out, 0.0)
        runs_out = max(runs_out, now) + seconds
    return chosen, stalled


@pytest.mark.parametrize("period", [2.0, 5.0, 9.0])
def test_a_changing_network_does_not_stop_300_frames(period: float) -> None:
    """Between 0.8 and 12 Mbit/s, in steps and in waves; no rendition above 4 Mbit/s could be played all the time."""
    for rate in (
        lambda now: 12e6 if now % period < period / 2 else 0.8e6,
        lambda now: 6.4e6 + 5.6e6 * math.cos(2 * math.pi * now / period),
    ):
        chosen, stalled = play(RateRule(RATES), Network(rate), groups=30)
        assert stalled < 0.1, (chosen, stalled)
        assert len(set(chosen)) > 1


def test_a_steady_network_does_not_oscillate() -> None:
    for rate in (1.5e6, 3e6, 5e6, 9e6):
        chosen, stalled = play(RateRule(RATES), Network(lambda now, rate=rate: rate), groups=120)
        assert stalled == 0
        assert sum(a != b for a, b in pairwise(chosen[40:])) <= 8
        average = sum(RATES[choice] for choice in chosen[40:]) / 80
        assert 0.4 * rate < average <= rate


def test_equal_rates_and_any_order() -> None:
    assert RateRule((5, 5)).choose(0.0) in (0, 1)
    rule = RateRule((500_000, 8_000_000))
    rule.fetched(10_000_000, 1.0)
    assert rule.choose(8.0) == 1


@pytest.fixture(scope="module")
def switching(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Gaussians]]:
    """60 frames in groups of 4, three renditions, few splats."""
    folder = write_stream(tmp_path_factory.mktemp("switching"), (4,) * 15, splats=40, degree=0)
    return folder, turned_bodies(60, 40)


def test_changing_renditions_neither_repeats_nor_skips_a_frame(
    switching: tuple[Path, list[Gaussians]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The player changes the rendition at every group; each frame is the one that was baked."""
    folder, frames = switching
    turns = iter(range(10_000))
    monkeypatch.setattr(RateRule, "choose", lambda self, buffered: next(turns) % 3)
    monkeypatch.setattr(FolderSource, "parallel", 2)
    shown = []

    def show(item):
        shown.append((item.frame, len(item.gaussians), float(item.gaussians.means[:, 0].mean())))

    report = play_headless(folder, on_frame=show)
    assert [frame for frame, _, _ in shown] == list(range(60))
    assert (report.dropped, report.skipped) == (0, ())
    sizes = [count for _, count, _ in shown]
    assert sizes == [(40, 40, 20)[frame // 4 % 3] for frame in range(60)]
    for frame, count, mean in shown:
        if count == 40:  # half of the splats drift by 0.05 a frame, which tells frames apart
            assert abs(mean - float(frames[frame].means[:, 0].mean())) < 0.0125


def test_the_rule_hears_of_network_and_decoder(
    switching: tuple[Path, list[Gaussians]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _ = switching
    fetched, shown = [], []
    monkeypatch.setattr(RateRule, "fetched", lambda self, size, seconds: fetched.append(size))
    monkeypatch.setattr(RateRule, "played", lambda self, *counts: shown.append(counts))
    play_headless(folder)
    assert (fetched, shown) == ([], [])  # a folder
    monkeypatch.setattr(FolderSource, "parallel", 2)
    play_headless(folder)
    with StreamReader.open(folder) as reader:
        smallest = min(range(3), key=lambda number: reader.manifest.renditions[number].bandwidth)
        assert fetched == [reader.index.group(number).renditions[smallest].bytes for number in range(15)]
    assert shown == [(smallest, 1, 0)] * 60
