"""The menu Share: a folder is written, and a take is served with a QR code that says its address."""

from __future__ import annotations

import shutil
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2


def test_share_and_serve(open_window: Callable[..., Any], stream_folder: Path, tmp_path: Path, artifacts: Path) -> None:
    folder = Path(shutil.copytree(stream_folder, tmp_path / "walk"))
    window = open_window(str(folder))
    window.wait_for("the stream", lambda s: s["frames"] == 12)
    window.menu("Share", 0)
    window.wait_for("dialog", lambda s: s["dialog"] == "share")
    assert window.states()[-1]["texts"]["dialog line"] == str(tmp_path / "walk-share")
    window.drawn()
    window.screenshot(artifacts / "share.png")
    window.click("dialog save")
    window.wait_for("what was written", lambda s: s["notice"].startswith("Written: "), 180)
    assert (tmp_path / "walk-share" / "stream" / "manifest.json").read_bytes() == (
        folder / "manifest.json"
    ).read_bytes()
    assert window.states()[-1]["dialog"] == "", "nothing stops the work"

    window.menu("Share", 2, separators=1)
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
