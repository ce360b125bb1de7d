"""The start page, notices and the queue of takes in the window."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.waiting import wait_until
from v3studio.gui.platform.clipboard import Clipboard
from v3studio.pipelines.batch.queue_file import QueueFile

ROWS = 12
"""Of the list in the queue's dialog."""


OF_TAKE = (
    "alone", "camera", "compare", "edits", "error", "frames", "marks", "message", "mode", "orbit", "path", "places",
    "plots", "span", "stages", "texts", "what",
)  # fmt: skip
"""Parts of the state that belong to the open take."""


def ready(state: dict[str, Any]) -> bool:
    """Whether an opened take is shown."""
    return bool(not state["start"] and not state["opening"] and state["settled"] and state["shown"] is not None)


def lay_down(rig: Path) -> None:
    """Turn the cameras of a rig about x: what was up is at the side."""
    turn = np.eye(4)[[0, 2, 1, 3]] * [1, 1, -1, 1]
    found = json.loads(rig.read_text())
    for camera in found["cameras"]:
        camera["world_to_camera"] = (np.array(camera["world_to_camera"]) @ turn).tolist()
    rig.write_text(json.dumps(found))


def initialized(window: Any) -> np.ndarray:
    """What *Initialize* shows; *Review* is shown again."""
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


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two pictures of the window are the same, but for noise."""
    return one.shape == other.shape and bool(np.abs(one.astype(int) - other).mean() < 0.5)


@pytest.fixture
def clipboard(display: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Clipboard]:
    """The clipboard of another program."""
    monkeypatch.setenv("DISPLAY", display)
    found = Clipboard()
    yield found
    found.close()


def test_from_the_start_page_to_a_notice_and_a_queue(
    open_window: Callable[..., Any],
    clipboard: Clipboard,
    take_copy: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    opened, programs = tmp_path / "opened.txt", tmp_path / "bin"
    programs.mkdir()
    (programs / "xdg-open").write_text(f'#!/bin/sh\necho "$1" > "{opened}"\n')
    (programs / "xdg-open").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:/usr/bin:/bin")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    settings = tmp_path / "config" / "v3studio" / "window.json"
    settings.parent.mkdir(parents=True)
    settings.write_text(json.dumps({"recent": [str(tmp_path / "gone"), str(take_copy)]}))

    window = open_window()
    state = window.wait_for("cards", lambda s: s["start"] and len(s["cards"]) == 2)
    assert [card[0] for card in state["cards"]] == ["gone", "take"]
    assert state["cards"][0][1].startswith("missing")
    assert state["cards"][1][1] == "all stages done"
    evaluation = json.loads((take_copy / "evaluation.json").read_text())
    assert state["cards"][1][2] == pytest.approx(evaluation["summary"]["psnr_decoded"])

    # fullscreen by the menu and back: the page alone, without panels
    panels = {"timeline", "stages", "inspector", "status"}
    full = window.menu("View", "fullscreen", until=("fullscreen", lambda s: s["fullscreen"]))
    assert not panels & set(full["widgets"])
    state = window.key("Escape", until=("the page in a window", lambda s: not s["fullscreen"]))
    assert state["start"]
    assert not panels & set(state["widgets"])

    # a missing one is removed, the other one opened, by keys
    window.key("Down", until=("the first card", lambda s: s["focus"] in ("card 0", "forget")))
    for _ in range(4):
        if window.states()[-1]["focus"] != "card 0":
            window.key("Down")
    assert window.states()[-1]["focus"] == "card 0"
    window.key("Delete", until=("one card", lambda s: [card[0] for card in s["cards"]] == ["take"]))
    assert json.loads(settings.read_text())["recent"] == [str(take_copy)]
    window.key("Return")
    window.wait_for(
        "the take", lambda s: not s["start"] and s["shown"] is not None and s["title"] == "take - V3 Studio"
    )

    # another take, in which much is changed; nothing of it is left in the first one
    mesh = initialized(window)
    fresh = window.wait_for("its picture", lambda s: ready(s) and s["plots"])
    other = Path(shutil.copytree(take_copy, tmp_path / "other"))
    lay_down(other / "calibrate" / "rig.json")

    def paste(path: Path) -> dict[str, Any]:
        """Open a take from the start page; its state once it is shown."""
        window.key("h", until=("the start page", lambda s: s["start"]))
        assert clipboard.copy(str(path))
        window.chord("v")
        title = f"{path.name} - V3 Studio"
        found: dict[str, Any] = window.wait_for(
            path.name, lambda s: clipboard.poll() is None and s["title"] == title and ready(s)
        )
        return found

    state = paste(other)
    assert state["orbit"] != fresh["orbit"]
    window.drag("timeline", (window.across_frame(1), 0.1), (window.across_frame(3), 0.1))
    window.wait_for("a span", lambda s: s["span"] == [1, 3])
    window.key("m", until=("the question", lambda s: s["dialog"] == "mark" and s["typing"]))
    window.key("Return", until=("the mark", lambda s: s["marks"] and not s["dialog"]))
    window.key("d")
    window.key("c")
    window.wait_for("a comparison from a camera", lambda s: s["compare"] == "difference" and s["camera"] and ready(s))
    assert not same(initialized(window), mesh), "up is at the side, in this take only"
    paste(take_copy)
    assert same(initialized(window), mesh)
    again = window.wait_for("its picture", ready)
    assert {key: again[key] for key in OF_TAKE} == {key: fresh[key] for key in OF_TAKE}

    # back to the start page; a copied path that is wrong; its message is copied
    window.key("h", until=("the start page", lambda s: s["start"] and not s["playing"]))
    assert clipboard.copy(str(tmp_path / "nowhere"))
    window.chord("v")
    window.wait_for("a failure", lambda s: clipboard.poll() is None and "nowhere: no such folder" in s["notice"])
    window.chord("c")
    window.saw("a copy", lambda s: s["notice"] == "Copied the message.")
    clipboard.ask()
    texts: list[str | None] = []

    def pasted() -> bool:
        texts.append(clipboard.poll())
        return texts[-1] is not None

    wait_until("the message on the clipboard", pasted)
    assert str(texts[-1]).startswith(f"{tmp_path / 'nowhere'}: no such folder")
    window.wait_for("the failure again", lambda s: any(name.startswith("notice ") for name in s["widgets"]))
    window.key("Escape", until=("no failure", lambda s: not any(name.startswith("notice ") for name in s["widgets"])))
    assert window.states()[-1]["start"]

    # a remark in fullscreen is shown over the view
    window.key("Escape", until=("the take", lambda s: not s["start"]))
    window.key("f", until=("fullscreen", lambda s: s["fullscreen"] and not panels & set(s["widgets"])))
    window.key("t")
    told = window.saw(
        "a remark over the view",
        lambda s: s["fullscreen"] and "status" in s["widgets"] and s["widgets"]["status"][3] > 0,
    )
    (x, y, width, height), (left, top, wide, high) = told["widgets"]["status"], told["widgets"]["viewport"]
    assert left < x < x + width < left + wide
    assert top < y < y + height < top + high
    window.key("Escape")
    window.key("Escape", until=("the panels", lambda s: not s["fullscreen"] and "timeline" in s["widgets"]))
    window.key("h", until=("the start page again", lambda s: s["start"]))
    window.choose("back", until=("the take again", lambda s: not s["start"]))

    # a notice with what can be done next
    window.wait_for("a picture", lambda s: not s["playing"] and s["settled"])
    window.menu("File", "screenshot", until=("the question", lambda s: s["dialog"] == "screenshot" and s["typing"]))
    window.key("Return")
    state = window.saw("the notice", lambda s: s["notice"].startswith("Written: "))
    written = Path(state["notice"].removeprefix("Written: "))
    assert written.is_file()
    window.chord("o")  # while the notice is shown
    wait_until("the folder", opened.exists)
    wait_until("its name", lambda: opened.read_text() == f"{written.parent}\n")

    # the queue: a take that fails does not stop the next one
    queue = QueueFile(tmp_path / "state" / "v3studio" / "queue.json")
    gone, broken = tmp_path / "gone", tmp_path / "broken"
    shutil.copytree(take_copy, broken, ignore=shutil.ignore_patterns("train", "stream", "initialize"))
    settings = (broken / "config.yaml").read_text()
    (broken / "config.yaml").write_text(settings.replace("  root: ", "  root: /nowhere"))
    queue.add(gone, None, ())
    queue.add(broken, None, ())

    def shown(*rows: str) -> None:
        """Wait until the list shows these rows; each begins with the given text."""
        window.wait_for(
            f"{rows}", lambda s: len(s["lines"]) == len(rows) and all(map(str.startswith, s["lines"], rows)), 240
        )

    def choose(row: int) -> None:
        window.click("dialog list", 0.2, 0.011 + (row + 0.5) / ROWS)

    window.key("q")
    shown("1   gone   waiting", "2   broken   waiting")
    window.click("dialog add_open")
    shown("1   gone   waiting", "2   broken   waiting", "3   take   waiting")
    choose(0)
    window.click("dialog remove")
    shown("2   broken   waiting", "3   take   waiting")
    choose(1)
    window.click("dialog up")
    shown("3   take   waiting", "2   broken   waiting")
    window.click("dialog down")
    shown("2   broken   waiting", "3   take   waiting")
    window.click("dialog start")
    shown("2   broken   failed", "3   take   done")
    wait_until("the end of the program", lambda: not queue.is_run())
    choose(0)
    window.click("dialog retry")
    shown("3   take   done", "2   broken   waiting")
    window.click("dialog close", until=("no dialog", lambda s: s["dialog"] == ""))
    assert window.close() == 0, window.stderr.read_text()[-2000:]
    assert "top-level" not in window.stderr.read_text(), "Open3D draws more than 20 widgets of a window wrongly"
