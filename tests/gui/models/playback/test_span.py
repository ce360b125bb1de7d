"""A span of frames: playback repeats it, and its figures are those of its frames."""

from __future__ import annotations

from gui.models.playback.span import span_rows
from gui.models.playback.transport import Transport


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_playback_repeats_the_span() -> None:
    clock = Clock()
    transport = Transport(20, 10.0, now=clock)
    transport.select_span(8, 5)
    assert transport.span == (5, 8)
    transport.play()
    seen = []
    for step in range(10):
        clock.now = step / 10
        seen.append(transport.frame)
    assert seen == [5, 6, 7, 8, 5, 6, 7, 8, 5, 6], "it begins at the span"
    assert transport.clear_span()
    assert transport.frame == 6, "the frame is kept"
    clock.now += 0.5
    assert transport.frame == 11
    assert not transport.clear_span()


def test_the_sound_begins_again_with_the_span() -> None:
    class Sound:
        def __init__(self) -> None:
            self.begun: list[float] = []
            self.at: float | None = None

        def play(self, seconds: float, loop: bool) -> None:
            self.begun.append(seconds)
            self.at = seconds

        def stop(self) -> None:
            self.at = None

        def position(self) -> float | None:
            return self.at

    sound = Sound()
    transport = Transport(20, 10.0, now=Clock())
    transport.follow(sound)  # type: ignore[arg-type]
    transport.select_span(5, 8)
    transport.play()
    assert sound.begun == [0.5]
    sound.at = 0.9
    assert transport.frame == 5
    assert sound.begun == [0.5, 0.5]
    sound.at = 0.75
    assert transport.frame == 7


def test_a_key_sets_begin_and_end_and_clears() -> None:
    transport = Transport(20, 10.0, now=Clock())
    transport.seek(12)
    assert "begins at frame 12" in transport.step_span()
    assert transport.span is None
    transport.seek(3)
    assert "3 to 12" in transport.step_span()
    assert transport.span == (3, 12)
    transport.step_span()
    assert transport.span is None
    transport.select_span(0, 99)
    assert transport.span == (0, 19)
    transport.resize(10, (0,), 10.0)
    assert transport.span is None, "its frames are gone"


def test_figures_are_those_of_the_frames() -> None:
    psnr = [30.0, 31.5, None, 29.0, 35.0]
    series = {
        "psnr_decoded": psnr,
        "bytes": [1000.0, 2000.0, 3000.0, None, 5000.0],
        "flicker": [None, 1.0, 3.0, 5.0, 0.0],
    }
    other = {"psnr_decoded": [0.0, 28.0, 30.5, 29.25], "bytes": [0.0, 4000.0]}
    assert dict(span_rows(series, 1, 3, other)) == {
        "PSNR, mean": "30.25 / 29.25 dB",
        "lowest, frame 3": "29.00 / 28.00 dB",
        "size": "5.0 / 4.0 KB",
        "flicker": "3.00 / - /255",
    }
    assert dict(span_rows(series, 1, 3))["size"] == "5.0 KB"
    assert span_rows({}, 1, 3) == []
