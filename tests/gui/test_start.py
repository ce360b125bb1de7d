"""The start page, notices and the queue of takes in the window."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.gui.conftest import RunningWindow, ready, running
from tests.support.waiting import wait_until
from v3studio.gui.platform.clipboard import Clipboard
from v3studio.pipelines.batch.queue_file import QueueFile

ROWS = 12
"""Rows of the list in the queue's dialog, which is a widget of the toolkit and does not tell where they are."""

PANELS = {"timeline", "stages", "inspector", "status"}

OF_TAKE = (
    "alone", "camera", "compare", "edits", "error", "frames", "marks", "message", "mode", "orbit", "path", "plots",
    "span", "stages", "texts", "what",
)  # fmt: skip
"""Parts of the state that belong to the open take."""


@pytest.fixture(scope="module")
def shared_window(display: str, take: Path) -> Iterator[RunningWindow]:
    """A window that shows the start page with a take that is gone and one that is there."""
    folder = take.parent
    programs, settings = folder / "bin", folder / "config" / "v3studio" / "window.json"
    for made in (programs, settings.parent):
        made.mkdir(parents=True)
    (programs / "xdg-open").write_text(f'#!/bin/sh\necho "$1" > "{folder / "opened.txt"}"\n')
    (programs / "xdg-open").chmod(0o755)
    settings.write_text(json.dumps({"recent": [str(folder / "gone"), str(take)]}))
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("PATH", f"{programs}:/usr/bin:/bin")
        environment.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        with running(display, folder / "state.jsonl") as window:
            yield window


@pytest.fixture
def window(shared_window: RunningWindow, take: Path) -> RunningWindow:
    """The window with the take, at rest."""
    if shared_window.wait_for("a page", lambda s: True)["title"] != "take - V3 Studio":
        shared_window.open(take)
    shared_window.rest()
    return shared_window


@pytest.fixture
def page(window: RunningWindow) -> RunningWindow:
    """The window with the start page over the take."""
    window.key("h", until=("the start page", lambda s: s["start"]))
    return window


@pytest.fixture
def clipboard(display: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Clipboard]:
    """The clipboard of another program."""
    monkeypatch.setenv("DISPLAY", display)
    clipboard = Clipboard()
    yield clipboard
    clipboard.close()


def same(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two pictures of the window are the same, but for noise."""
    return first.shape == second.shape and bool(np.abs(first.astype(int) - second).mean() < 0.5)


def test_the_page_is_alone_in_fullscreen(shared_window: RunningWindow) -> None:
    """The first test: nothing is open yet, so that Escape only leaves fullscreen."""
    shared_window.wait_for("the page", lambda s: s["start"])
    full = shared_window.menu("View", "fullscreen", until=("fullscreen", lambda s: s["fullscreen"]))
    assert not PANELS & set(full["widgets"])
    state = shared_window.key("Escape", until=("the page in a window", lambda s: not s["fullscreen"]))
    assert state["start"]
    assert not PANELS & set(state["widgets"])


def test_cards_are_removed_and_opened_with_keys(shared_window: RunningWindow, take: Path) -> None:
    window = shared_window
    gone, there = window.wait_for("cards", lambda s: s["start"] and len(s["cards"]) == 2)["cards"]
    assert gone[0] == "gone"
    assert gone[1].startswith("missing")
    evaluation = json.loads((take / "evaluation.json").read_text())
    assert there == ["take", "all stages done", pytest.approx(evaluation["summary"]["psnr_decoded"])]
    window.key("Down", until=("the first card", lambda s: s["focus"] in ("card 0", "forget")))
    for _ in range(4):
        if window.states()[-1]["focus"] != "card 0":
            window.key("Down")
    assert window.states()[-1]["focus"] == "card 0"
    window.key("Delete", until=("one card", lambda s: [card[0] for card in s["cards"]] == ["take"]))
    assert json.loads((take.parent / "config" / "v3studio" / "window.json").read_text())["recent"] == [str(take)]
    window.key("Return", until=("the take", lambda s: s["title"] == "take - V3 Studio" and ready(s)))


def test_the_page_is_left_for_the_take_below_it(page: RunningWindow) -> None:
    page.choose("start page", "back", until=("the take", lambda s: not s["start"]))


def lay_down(rig: Path) -> None:
    """Turn the cameras of a rig about x: what was up is at the side."""
    turn = np.eye(4)[[0, 2, 1, 3]] * [1, 1, -1, 1]
    document = json.loads(rig.read_text())
    for camera in document["cameras"]:
        camera["world_to_camera"] = (np.array(camera["world_to_camera"]) @ turn).tolist()
    rig.write_text(json.dumps(document))


def initialized(window: RunningWindow) -> np.ndarray:
    """The picture of *Initialize*; *Review* is shown again."""
    window.stage("initialize")
    window.wait_for("the mesh", lambda s: s["stage"] == "initialize" and s["settled"])
    pixels: list[np.ndarray] = []

    def still() -> bool:
        """Whether two looks at the screen, which is behind the state, show the same."""
        pixels.append(window.pixels("viewport"))
        return len(pixels) > 1 and same(*pixels[-2:])

    wait_until("a still picture", still)
    window.stage("review")
    return pixels[-1]


def test_a_text_field_takes_what_another_program_has_copied(window: RunningWindow, clipboard: Clipboard) -> None:
    window.menu("File", "new", until=("the dialog", lambda s: s["dialog"] == "new take" and s["typing"]))
    path = "/Takes/A b_1 (x).mp4"
    assert clipboard.copy(path)
    window.chord("v")
    window.wait_for(
        "the path", lambda s: clipboard.poll() is None and s["texts"].get("dialog footage", "").endswith(path)
    )


def test_nothing_of_a_take_is_left_in_the_next_one(window: RunningWindow, clipboard: Clipboard, take: Path) -> None:
    other = Path(shutil.copytree(take, take.with_name("other")))
    lay_down(other / "calibrate" / "rig.json")

    def paste(path: Path) -> None:
        """Open a take from the start page."""
        window.key("h", until=("the start page", lambda s: s["start"]))
        assert clipboard.copy(str(path))
        window.chord("v")
        title = f"{path.name} - V3 Studio"
        window.wait_for(path.name, lambda s: clipboard.poll() is None and s["title"] == title and ready(s))

    paste(take)
    mesh = initialized(window)
    fresh = window.wait_for("its picture", lambda s: ready(s) and s["plots"])
    paste(other)
    assert window.states()[-1]["orbit"] != fresh["orbit"]
    window.select_span(1, 3)
    window.key("m", until=("the question", lambda s: s["dialog"] == "mark" and s["typing"]))
    window.key("Return", until=("the mark", lambda s: s["marks"] and not s["dialog"]))
    window.key("d")
    window.key("c")
    window.wait_for("a comparison from a camera", lambda s: s["compare"] == "difference" and s["camera"] and ready(s))
    assert not same(initialized(window), mesh), "up is at the side, in this take only"
    paste(take)
    assert same(initialized(window), mesh)
    again = window.wait_for("its picture", ready)
    assert {key: again[key] for key in OF_TAKE} == {key: fresh[key] for key in OF_TAKE}


def test_a_copied_path_that_is_wrong_is_told_and_copied(page: RunningWindow, clipboard: Clipboard, take: Path) -> None:
    wrong = f"{take.with_name('nowhere')}: no such folder"
    assert clipboard.copy(str(take.with_name("nowhere")))
    page.chord("v")
    page.wait_for("a failure", lambda s: clipboard.poll() is None and wrong in s["notice"])
    page.chord("c")
    page.saw("a copy", lambda s: s["notice"] == "Copied the message.")
    clipboard.ask()
    texts: list[str | None] = []

    def pasted() -> bool:
        texts.append(clipboard.poll())
        return texts[-1] is not None

    wait_until("the message on the clipboard", pasted)
    assert str(texts[-1]).startswith(wrong)
    page.wait_for("the failure again", lambda s: "notice dismiss" in s["widgets"])
    page.key("Escape", until=("no failure", lambda s: "notice dismiss" not in s["widgets"]))
    assert page.states()[-1]["start"]
    page.key("Escape", until=("the take", lambda s: not s["start"]))


def test_a_remark_in_fullscreen_is_shown_over_the_view(window: RunningWindow) -> None:
    window.key("f", until=("fullscreen", lambda s: s["fullscreen"] and not PANELS & set(s["widgets"])))
    window.key("t")
    told = window.saw("a remark", lambda s: s["fullscreen"] and s["widgets"].get("status", (0, 0, 0, 0))[3] > 0)
    (x, y, width, height), (left, top, wide, high) = told["widgets"]["status"], told["widgets"]["viewport"]
    assert left < x < x + width < left + wide
    assert top < y < y + height < top + high
    window.key("Escape")
    window.key("Escape", until=("the panels", lambda s: not s["fullscreen"] and "timeline" in s["widgets"]))


def test_the_folder_of_what_was_written_is_opened(window: RunningWindow, take: Path) -> None:
    window.menu("File", "screenshot", until=("the question", lambda s: s["dialog"] == "screenshot" and s["typing"]))
    window.key("Return")
    state = window.saw("the notice", lambda s: s["notice"].startswith("Written: "))
    written, opened = Path(state["notice"].removeprefix("Written: ")), take.with_name("opened.txt")
    assert written.is_file()
    window.chord("o")  # while the notice is shown
    wait_until("the folder", opened.exists)
    wait_until("its name", lambda: opened.read_text() == f"{written.parent}\n")


class QueueDialog:
    """The queue's dialog."""

    def __init__(self, window: RunningWindow) -> None:
        self._window = window
        window.key("q")

    def shows(self, *rows: str) -> None:
        """Wait until the list has these rows; each begins with the given text."""
        same = lambda s: len(s["lines"]) == len(rows) and all(map(str.startswith, s["lines"], rows))  # noqa: E731
        self._window.wait_for(f"{rows}", same, 240)

    def press(self, key: str, row: int | None = None) -> None:
        """Choose a row, then press a button."""
        if row is not None:
            self._window.click("dialog list", 0.2, 0.011 + (row + 0.5) / ROWS)
        self._window.click(f"dialog {key}")


def test_a_take_that_fails_does_not_stop_the_next_one_of_the_queue(window: RunningWindow, take: Path) -> None:
    file = QueueFile(take.parent / "state" / "v3studio" / "queue.json")
    broken = take.with_name("broken")
    shutil.copytree(take, broken, ignore=shutil.ignore_patterns("train", "stream", "initialize"))
    settings = (broken / "config.yaml").read_text()
    (broken / "config.yaml").write_text(settings.replace("  root: ", "  root: /nowhere"))
    for path in (take.with_name("gone"), broken):
        file.add(path, None, ())
    queue = QueueDialog(window)
    queue.shows("1   gone   waiting", "2   broken   waiting")
    queue.press("add_open")
    queue.shows("1   gone   waiting", "2   broken   waiting", "3   take   waiting")
    queue.press("remove", row=0)
    queue.shows("2   broken   waiting", "3   take   waiting")
    queue.press("up", row=1)
    queue.shows("3   take   waiting", "2   broken   waiting")
    queue.press("down")
    queue.shows("2   broken   waiting", "3   take   waiting")
    queue.press("start")
    queue.shows("2   broken   failed", "3   take   done")
    wait_until("the end of the program", lambda: not file.is_run())
    queue.press("retry", row=0)
    queue.shows("3   take   done", "2   broken   waiting")


def test_a_command_that_is_found_on_the_page_shows_its_dialog(page: RunningWindow) -> None:
    page.chord("k", until=("the list", lambda s: s["dialog"] == "commands" and s["typing"]))
    page.enter_text("dialog line", "export")
    page.key("Return", until=("the options", lambda s: s["dialog"] == "export" and s["typing"]))
    wait_until("them on the screen", lambda: page.pixels("dialog save").max() > 200)
