"""A stream in the window: played, turned, shared and served, with a command that fails on the way."""

import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tests.gui.conftest import RunningWindow, Until, body, running, write_stream
from tests.support.waiting import wait_until
from v3studio.studio.gaussians import Gaussians

FAILING = """
import sys
from v3studio.gui.models.playback.transport import Transport

def set_loop(self, on):
    raise RuntimeError("the loop is stuck")

Transport.set_loop = set_loop
from v3studio.gui.app import main
sys.exit(main())
"""

LIST = ("the list", lambda s: s["dialog"] == "commands" and s["typing"])


def two_bodies(frame: int) -> Gaussians:
    """Two performers, far apart."""
    splats = body(frame)
    return Gaussians.cat(*(replace(splats, means=splats.means + torch.tensor([0.0, y, 0.0])) for y in (-1.2, 1.2)))


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("window") / "walk"
    write_stream(folder, two_bodies)
    return folder


@pytest.fixture(scope="module")
def shared_window(display: str, stream: Path) -> Iterator[RunningWindow]:
    """A window that plays the stream."""
    log = stream.with_name("state.jsonl")
    with running(display, log, str(stream), program=("-c", FAILING), plays=True) as window:
        first = window.wait_for("a picture, playing", lambda s: s["shown"] is not None and s["playing"])
        assert (first["frames"], first["title"]) == (12, "walk - V3 Studio")
        window.wait_for("playing on", lambda s: s["shown"] != first["shown"])
        window.xdotool("mousemove", 1395, 895)  # where another test may have left the pointer
        window.key("space", until=("paused", lambda s: not s["playing"] and s["settled"]))
        yield window


def at(frame: int) -> Until:
    return f"frame {frame}", lambda s: s["frame"] == frame and s["shown"] == frame and s["settled"]


def colored(pixels: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels that are not gray."""
    mask: np.ndarray = (pixels.max(-1).astype(int) - pixels.min(-1)) > 60
    return mask


def read_code(window: RunningWindow) -> str:
    """The text of the QR code on the screen."""
    return cv2.QRCodeDetectorAruco().detectAndDecode(np.ascontiguousarray(window.pixels("dialog qr")))[0]


def test_during_playback_all_numbers_are_those_of_the_picture(window: RunningWindow) -> None:
    known = len(window.states())
    window.click("play", until=("playing", lambda s: s["playing"]))

    def numbers() -> list[list[int]]:
        return [s["numbers"] for s in window.states()[known:] if s["playing"] and None not in s["numbers"]]

    wait_until("some draws", lambda: len({str(drawn) for drawn in numbers()}) > 3)
    assert all(len(set(drawn)) == 1 for drawn in numbers()), numbers()
    window.key("space", until=("paused", lambda s: not s["playing"]))


def test_keys_buttons_and_the_timeline_seek(window: RunningWindow) -> None:
    window.key("Home", until=at(0))
    window.key("Right", until=at(1))
    window.click("forward", until=at(2))
    window.key("bracketright", until=at(8))  # the next group
    window.click("timeline", *window.on_timeline(5), until=at(5))
    window.drag("timeline", window.on_timeline(1), window.on_timeline(10), until=at(10))


def test_both_bodies_are_shown_and_turned_and_moved(window: RunningWindow) -> None:
    before = window.key("r", until=("a picture", lambda s: s["settled"]))
    assert abs(before["orbit"][1]) < 0.3, "radians: at eye level"
    wait_until("on the screen", lambda: colored(window.pixels("viewport")).sum() > 5000)
    pixels = window.pixels("viewport")
    high, wide = pixels.shape[:2]
    rows, columns = np.nonzero(colored(pixels))
    assert 0.02 * wide < columns.min() < 0.4 * wide
    assert 0.6 * wide < columns.max() < 0.98 * wide
    assert 0.02 * high < rows.min() < rows.max() < 0.98 * high
    window.drag("viewport", (0.4, 0.5), (0.6, 0.4))
    turned = window.wait_for("another view", lambda s: s["orbit"][0] != before["orbit"][0] and s["settled"])
    wait_until("on the screen", lambda: np.abs(window.pixels("viewport").astype(int) - pixels).mean() > 3.0)
    window.drag("viewport", (0.5, 0.5), (0.6, 0.5), button=3)
    window.wait_for("a moved target", lambda s: s["orbit"][3:] != turned["orbit"][3:])
    window.key("r", until=("the first view", lambda s: s["orbit"] == before["orbit"]))


def test_the_wheel_over_an_open_list_is_for_the_list(window: RunningWindow) -> None:
    """The timeline, which the wheel zooms, is below it."""
    across, down = window.point("speed")
    window.press(across, down)
    wheel = ("mousemove", across, down - 60, "click", 4, "click", 4)
    window.send(*wheel)
    window.ticks(30)
    assert window.states()[-1]["zoom"] is None
    window.click("viewport")  # which closes the list
    window.send(*wheel)
    window.wait_for("a zoomed timeline", lambda s: s["zoom"])
    window.click("fit", until=("the whole timeline", lambda s: s["zoom"] is None))


def test_a_command_that_is_not_possible_stays_in_the_list(window: RunningWindow) -> None:
    assert len(window.chord("k", until=LIST)["lines"]) > 30
    window.enter_text("dialog line", "html rep")
    window.wait_for("the only one with these words", lambda s: s["lines"] == ["Write HTML report"])
    window.key("Return")  # a stream has no report
    window.ticks(30)
    assert window.states()[-1]["dialog"] == "commands"


def test_a_click_runs_the_last_command_in_view(window: RunningWindow) -> None:
    figures = window.states()[-1]["figures"]
    window.chord("k", until=LIST)
    window.enter_text("dialog line", "view")
    window.wait_for("the commands with this word", lambda s: s["lines"][0] == "Reset view" and len(s["lines"]) < 15)
    assert window.part("dialog list", "Inspector and log")[1] > 0.5, "the list must not scroll under the pointer"
    window.choose("dialog list", "Inspector and log")
    window.wait_for("other figures", lambda s: not s["dialog"] and s["figures"] != figures)
    window.key("i", until=("the figures", lambda s: s["figures"] == figures))


def test_keys_that_are_typed_at_once_are_for_the_list(window: RunningWindow) -> None:
    known = len(window.states())
    window.xdotool("key", "ctrl+k", "type", "--delay", 15, "full")
    window.wait_for("what is typed", lambda s: s["texts"].get("dialog line") == "full")
    assert not any(state["fullscreen"] for state in window.states()[known:]), "none is a shortcut"
    window.key("Return", until=("fullscreen", lambda s: not s["dialog"] and s["fullscreen"]))
    window.key("Escape", until=("the panels", lambda s: not s["fullscreen"]))


def test_keys_select_the_last_command(window: RunningWindow) -> None:
    everything = window.chord("k", until=LIST)["lines"]
    window.send("key", *["Next"] * (len(everything) // 12 + 1), "Return")
    window.wait_for("about", lambda s: s["dialog"] == "message")


def test_a_command_that_fails_is_reported_and_the_window_stays(window: RunningWindow) -> None:
    window.key("l", until=("the message", lambda s: "the loop is stuck" in s["notice"]))
    window.click("notice dismiss", until=("no message", lambda s: s["notice"] == ""))
    assert "RuntimeError: the loop is stuck" in window.stderr.read_text()


def test_an_export_that_is_refused_keeps_what_was_typed(window: RunningWindow, stream: Path) -> None:
    state = window.menu("Export", "export", until=("the options", lambda s: s["dialog"] == "export" and s["typing"]))
    assert state["texts"]["dialog line"].endswith(f"-ply-frame-{state['number']}.ply"), "the frame under review"
    window.retype("dialog line", str(stream))
    window.click("dialog save")
    window.wait_for("a refusal", lambda s: s["dialog"] == "export" and s["texts"]["dialog line"] == str(stream))


def test_a_share_is_written_and_replaced_with_what_was_chosen_last(window: RunningWindow, stream: Path) -> None:
    shared, dialog = stream.with_name("walk-share"), ("the dialog", lambda s: s["dialog"] == "share" and s["typing"])
    state = window.menu("Share", "share folder", until=dialog)
    assert state["texts"]["dialog line"] == str(shared)
    assert state["widgets"]["dialog line"][0] == state["widgets"]["dialog title"][0], "all fields are below each other"
    window.enter_text("dialog title", "A walk")  # the first field has the focus
    window.click("dialog save")
    written = lambda s: s["notice"].startswith("Shared: ") and "notice open_folder" in s["widgets"]  # noqa: E731
    assert window.wait_for("what was written", written, 180)["dialog"] == "", "nothing stops the work"
    assert (shared / "stream" / "manifest.json").read_bytes() == (stream / "manifest.json").read_bytes()
    assert "<title>A walk</title>" in (shared / "index.html").read_text()
    assert window.menu("Share", "share folder", until=dialog)["texts"]["dialog title"] == "A walk"
    window.click("dialog save", until=("a question", lambda s: s["dialog"] == "ask"))
    (shared / "index.html").write_text("the earlier page")
    window.click("dialog replace", until=("the new page", lambda s: s["exporting"] == "" and not s["dialog"]))
    wait_until("replaced", lambda: "A walk" in (shared / "index.html").read_text(), 180)


def test_a_name_that_is_too_long_for_a_share_is_refused(window: RunningWindow) -> None:
    window.menu("Share", "share folder", until=("the dialog", lambda s: s["dialog"] == "share"))
    window.click("dialog line")
    window.key("End")
    window.enter_text("dialog line", "name" * 65)  # longer than file systems allow
    window.click("dialog save")
    window.xdotool("type", "z")
    window.wait_for("the first field focused", lambda s: s["texts"].get("dialog title", "")[-1:] == "z")
    assert "bug" not in window.states()[-1]["notice"]


def test_a_stream_is_served_with_a_code(window: RunningWindow, stream: Path) -> None:
    window.menu("Share", "serve", until=("the dialog", lambda s: s["dialog"] == "serve"))
    window.click("dialog https", 0.1)
    window.click("dialog save")
    state = window.wait_for("the code", lambda s: s["dialog"] == "serving" and s["widgets"].get("dialog qr"), 180)
    assert state["serving"].startswith("http://")
    wait_until("the code on the screen", lambda: read_code(window) == state["serving"])
    port = state["serving"].rstrip("/").rpartition(":")[2]
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/manifest.json") as answer:
        assert answer.read() == (stream / "manifest.json").read_bytes()
    window.click("dialog stop", until=("the end", lambda s: s["serving"] == "" and s["dialog"] == ""))
