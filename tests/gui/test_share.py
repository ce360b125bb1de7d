"""The menus Export and Share: files and folders are written, and a take is served with a QR code of its address."""

from __future__ import annotations

import shutil
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2

from tests.support.waiting import wait_until


def test_export_share_and_serve(
    open_window: Callable[..., Any], stream_folder: Path, tmp_path: Path, artifacts: Path
) -> None:
    folder = Path(shutil.copytree(stream_folder, tmp_path / "walk"))
    window = open_window(str(folder))
    window.wait_for("the stream", lambda s: s["frames"] == 12)
    # an export that is refused keeps what was typed
    window.menu("Export", "export")
    window.wait_for("the options", lambda s: s["dialog"] == "export" and s["typing"])
    window.retype("dialog line", str(folder))
    window.click("dialog save")
    window.wait_for("a refusal", lambda s: s["dialog"] == "export" and s["texts"]["dialog line"] == str(folder))
    window.screenshot(artifacts / "export_refused.png")
    window.retype("dialog line", str(tmp_path / "frames"))
    window.click("dialog save")
    window.saw("what was written", lambda s: s["notice"].startswith("Written: "), 0, 180)
    assert len(list((tmp_path / "frames").glob("*.ply"))) == 12

    window.menu("Share", "share folder")
    window.wait_for("dialog", lambda s: s["dialog"] == "share")
    assert window.states()[-1]["texts"]["dialog line"] == str(tmp_path / "walk-share")
    window.xdotool("type", "--delay", "40", "A walk")  # the first field has the focus
    window.wait_for("the title", lambda s: s["texts"].get("dialog title") == "A walk")
    window.screenshot(artifacts / "share.png")
    places = window.states()[-1]["widgets"]
    assert places["dialog line"][0] == places["dialog title"][0], "the output is below the other fields"
    window.click("dialog save")
    window.wait_for("what was written", lambda s: s["notice"].startswith("Shared: "), 180)
    assert (tmp_path / "walk-share" / "stream" / "manifest.json").read_bytes() == (
        folder / "manifest.json"
    ).read_bytes()
    state = window.states()[-1]
    assert state["dialog"] == "", "nothing stops the work"
    assert "notice open_folder" in state["widgets"]
    assert "<title>A walk</title>" in (tmp_path / "walk-share" / "index.html").read_text()

    window.menu("Share", "share folder")
    state = window.wait_for("dialog again", lambda s: s["dialog"] == "share")
    assert state["texts"]["dialog title"] == "A walk", "it begins with what was chosen last"
    window.click("dialog line")
    window.key("End")
    window.xdotool("type", "--delay", "20", "name" * 65)  # longer than file systems allow
    window.wait_for("the name", lambda s: s["texts"]["dialog line"].endswith("walk-share" + "name" * 65))
    window.click("dialog save")
    window.drawn()
    window.screenshot(artifacts / "share_refused.png")
    window.xdotool("type", "z")
    window.wait_for("the first field focused", lambda s: s["texts"].get("dialog title", "")[-1:] == "z")
    assert "bug" not in window.states()[-1]["notice"]
    window.click("dialog close")
    window.wait_for("no dialog", lambda s: not s["dialog"])
    window.menu("Share", "share folder")
    window.wait_for("dialog again", lambda s: s["dialog"] == "share")
    window.click("dialog save")
    window.wait_for("a question", lambda s: s["dialog"] == "ask")
    (tmp_path / "walk-share" / "index.html").write_text("the earlier page")
    window.screenshot(artifacts / "share_replace.png")
    window.click("dialog replace")
    window.wait_for("the new page", lambda s: s["exporting"] == "" and not s["dialog"], 180)
    wait_until("replaced", lambda: "A walk" in (tmp_path / "walk-share" / "index.html").read_text(), 180)

    window.menu("Share", "serve")
    window.wait_for("dialog", lambda s: s["dialog"] == "serve")
    window.click("dialog https", 0.1)
    window.drawn()
    window.screenshot(artifacts / "serve.png")
    window.click("dialog save")
    state = window.wait_for("the code", lambda s: s["dialog"] == "serving" and s["widgets"].get("dialog qr"), 180)
    assert state["serving"].startswith("http://")
    for _ in range(30):  # on a busy machine, the dialog is on the screen some frames after the state says so
        window.drawn()
        picture = window.screenshot(artifacts / "serving.png")
        left, top = window.point("dialog qr", 0, 0)
        right, bottom = window.point("dialog qr", 1, 1)
        read = cv2.QRCodeDetector().detectAndDecode(cv2.imread(str(picture))[top:bottom, left:right])[0]
        if read:
            break
    assert read == state["serving"]
    port = state["serving"].rstrip("/").rpartition(":")[2]
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/manifest.json") as answer:
        assert answer.read() == (folder / "manifest.json").read_bytes()
    window.click("dialog stop")
    window.wait_for("the end", lambda s: s["serving"] == "" and s["dialog"] == "")
    assert window.close() == 0
