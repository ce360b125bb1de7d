"""The tour: six steps, each of which tells what is so."""

from __future__ import annotations

from dataclasses import replace

from gui.models.stage_rows import TITLES
from gui.models.tour import STEPS, Tour, TourFacts

NEW = TourFacts(states={"capture": "done"}, footage="16 cameras, 30 frames", frames=30)
DONE = replace(NEW, states=dict.fromkeys(TITLES, "done"), evaluated=True, sources=("decoded", "trained"), cameras=True)


def words(target: str, facts: TourFacts) -> str:
    (step,) = [step for step in STEPS if step.target == target]
    return step.words(facts)


def test_the_steps_are_walked_forward_and_back() -> None:
    tour = Tour()
    assert tour.step is None
    tour.start()
    tour.back()
    seen = []
    while tour.step is not None:
        seen.append(tour.step.target)
        tour.next()
    assert seen == ["stages", "viewport", "settings", "run", "timeline", "modes"]
    tour.start()
    tour.next()
    tour.back()
    assert tour.number == 0
    assert tour.stop()
    assert not tour.stop()


def test_the_words_are_those_of_the_state() -> None:
    assert "1 of 6 is done" in words("stages", NEW)
    assert "all six are done" in words("stages", DONE)
    assert "16 cameras, 30 frames" in words("viewport", NEW)
    assert "darkened" in words("viewport", NEW)
    assert "darkened" not in words("viewport", replace(NEW, mode="images"))
    assert "cannot be opened" in words("viewport", replace(NEW, states={"capture": "failed"}))
    assert "cam03 alone" in words("viewport", replace(NEW, alone="cam03"))
    assert "locked" in words("settings", replace(NEW, busy=True))
    assert "cannot be read" in words("settings", replace(NEW, settings=False))
    assert "now 5" in words("run", NEW)
    assert "all are" in words("run", DONE)
    assert "Pause suspends" in words("run", replace(NEW, busy=True))
    assert "Resume" in words("run", replace(NEW, busy=True, paused=True))
    assert "0 to 29" in words("timeline", NEW)
    assert "When Review is done" in words("timeline", NEW)
    assert "When Review is done" not in words("timeline", DONE)
    assert "Nothing is trained yet" in words("modes", NEW)
    assert "1 shows the footage, 2 the trained Gaussians, 3 the decoded stream" in words("modes", DONE)
    trained = replace(NEW, sources=("trained",))
    assert words("modes", trained).startswith("2 shows the trained Gaussians.")


def test_every_step_is_one_to_three_short_sentences() -> None:
    for facts in (NEW, DONE, replace(NEW, busy=True), replace(DONE, busy=True, paused=True)):
        for step in STEPS:
            text = step.words(facts)
            assert text.endswith(".")
            assert 20 < len(text) < 180, text
