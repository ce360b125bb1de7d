"""Commands are found by typing, and run by Enter or a click."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

LIST = ("the list", lambda s: s["dialog"] == "commands" and s["typing"])


def test_commands_are_found_by_typing_and_run(open_window: Callable, stream_folder: Path) -> None:
    window = open_window(str(stream_folder))
    window.wait_for("the stream", lambda s: s["frames"] == 12 and not s["opening"])
    window.chord("k")
    state = window.wait_for(*LIST)
    everything = state["lines"]
    assert len(everything) > 30
    window.enter_text("dialog line", "html rep")
    window.wait_for("what is found", lambda s: s["lines"] == ["Write HTML report"])
    window.key("Return")
    window.ticks(30)
    assert window.states()[-1]["dialog"] == "commands", "a stream has no report: the list stays and says so"
    window.key("Escape")
    window.wait_for("no dialog", lambda s: not s["dialog"])

    # by a click on the last row that is in view at first
    figures = window.states()[-1]["figures"]
    window.chord("k")
    window.wait_for(*LIST)
    window.enter_text("dialog line", "view")
    found = window.wait_for("what is found", lambda s: s["lines"][:1] == ["Reset view"])["lines"]
    row = found.index("Inspector and log")
    assert 6 < row < 12, "below the middle of the list, which must not scroll under the pointer"
    window.click("dialog list", 0.5, (row + 0.5) / 12)
    window.wait_for("other figures", lambda s: not s["dialog"] and s["figures"] != figures)

    # keys that are typed at once are for the list, and none is a shortcut; Enter runs
    known = len(window.states())
    window.xdotool("key", "ctrl+k", "type", "--delay", 15, "full")
    window.wait_for("what is typed", lambda s: s["texts"].get("dialog line") == "full")
    assert not any(state["fullscreen"] for state in window.states()[known:])
    window.key("Return")
    window.wait_for("fullscreen", lambda s: not s["dialog"] and s["fullscreen"])

    # keys select: the last command is about the program
    window.chord("k")
    window.wait_for(*LIST)
    for _ in range(len(everything) // 12 + 1):
        window.key("Next")
    window.key("Return")
    window.wait_for("about", lambda s: s["dialog"] == "message")
