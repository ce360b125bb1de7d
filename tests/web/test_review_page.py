"""A client reviews a take in a browser: curves, the wipe with footage, marks; the link to watch cannot change them."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest
from driver import PATIENCE, Page

from pipelines.share.player_files import read_player
from pipelines.share.served_streams import find_reviews, find_streams
from pipelines.share.web_app import Reviews, build_app
from pipelines.takes.marks import read_marks
from pipelines.takes.take import Take
from tests.support.web_servers import running

pytestmark = pytest.mark.web

SECRET = "k3y"
WIPE = "document.querySelector('v3-player').shadowRoot.querySelector('.wipe')"
# opacity and color of the wipe's picture at a place, both 0 to 1
LOOK = f"""([x, y]) => {{
  const canvas = {WIPE}.querySelector('canvas');
  const at = [Math.round(x * (canvas.width - 1)), Math.round(y * (canvas.height - 1))];
  return [...canvas.getContext('2d').getImageData(...at, 1, 1).data];
}}"""


@pytest.fixture
def take(finished: Path, tmp_path: Path) -> Take:
    return Take.open(Path(shutil.copytree(finished, tmp_path / "project")) / "take")


@pytest.fixture
def address(browser: Any, take: Take) -> Iterator[str]:
    streams = find_streams(str(take.root))
    with running(build_app(streams, read_player(), Reviews(SECRET, find_reviews(streams)))) as port:
        yield f"http://127.0.0.1:{port}/"


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Page]:
    """The review, paused at the first frame."""
    context = browser.new_context(viewport={"width": 640, "height": 900})
    page = Page(context.new_page())
    page.handle.goto(f"{address}{SECRET}/?t=0")
    page.wait_ready()
    page.handle.wait_for_selector(".v3-review .plot")
    yield page
    context.close()
    assert not page.errors, page.errors


def curve(page: Page, kind: str, low: float, high: float) -> list[float]:
    """Values by frame of a curve as it is drawn between the axis labels."""
    path = page.handle.locator(f".v3-review .plot.psnr path.{kind}").get_attribute("d")
    points = re.findall(r"[ML]([\d.]+) (-?[\d.]+)", path)
    return [high - (high - low) * float(y) / 100 for _, y in points]


def test_curves_and_figures_are_those_of_the_evaluation(page, take):
    values = json.loads(take.evaluation.read_text())
    labels = page.handle.locator(".v3-review .plot.psnr .labels span").all_inner_texts()
    high, low = (float(label.removesuffix(" dB")) for label in labels)
    for kind in ("decoded", "trained"):
        want = [row[f"psnr_{kind}"] for row in values["frames"]]
        assert curve(page, kind, low, high) == pytest.approx(want, abs=0.01)
    assert "held-out camera cam4" in page.handle.locator(".v3-review .name").first.inner_text()
    for frame in (0, 3):
        page.seek_frame(frame)
        row = values["frames"][frame]
        text = page.handle.locator(".v3-review .readout").inner_text()
        assert f"Frame {frame}" in text
        assert f"decoded {row['psnr_decoded']:.2f} dB, trained {row['psnr_trained']:.2f} dB" in text
        assert f"size {row['bytes'] / 1000:.1f} kB" in text
    box = page.handle.locator(".v3-review .area").bounding_box()
    page.handle.mouse.click(box["x"] + box["width"] * 0.5, box["y"] + box["height"] * 0.5)
    page.wait("player.state.frame === 2")


def test_the_wipe_shows_the_footage_of_the_frame_and_moves(page, take):
    page.handle.select_option(".v3-review select", "cam4")
    page.handle.get_by_label("whole picture").check()
    page.wait(f"{WIPE}.dataset.frame === '0'")
    assert "footage of cam4" in page.evaluate(f"() => {WIPE}.textContent")
    assert page.evaluate(LOOK, [0.45, 0.5])[3] == 255
    assert page.evaluate(LOOK, [0.55, 0.5])[3] == 0, "the decoded stream, which is drawn below"

    page.evaluate("() => document.querySelector('v3-player').classList.add('idle')")  # as after some time of playing
    box = page.handle.locator("v3-player .wipe").bounding_box()
    at = box["y"] + box["height"] * 0.3
    page.handle.mouse.move(box["x"] + box["width"] * 0.5, at)
    page.handle.mouse.down()
    assert not page.evaluate("() => document.querySelector('v3-player').classList.contains('idle')"), (
        "controls are back"
    )
    page.handle.mouse.move(box["x"] + box["width"] * 0.8, at, steps=4)
    page.handle.mouse.up()
    assert page.handle.locator("v3-player .wipe [role=slider]").get_attribute("aria-valuenow") == "80"
    assert page.evaluate(LOOK, [0.75, 0.5])[3] == 255
    assert page.evaluate(LOOK, [0.85, 0.5])[3] == 0
    assert page.evaluate("() => document.querySelector('.v3-review select').value") == "cam4", "the view did not turn"

    page.seek_frame(3)
    page.wait(f"{WIPE}.dataset.frame === '3'")
    filmed = cv2.imread(str(take.root.parent / "capture" / "images" / "cam4" / "003.png"), cv2.IMREAD_UNCHANGED)
    middle = filmed[23:25, 31:33, :3].reshape(-1, 3)[:, ::-1]
    shown = page.evaluate(LOOK, [0.5, 0.5])[:3]
    assert shown == pytest.approx(middle.mean(0).tolist(), abs=20)


def test_a_mark_is_written_to_the_take_and_shown_after_reloading(page, take):
    page.seek_frame(3)
    page.handle.get_by_role("button", name="Mark this frame").click()
    page.handle.get_by_placeholder("Note").fill("The axe <b>blurs</b>")
    page.handle.get_by_placeholder("Your name").fill("Jane")
    page.handle.get_by_role("button", name="Save").click()
    page.handle.wait_for_selector(".v3-review li", timeout=PATIENCE)
    marks = read_marks(take.marks)
    assert {frame: (mark.note, mark.author) for frame, mark in marks.items()} == {3: ("The axe <b>blurs</b>", "Jane")}
    page.handle.reload()
    page.wait_ready()
    page.handle.wait_for_selector(".v3-review li", timeout=PATIENCE)
    assert "The axe <b>blurs</b> Jane" in page.handle.locator(".v3-review li").inner_text()
    page.handle.locator(".v3-review .strip button").click()
    page.wait("player.state.frame === 3")


def test_the_link_to_watch_shows_no_review_and_cannot_write(page, take, address, browser):
    page.handle.evaluate("() => { navigator.clipboard.writeText = async text => { window.copied = text; }; }")
    page.click("link")
    page.wait("window.copied")
    link = page.evaluate("() => window.copied")
    assert link.startswith(f"{address}?t=0")
    context = browser.new_context()
    watching = Page(context.new_page())
    watching.handle.goto(link)
    watching.wait_ready()
    assert watching.handle.locator(".v3-review").count() == 0
    change = {"frame": 1, "mark": {"note": "no", "author": ""}, "replaces": None}
    status = watching.evaluate(
        """async body => (await fetch('.review/marks', {
          method: 'POST', headers: {'Content-Type': 'application/json'}, body: JSON.stringify(body)
        })).status""",
        change,
    )
    assert status in (404, 405)
    assert read_marks(take.marks) == {}
    context.close()
