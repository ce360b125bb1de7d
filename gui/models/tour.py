"""Tour: six steps through the window, each true for the state that the window is in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from gui.models.stage_rows import TITLES


@dataclass(frozen=True)
class TourFacts:
    """The state of the window that the steps tell about.

    Attributes:
        states: states of the stages, see `StageRow`.
        footage: the footage in words, "16 cameras, 30 frames"; "" while it is not known.
        mode: the picture that Capture shows, see `CaptureView`.
        alone: the camera that Capture shows alone; "" for all.
        settings: whether there are settings to see.
        busy, paused: whether a run is in progress, and whether it is suspended.
        frames: number of frames on the timeline.
        evaluated: whether the timeline has curves.
        sources: "trained", "decoded": what Review can show.
        cameras: whether there are capture cameras.
    """

    states: Mapping[str, str] = field(default_factory=dict)
    footage: str = ""
    mode: str = "mask overlay"
    alone: str = ""
    settings: bool = True
    busy: bool = False
    paused: bool = False
    frames: int = 1
    evaluated: bool = False
    sources: Sequence[str] = ()
    cameras: bool = False


@dataclass(frozen=True)
class Step:
    """A step.

    Attributes:
        target: the control that it is about: "stages", "viewport", "settings", "run", "timeline" or "modes".
        stage: the stage that is selected for it.
        title: heading.
        words: one or two sentences.
    """

    target: str
    stage: str
    title: str
    words: Callable[[TourFacts], str]


def _stages(facts: TourFacts) -> str:
    done = [title for key, title in TITLES.items() if facts.states.get(key) == "done"]
    words = "A take is made in six stages, from top to bottom. A click on one shows its settings and its view."
    if len(done) == len(TITLES):
        return f"{words} Here, all six are done."
    return f"{words} Here, {len(done)} of 6 {'is' if len(done) == 1 else 'are'} done."


def _capture(facts: TourFacts) -> str:
    if facts.states.get("capture") == "failed":
        return "Capture shows all cameras side by side. This footage cannot be opened: the left panel has the reason."
    shown = {
        "mask overlay": "what does not belong to the performer is darkened",
        "images": "as they were filmed",
        "performer": "only the performer, cut out by the masks",
    }[facts.mode]
    if facts.alone:
        return (
            f"Capture shows {facts.alone} alone: {shown}. Another click, or Escape after the tour, shows all cameras."
        )
    what = f"the footage ({facts.footage})" if facts.footage else "the footage"
    return f"Capture shows {what}: {shown}. A click on an image shows that camera alone."


def _settings(facts: TourFacts) -> str:
    if not facts.settings:
        return "The settings of the selected stage belong here. Those of this take cannot be read: see the message."
    if facts.busy:
        return (
            "The settings of the selected stage, locked during the run. Rest the pointer on one to read what it does."
        )
    return "The settings of the selected stage. Rest the pointer on one to read what it does; Ctrl+Z undoes a change."


def _run(facts: TourFacts) -> str:
    if facts.busy:
        other = "Resume lets it go on" if facts.paused else "Pause suspends it"
        return (
            f"A run is in progress{', suspended' * facts.paused}. {other}; Cancel ends it and keeps what is finished."
        )
    if all(facts.states.get(key) == "done" for key in TITLES):
        return (
            "Run all runs every stage that is not up to date. Now all are: after you change a setting, press it again."
        )
    left = sum(facts.states.get(key) != "done" for key in TITLES if key != "capture")
    return f"Run all runs every stage that is not up to date, now {left}. It goes on when the window is closed."


def _timeline(facts: TourFacts) -> str:
    last = facts.frames - 1
    seek = f"Click or drag to go to a frame (0 to {last})" if last > 0 else "Click or drag to go to a frame"
    if facts.evaluated:
        return f"PSNR and size of every frame, as measured from the evaluated cameras. {seek}; Space plays."
    return f"{seek}; Space plays. When Review is done, PSNR and size of every frame are drawn here."


def _modes(facts: TourFacts) -> str:
    names = {"trained": "2 the trained Gaussians", "decoded": "3 the decoded stream"}
    there = [words for source, words in names.items() if source in facts.sources]
    if not there:
        return (
            "Nothing is trained yet. Once it is, 1, 2 and 3 show footage, trained and decoded; W compares with a wipe."
        )
    if facts.cameras:
        there.insert(0, "1 shows the footage")
    else:
        there[0] = there[0].replace(" ", " shows ", 1)
    return (
        f"{', '.join(there)}. W compares two of them with a line to drag, D as a heat map."
        if len(there) > 1
        else f"{there[0]}. Comparisons need a second one: footage from a camera, or a baked stream."
    )


STEPS = (
    Step("stages", "capture", "Stages", _stages),
    Step("viewport", "capture", "Footage", _capture),
    Step("settings", "capture", "Settings", _settings),
    Step("run", "capture", "Run", _run),
    Step("timeline", "review", "Timeline", _timeline),
    Step("modes", "review", "Review", _modes),
)


class Tour:
    """Which step is shown.

    Attributes:
        number: of the step, counted from 0; None while there is no tour.
    """

    def __init__(self) -> None:
        self.number: int | None = None

    @property
    def step(self) -> Step | None:
        """The step that is shown; None while there is no tour."""
        return STEPS[self.number] if self.number is not None else None

    @property
    def is_last(self) -> bool:
        """Whether it is the last one."""
        return self.number == len(STEPS) - 1

    def start(self) -> None:
        """Show the first step."""
        self.number = 0

    def next(self) -> None:
        """Show the next step; after the last one, the tour is over."""
        if self.number is not None:
            self.number = None if self.is_last else self.number + 1

    def back(self) -> None:
        """Show the step before."""
        if self.number:
            self.number -= 1

    def stop(self) -> bool:
        """End the tour; returns whether there was one."""
        was_shown, self.number = self.number is not None, None
        return was_shown
