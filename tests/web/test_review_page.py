"""A client reviews a take in a browser: curves, the wipe with footage, marks and their views, and links."""

import json
import math
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from driver import OpenPage, Page

from tests.support.web_servers import running
from v3studio.pipelines.share.player_files import read_player
from v3studio.pipelines.share.served import find_reviews, find_streams
from v3studio.pipelines.share.web_app import Reviews, build_app
from v3studio.pipelines.takes.authored.marks import Mark, change_mark, read_marks
from v3studio.pipelines.takes.take import Take
from v3studio.studio.stream import BakeSettings, StreamReader, write_manifest

pytestmark = pytest.mark.web

SECRET = "k3y"
WIPE = "document.querySelector('v3-player').shadowRoot.querySelector('.wipe')"
# opacity and color of the wipe's picture at a place, both 0 to 1
LOOK = f"""([x, y]) => {{
  const canvas = {WIPE}.querySelector('canvas');
  const at = [Math.round(x * (canvas.width - 1)), Math.round(y * (canvas.height - 1))];
  return [...canvas.getContext('2d').getImageData(...at, 1, 1).data];
}}"""


@pytest.fixture(scope="module")
def take(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Take:
    return Take.open(Path(shutil.copytree(finished, tmp_path_factory.mktemp("reviewed") / "project")) / "take")


@pytest.fixture(scope="module")
def address(take: Take) -> Iterator[str]:
    streams = find_streams(str(take.root))
    with running(build_app(streams, read_player(), Reviews(SECRET, find_reviews(streams)))) as port:
        yield f"http://127.0.0.1:{port}/"


@pytest.fixture(scope="module")
def review(chromium: Any, address: str) -> Iterator[Page]:
    with chromium.page((640, 900), reduced_motion="reduce") as page:
        page.handle.goto(f"{address}{SECRET}/?t=0")
        page.wait_ready()
        yield page


@pytest.fixture
def page(review: Page, browser: Any) -> Page:
    """The review, paused at the first frame without a comparison; the tests of this file mark different frames."""
    review.handle.set_viewport_size({"width": 640, "height": 900})
    review.handle.wait_for_selector(".v3-review .plot", state="attached")
    for name in ("End comparison", "Cancel"):
        if (button := review.handle.get_by_role("button", name=name, exact=True)).is_visible():
            button.click()
    review.handle.locator("v3-player .stage").press("Escape")
    review.call("resetView")
    review.seek_frame(0)
    assert not review.errors, review.errors
    return review


def curve(page: Page, kind: str, low: float, high: float) -> list[float]:
    """Values by frame of a curve as it is drawn between the axis labels."""
    path = page.handle.locator(f".v3-review .plot.quality path.{kind}").get_attribute("d")
    points = re.findall(r"[ML]([\d.]+) (-?[\d.]+)", path)
    return [high - (high - low) * float(y) / 100 for _, y in points]


def test_curves_and_figures_are_those_of_the_evaluation(page: Page, take: Take) -> None:
    values = json.loads(take.evaluation.read_text())
    assert not page.handle.locator(".v3-review .readout").is_visible(), "numbers are shown on request"
    page.handle.get_by_text("Numbers", exact=True).click()
    limits = page.handle.locator(".v3-review .range").first.inner_text()
    low, high = map(float, limits.removesuffix(" dB").split(" to "))
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
        assert f"size {row['bytes'] / 1000:.1f} KB" in text
    box = page.handle.locator(".v3-review .area").bounding_box()
    page.handle.mouse.click(box["x"] + box["width"] * 0.5, box["y"] + box["height"] * 0.5)
    page.wait("player.state.frame === 2")
    shown = page.handle.locator(".v3-review .plot.quality .tick").all_inner_texts()
    assert len(shown) >= 2
    assert all(low <= float(value) <= high for value in shown)
    page.handle.get_by_text("Numbers", exact=True).click()


@pytest.mark.parametrize(("locale", "mark"), [("de-DE", "Dieses Bild markieren"), ("ja-JP", "このフレームにマーク")])
def test_the_words_are_in_the_viewers_language(
    chromium: Any, browser: Any, address: str, locale: str, mark: str
) -> None:
    with chromium.page((640, 900), reduced_motion="reduce", locale=locale) as page:
        page.handle.goto(f"{address}{SECRET}/?t=0")
        page.handle.get_by_role("button", name=mark).wait_for()
        panel = page.handle.locator(f".v3-review[lang={locale[:2]}]")
        assert not re.search(r"\b(mark|frame|good|bad|loss|numbers|compare)\b", panel.inner_text(), re.IGNORECASE)
        page.handle.locator(".v3-review summary").click()
        assert not re.search(r"\b(frame|camera|decoded|trained|size)\b", panel.locator(".numbers").inner_text())


def test_a_comment_at_a_place_in_the_image(page: Page, take: Take) -> None:
    page.seek_frame(4)
    page.handle.get_by_role("button", name="Mark this frame").click()
    page.handle.get_by_placeholder("Note").fill("finger")
    box = page.handle.locator("v3-player .stage").bounding_box()
    x, y = box["x"] + box["width"] * 0.6, box["y"] + box["height"] * 0.4
    page.handle.mouse.click(x, y)
    pin = page.handle.locator("v3-player .pins i")

    def at():
        box = pin.bounding_box()
        return [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]

    assert at() == pytest.approx([x, y], abs=1)
    page.handle.get_by_role("button", name="Save").click()
    page.handle.get_by_role("button", name="Go to frame 4").wait_for()
    assert read_marks(take.marks)[4].view.place is not None
    page.seek_frame(0)
    assert pin.count() == 0
    page.call("setView", {"azimuth": 60})
    page.handle.get_by_role("button", name="Go to frame 4").click()
    pin.wait_for()
    box = page.handle.locator("v3-player .stage").bounding_box()
    assert at() == pytest.approx([x, box["y"] + box["height"] * 0.4], abs=12), "the form has changed the image's shape"


def test_the_wipe_shows_the_footage_of_the_frame_and_moves(page: Page, take: Take) -> None:
    page.handle.get_by_role("button", name="Compare with footage").click()
    assert page.handle.input_value(".v3-review select") == "cam4"
    page.handle.get_by_label("whole image").check()
    page.wait(f"{WIPE}.dataset.frame === '0'")
    assert "Footage of cam4" in page.evaluate(f"() => {WIPE}.textContent")
    assert page.evaluate(LOOK, [0.45, 0.5])[3] == 255
    assert page.evaluate(LOOK, [0.55, 0.5])[3] == 0, "the decoded stream, which is drawn below"

    page.evaluate("() => document.querySelector('v3-player').classList.add('idle')")  # as after some time of playing
    box = page.handle.locator("v3-player .wipe").bounding_box()
    at = box["y"] + box["height"] * 0.3
    page.handle.mouse.move(box["x"] + box["width"] * 0.5, at)
    page.handle.mouse.down()
    page.wait("!player.classList.contains('idle')")  # controls are back
    page.handle.mouse.move(box["x"] + box["width"] * 0.8, at, steps=4)
    page.handle.mouse.up()
    assert page.handle.locator("v3-player .wipe [role=slider]").get_attribute("aria-valuenow") == "80"
    assert page.evaluate(LOOK, [0.75, 0.5])[3] == 255
    assert page.evaluate(LOOK, [0.85, 0.5])[3] == 0
    assert page.handle.get_by_role("button", name="End comparison").is_visible(), "the view did not turn"

    page.seek_frame(3)
    page.wait(f"{WIPE}.dataset.frame === '3'")
    filmed = cv2.imread(str(take.root.parent / "capture" / "images" / "cam4" / "003.png"), cv2.IMREAD_UNCHANGED)
    middle = filmed[23:25, 31:33, :3].reshape(-1, 3)[:, ::-1]
    shown = page.evaluate(LOOK, [0.5, 0.5])[:3]
    assert shown == pytest.approx(middle.mean(0).tolist(), abs=20)


def test_a_mark_is_written_to_the_take_and_shown_after_reloading(page: Page, take: Take) -> None:
    page.seek_frame(3)
    page.handle.get_by_role("button", name="Mark this frame").click()
    page.handle.get_by_placeholder("Note").fill("The axe <b>blurs</b>")
    page.handle.get_by_placeholder("Your name").fill("Jane")
    page.handle.get_by_role("button", name="Save").click()
    said = page.handle.get_by_text("The axe <b>blurs</b> Jane")
    said.wait_for()
    mark = read_marks(take.marks)[3]
    assert (mark.note, mark.author) == ("The axe <b>blurs</b>", "Jane")
    page.handle.reload()
    page.wait_ready()
    said.wait_for()
    page.handle.get_by_role("button", name="Mark at frame 3", exact=True).click()
    page.wait("player.state.frame === 3")


def test_a_mark_keeps_its_view_and_leads_back_to_it(page: Page, take: Take) -> None:
    page.seek_frame(2)
    page.call("setView", {"azimuth": 35, "elevation": 12, "distance": 2.5})
    marked = page.state["view"]
    page.handle.locator("v3-player .stage").press("n")
    page.handle.get_by_placeholder("Note").fill("hand")
    page.handle.get_by_placeholder("Note").press("Enter")
    page.handle.get_by_role("button", name="Go to frame 2").wait_for()
    saved = read_marks(take.marks)[2].view
    assert saved.camera == ""
    assert math.dist(saved.eye, saved.target) == pytest.approx(2.5)
    camera = page.evaluate("() => document.querySelector('v3-player').engine.camera.pinhole(640, 400)")
    center = -np.array(camera["rotation"]).reshape(3, 3).T @ camera["translation"]
    assert saved.eye == pytest.approx(center.tolist())

    page.call("setView", {"azimuth": -80, "elevation": 0, "distance": 4})
    page.seek_frame(4)
    page.handle.get_by_role("button", name="Go to frame 2").click()
    page.wait("player.state.frame === 2")
    for name, value in marked.items():
        assert page.state["view"][name] == pytest.approx(value)

    # Another word in the note leaves the view as it was, the comparison that is on the screen replaces it.
    page.handle.get_by_role("button", name="Edit the mark at frame 2").click()
    page.handle.get_by_placeholder("Note").fill("left hand")
    page.handle.get_by_role("button", name="Save").click()
    page.handle.get_by_text("left hand").wait_for()
    assert read_marks(take.marks)[2].view == saved
    page.handle.get_by_role("button", name="Compare with footage").click()
    page.handle.locator("v3-player .wipe [role=slider]").press("End")
    page.handle.get_by_role("button", name="Mark this frame").click()
    page.handle.get_by_role("button", name="Save").click()
    page.handle.wait_for_selector(".v3-review form", state="hidden")
    compared = read_marks(take.marks)[2].view
    assert (compared.camera, compared.wipe) == ("cam4", 1)
    page.handle.get_by_role("button", name="End comparison").click()
    page.handle.get_by_role("button", name="Mark at frame 2", exact=True).click()
    page.handle.get_by_role("button", name="End comparison").wait_for()
    assert page.handle.locator("v3-player .wipe [role=slider]").get_attribute("aria-valuenow") == "100"


def test_a_note_that_is_not_saved_is_not_replaced(page: Page, take: Take) -> None:
    page.handle.set_viewport_size({"width": 1200, "height": 900})  # the list of marks stays beside the form
    change_mark(take.marks, 1, Mark(frame=1, note="elbow"), None)
    page.handle.get_by_text("elbow").wait_for()
    page.handle.locator("v3-player .stage").press("n")
    note = page.handle.get_by_placeholder("Note")
    note.fill("the hand is blur")
    page.handle.locator("v3-player .stage").press("n")
    page.handle.get_by_role("button", name="Edit the mark at frame 1").click()
    assert note.input_value() == "the hand is blur"
    assert "Save or cancel" in page.handle.locator(".v3-review .trouble").inner_text()
    page.handle.keyboard.type("red")
    note.press("Enter")
    page.handle.wait_for_selector(".v3-review form", state="hidden")
    assert read_marks(take.marks)[0].note == "the hand is blurred"


def test_a_mark_that_somebody_removes_while_it_is_edited(page: Page, take: Take) -> None:
    """The only one: an empty list of marks is an answer, too."""
    for number, old in read_marks(take.marks).items():
        change_mark(take.marks, number, None, old)
    knee = Mark(frame=1, note="knee")
    change_mark(take.marks, 1, knee, None)
    page.handle.get_by_text("knee").wait_for()
    page.handle.get_by_role("button", name="Edit the mark at frame 1").click()
    page.handle.get_by_placeholder("Note").fill("left knee")
    change_mark(take.marks, 1, None, knee)
    page.handle.get_by_role("button", name="Save").click()
    page.handle.get_by_text("The mark was removed.").wait_for()
    page.handle.get_by_role("button", name="Save").click()
    page.handle.wait_for_selector(".v3-review form", state="hidden")
    assert read_marks(take.marks)[1].note == "left knee"


def test_the_link_to_watch_cannot_write(page: Page, take: Take, address: str, open_page: OpenPage) -> None:
    page.evaluate("() => { navigator.clipboard.writeText = async text => { window.copied = text; }; }")
    page.click("link")
    button = page.handle.get_by_role("button", name="Share link to watch")
    button.wait_for()
    assert page.evaluate("() => window.copied") is None, "before one is chosen"
    button.click()
    page.wait("window.copied")
    link = page.evaluate("() => window.copied")
    assert link.startswith(f"{address}?t=0")
    assert "without the review" in page.handle.locator("v3-player .notice").inner_text()
    watching = open_page(address=link)
    assert watching.handle.locator(".v3-review").count() == 0
    change = {"frame": 1, "mark": {"note": "no", "author": ""}, "replaces": None}
    post = """async body => (await fetch('.review/marks', {
      method: 'POST', headers: {'Content-Type': 'application/json'}, body: JSON.stringify(body)
    })).status"""
    status = watching.evaluate(post, change)
    assert status in (404, 405)
    assert all(mark.note != "no" for mark in read_marks(take.marks).values())


def test_a_new_bake_is_reviewed_at_the_same_moment(page: Page, take: Take) -> None:
    page.seek_frame(3)
    page.call("setView", {"azimuth": 25})
    manifest = take.stream / "manifest.json"
    before = manifest.read_bytes()
    with StreamReader.open(take.stream) as reader:
        entries, metadata = (
            [reader.index.group(number) for number in range(len(reader.groups))],
            reader.manifest.metadata,
        )
        write_manifest(take.stream, entries, reader.fps, BakeSettings(), {**metadata, "title": "Baked again"})
    page.evaluate("() => { document.dispatchEvent(new Event('visibilitychange')); }")
    with page.handle.expect_navigation():
        page.handle.get_by_role("button", name="Show the new version").click()
    page.wait_ready()
    manifest.write_bytes(before)
    assert page.evaluate("() => document.querySelector('v3-player').engine.info.title") == "Baked again"
    assert page.state["frame"] == 3
    assert page.state["view"]["azimuth"] == pytest.approx(25)
