"""Touch, mouse, keyboard and buttons; links; the web component and its messages; accessibility."""

import json
import shutil
import time
from pathlib import Path

import pytest
import support
from driver import Baked, OpenPage, Page, Site

from tests.support.streams import edit_manifest
from v3studio.studio.calibration.coverage import view_range

pytestmark = pytest.mark.web

CALM = {"reduced_motion": "reduce"}


def middle(page):
    box = page.handle.locator("v3-player .stage").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 3


def drag(page, dx, dy, *, button="left", keys=(), start=None):
    x, y = start or middle(page)
    mouse = page.handle.mouse
    for key in keys:
        page.handle.keyboard.down(key)
    mouse.move(x, y)
    mouse.down(button=button)
    mouse.move(x + dx / 2, y + dy / 2, steps=3)
    mouse.move(x + dx, y + dy, steps=3)
    mouse.up(button=button)
    for key in keys:
        page.handle.keyboard.up(key)


def test_the_mouse_orbits_pans_and_zooms(page: Page) -> None:
    home = page.state["view"]
    assert home["azimuth"] == 0
    assert abs(home["elevation"] - 10) < 0.01
    drag(page, 80, 0)
    turned = page.state["view"]
    assert turned["azimuth"] > 20
    assert turned["elevation"] == home["elevation"]
    drag(page, 0, 40)
    assert page.state["view"]["elevation"] > home["elevation"] + 5
    before = page.state["view"]
    drag(page, 50, 0, button="right")
    moved = page.state["view"]
    assert moved["azimuth"] == before["azimuth"]
    assert moved["target"] != before["target"]
    x, y = middle(page)
    page.handle.mouse.move(x, y)
    page.handle.mouse.wheel(0, -120)
    page.wait("player.state.view.distance < argument", moved["distance"] * 0.95)
    page.handle.mouse.dblclick(x, y)
    page.wait("player.state.view.azimuth === 0")
    assert page.state["view"] == home


def test_what_is_dragged_follows_the_pointer(page: Page) -> None:
    """Orbiting right shows the figure's left: what is in front moves with the pointer."""
    script = """() => {
      const {camera} = document.querySelector('v3-player').engine;
      const {rotation: r, translation, fx, cx} = camera.pinhole(640, 500);
      const point = [0, 0, -0.2]; // nearer to the camera than the target
      const at = [0, 1, 2].map(k =>
        r[3*k] * point[0] + r[3*k + 1] * point[1] + r[3*k + 2] * point[2] + translation[k]);
      return at[0] / at[2] * fx + cx; }"""
    before = page.evaluate(script)
    drag(page, 60, 0)
    assert page.evaluate(script) > before + 5
    before = page.evaluate(script)
    drag(page, 60, 0, keys=["Shift"])
    assert abs(page.evaluate(script) - before - 60) < 15


def test_fingers_and_their_help(stream: Path, open_page: OpenPage) -> None:
    page = open_page("?t=0", size=(400, 500), has_touch=True, is_mobile=True, **CALM)
    page.click("settings")
    page.handle.locator("v3-player .settings [data-act='help']").click()
    text = page.handle.locator("v3-player .help").inner_text()
    assert "drag with one finger" in text
    assert "Space" not in text
    page.handle.keyboard.press("Shift")  # there is a keyboard after all
    assert "Space" in page.handle.locator("v3-player .help").inner_text()
    page.handle.keyboard.press("Escape")
    line = page.handle.locator("v3-player .timeline").bounding_box()
    at = line["y"] + line["height"] / 2
    page.touch("touchStart", [(line["x"] + 1, at)])
    page.evaluate("() => document.querySelector('v3-player').classList.add('idle')")  # the finger has rested for long
    page.touch("touchMove", [(line["x"] + 30, at)])
    page.wait("!player.classList.contains('idle')")
    page.touch("touchMove", [(line["x"] + 1, at)])
    page.touch("touchEnd", [])
    page.wait("player.state.frame === 0")
    home = page.state["view"]
    page.swipe(((200, 200), (-50, 0)))
    page.wait("player.state.view.azimuth < -10")
    before = page.state["view"]
    page.swipe(((150, 200), (-40, 0)), ((250, 200), (40, 0)))
    page.wait("player.state.view.distance < argument", before["distance"] * 0.8)
    after = page.state["view"]
    assert after["azimuth"] == before["azimuth"]
    page.swipe(((150, 200), (0, 50)), ((250, 200), (0, 50)))
    page.wait("Math.hypot(...player.state.view.target.map((v, k) => v - argument[k])) > 0.05", after["target"])
    began = time.time()  # a tap every 100 ms, however busy the machine is
    for number in range(2):
        page.touch("touchStart", [(200, 200)], began + 0.1 * number)
        page.touch("touchEnd", [], began + 0.1 * number + 0.05)
    page.wait("player.state.view.azimuth === 0")
    assert page.state["view"] == home


def test_a_first_visit_with_reduced_motion(stream: Path, open_page: OpenPage) -> None:
    """Nothing plays automatically; a hint and a large button invite, and neither is in the way."""
    spinner = """document.addEventListener('v3-ready', () => {
      const {shadowRoot} = document.querySelector('v3-player');
      const seen = {opacityProperty: true, visibilityProperty: true};
      window.spinning = shadowRoot.querySelector('.spinner').checkVisibility(seen);
    })"""
    page = open_page("", spinner, size=(400, 500), **CALM)
    assert page.evaluate("() => window.spinning") is False, "it disappears with the first image"
    assert not page.state["playing"]
    hint, start = page.handle.locator("v3-player .hint"), page.handle.locator("v3-player .start")
    hint.get_by_text("Drag to turn").wait_for()
    assert page.evaluate("() => document.querySelector('v3-player').shadowRoot.querySelector('.hint').role") == "status"
    assert hint.evaluate("one => getComputedStyle(one.querySelector('svg')).animationName") == "none"

    for height in (500, 300, 180):  # as in a page, or above a review
        page.handle.set_viewport_size({"width": 400, "height": height})
        play, said = start.bounding_box(), hint.bounding_box()
        assert said is None or play["y"] + play["height"] <= said["y"]
    page.handle.set_viewport_size({"width": 400, "height": 500})

    def center():
        box = start.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    drag(page, -80, 0, start=center())
    page.wait("player.state.view.azimuth < -20")
    hint.wait_for(state="hidden")
    assert not page.state["playing"]
    assert not start.is_visible()
    page.handle.reload()
    page.wait_ready()
    assert not hint.is_visible(), "nor at the next visit"
    page.handle.mouse.click(*center())
    page.wait("player.state.playing")
    assert not start.is_visible()


def test_keys(page: Page) -> None:
    assert page.handle.locator("v3-player [data-act='vr']:not([hidden])").count() == 0  # there is no headset
    assert not page.handle.locator("v3-player .start").is_visible()  # a link to a moment shows it
    keyboard = page.handle.keyboard
    page.handle.locator("v3-player .stage").focus()
    for key, name, value in ((".", "frame", 1), (",", "frame", 0), ("Space", "playing", True), ("k", "playing", False)):
        keyboard.press(key)
        page.wait(f"player.state.{name} === argument", value)
    keyboard.down("ArrowRight")
    page.wait("player.state.view.azimuth < -3")
    keyboard.up("ArrowRight")
    keyboard.press("r")
    page.wait("player.state.view.azimuth === 0")
    # The key of "+" is that of "=" once Shift is released.
    for key, press in (
        ("Shift", keyboard.down),
        ("Equal", keyboard.down),
        ("Shift", keyboard.up),
        ("Equal", keyboard.up),
    ):
        press(key)
    page.wait("player.state.view.distance < argument", page.state["view"]["distance"] + 1e-9)
    assert page.evaluate("() => document.querySelector('v3-player').ui.motion.keys.size") == 0
    keyboard.press("r")
    page.wait("player.state.view.azimuth === 0")
    keyboard.press(">")
    assert page.state["speed"] == 1.5
    keyboard.press("?")
    help_sheet = page.handle.locator("v3-player .help")
    assert "left button" in help_sheet.inner_text()
    assert "pinch" not in help_sheet.inner_text()
    keyboard.press("Escape")
    assert not help_sheet.is_visible()
    assert page.handle.locator("v3-player .spoken").text_content().startswith("Paused at ")
    keyboard.press("i")
    panel = page.handle.locator("v3-player .info")
    assert panel.is_visible()
    keyboard.press("Escape")
    assert not panel.is_visible()
    assert page.handle.locator("v3-player .bar [data-act='info']").get_attribute("aria-pressed") == "false"
    page.evaluate(
        """() => {
          const button = {pressed: false, value: 0};
          window.pads = [null, {axes: [1, 0, 0, 0], buttons: Array(8).fill(button)}];
          navigator.getGamepads = () => window.pads;
          window.dispatchEvent(new Event('gamepadconnected'));
        }"""
    )
    page.wait("Math.abs(player.state.view.azimuth) > 5")
    page.evaluate("() => { window.pads = []; }")


def test_an_intro_until_the_first_input(site: Site, stream: Path, open_page: OpenPage) -> None:
    eyes = [support.camera(azimuth) for azimuth in (60, 90)]
    keys = [{"time": 600 * i, "camera": eye.to_dict()} for i, eye in enumerate(eyes)]
    path = json.dumps({"format": "v3studio-camera-path", "version": 1, "keys": keys})
    html = (site.folder / "index.html").read_text().replace("<v3-player ", '<v3-player intro="#path" ')
    script = f'<script type="application/json" id="path">{path}</script>'
    (site.folder / "index.html").write_text(html.replace("</body>", f"{script}</body>"))
    page = open_page()
    page.wait("Math.abs(player.state.view.azimuth) > 59")
    assert abs(page.state["view"]["elevation"] - 10) < 0.1
    page.evaluate("() => document.addEventListener('v3-intro-ended', () => { window.ended = true; }, true)")
    page.handle.mouse.click(*middle(page))
    page.wait("window.ended")
    page.handle.goto(f"http://127.0.0.1:{site.port}/?view=20,5")  # a link to a view begins there
    page.wait_ready()
    assert page.state["view"]["azimuth"] == 20


def test_the_timeline(page: Page) -> None:
    line = page.handle.locator("v3-player .timeline")
    box = line.bounding_box()
    page.handle.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.wait("player.state.frame === 4")
    assert line.get_attribute("role") == "slider"
    assert line.get_attribute("aria-valuenow") == "4"
    assert line.get_attribute("aria-valuetext") == "0.2 of 0.4 seconds, frame 4"
    line.focus()
    page.handle.keyboard.press("ArrowRight")
    page.wait("player.state.frame === 5")
    page.handle.keyboard.press("End")
    page.wait("player.state.frame === 8")
    page.handle.mouse.move(box["x"] + box["width"] - 1, box["y"] + 10)
    page.handle.mouse.down()
    for part in (0.7, 0.4, 0.0):
        page.handle.mouse.move(box["x"] + 1 + part * (box["width"] - 2), box["y"] + 10, steps=4)
    preview = page.handle.locator("v3-player .bubble canvas")
    assert preview.is_visible()
    # A copy of a frame that was shown, not an empty canvas.
    brightest = """canvas => Math.max(...canvas.getContext('2d')
      .getImageData(0, 0, canvas.width, canvas.height).data.filter((_, i) => i % 4 < 3))"""
    assert preview.evaluate(brightest) > 60
    page.handle.mouse.up()
    page.wait("player.state.frame === 0")


def test_one_tap_opens_the_share_sheet_of_the_system(page: Page) -> None:
    """A sheet that the viewer closes is no reason to copy; one that fails is."""
    share = """name => {
      navigator.share = async what => { window.shared = what; if (name) throw new DOMException('', name); };
    }"""
    page.evaluate("() => navigator.clipboard.writeText('before')")
    for failure, copied in (("", False), ("AbortError", False), ("NotAllowedError", True)):
        page.evaluate("() => { window.shared = undefined; }")
        page.evaluate(share, failure)
        page.click("link")
        page.wait("window.shared")
        shared = page.evaluate("() => window.shared")
        assert shared["title"] == "Test figure"
        assert "t=0&view=" in shared["url"]
        if copied:
            page.wait("player.shadowRoot.querySelector('.notice.shown')?.textContent.includes('copied')")
        assert (page.evaluate("() => navigator.clipboard.readText()") == shared["url"]) is copied
    page.evaluate("() => { navigator.share = undefined; }")


def test_a_link_leads_to_the_same_moment_and_view(page: Page) -> None:
    page.seek_frame(6)
    drag(page, 70, 30)
    view = page.state["view"]
    page.click("link")
    page.wait("player.shadowRoot.querySelector('.notice.shown')?.textContent.includes('copied')")
    address = page.evaluate("() => navigator.clipboard.readText()")
    assert address == page.evaluate("() => location.href")
    page.call("resetView")
    page.handle.goto(address)
    page.wait_ready()
    page.wait("player.state.frame === 6")
    assert not page.state["playing"]
    there = page.state["view"]
    for key in ("azimuth", "elevation", "distance"):
        assert there[key] == pytest.approx(view[key], rel=1e-3)
    assert there["target"] == pytest.approx(view["target"], rel=1e-3, abs=1e-3)
    # Nonsense in a link is ignored with a notice, and the page is as the other tests expect it again.
    page.handle.goto(f"{address.partition('?')[0]}?t=1e99&view=1,2,3,4,5,x&background=constructor&decoder=toString")
    page.wait_ready()
    assert page.state["frameCount"] == 9
    notice = page.evaluate("() => document.querySelector('v3-player').shadowRoot.querySelector('.notice').textContent")
    assert all(part in notice for part in ("time", "view", "background", "decoder"))


def test_an_iframe_is_commanded_by_messages(stream: Path, open_page: OpenPage) -> None:
    page = open_page(
        html="""<!doctype html><v3-player hidden></v3-player>
        <iframe src="./?t=0" width="400" height="400"></iframe><script>
        window.told = [];
        addEventListener('message', ({data}) => { if (data.v3player === 1) told.push(data); });
        window.send = (command, value) => frames[0].postMessage({v3player: 1, command, value}, '*');
        </script>""",
        wait=False,
    )
    told = "window.told.some(m => m.event === argument)"
    page.wait(told, "ready")
    page.evaluate("() => send('seek', 0.24)")
    page.wait("window.told.some(m => m.event === 'time' && m.detail.frame === 6)")
    page.evaluate("() => send('setView', {azimuth: 90, elevation: 5, distance: 2, target: [0, 0, 0]})")
    page.wait("window.told.some(m => m.event === 'view' && m.detail.azimuth === 90)")
    page.evaluate("() => { send('setView', '20,8'); send('setLoop', false); send('setBackground', 'white'); }")
    page.wait("window.told.some(m => m.event === 'view' && m.detail.azimuth === 20 && m.detail.distance === 2)")
    page.evaluate("() => { send('setLoop', true); send('resetView'); send('play'); }")
    page.wait(told, "play")
    page.evaluate("() => { send('pause'); send('getState'); }")
    page.wait(told, "state")
    state = page.evaluate("() => told.find(m => m.event === 'state').detail")
    assert state["frameCount"] == 9
    assert state["playing"] is False
    page.evaluate("() => { told.length = 0; }")
    wrong = {"dance": 1, "constructor": 1, "seek": "1", "setSpeed": 9, "setBackground": "constructor", "setLoop": "no"}
    page.evaluate("wrong => Object.entries(wrong).forEach(([name, value]) => send(name, value))", wrong)
    page.evaluate("() => { send('setView', {target: [1, 2]}); send('setView', {azimuth: NaN}); send('getState'); }")
    page.wait(told, "state")
    after = page.evaluate("() => told.find(m => m.event === 'state').detail")
    errors = page.evaluate("() => told.filter(m => m.event === 'error').map(m => m.detail)")
    assert len(errors) == len(wrong) + 2
    assert all(name in error for name, error in zip([*wrong, "setView", "setView"], errors, strict=True))
    assert {**after, "view": None} == {**state, "view": None}  # the view is still being reset


def test_the_component_in_another_page_with_a_poster(site: Site, stream: Path, open_page: OpenPage) -> None:
    site.cut = {".mp4": 0}
    page = open_page(
        html="""<!doctype html><h1>Text</h1>
        <v3-player src="stream/" poster="poster.png" loop style="width: 300px; height: 300px"></v3-player>
        <script type="module" src="v3-player.js"></script>""",
        wait=False,
    )
    poster = page.handle.locator("v3-player .poster")
    page.wait("player?.shadowRoot?.querySelector('.poster img').complete")
    assert poster.is_visible()
    site.break_off.set()
    page.wait_ready()
    assert "gone" in poster.get_attribute("class")
    assert not page.state["playing"]
    page.evaluate("() => document.querySelector('v3-player').play()")
    page.wait("player.state.playing && (seen.time ?? []).length > 1")
    # When removed and inserted again, it starts over and leaves no second player behind.
    page.evaluate(
        """() => { const player = document.querySelector('v3-player');
          player.remove(); window.seen = {}; document.body.append(player); }"""
    )
    page.wait("player.state.ready")


@pytest.mark.parametrize("size", [(320, 480), (390, 844), (820, 1180), (1440, 900), (2880, 1620)])
def test_all_controls_are_on_the_screen(page: Page, size: tuple[int, int]) -> None:
    page.handle.set_viewport_size({"width": size[0], "height": size[1]})
    buttons = page.handle.locator("v3-player .bar button:visible")
    assert buttons.count() >= 4
    for number in range(buttons.count()):
        box = buttons.nth(number).bounding_box()
        assert 0 <= box["x"] <= size[0] - box["width"]
        assert box["y"] + box["height"] <= size[1]
        assert min(box["width"], box["height"]) >= 40
        assert buttons.nth(number).get_attribute("aria-label")
    page.click("settings")
    box = page.handle.locator("v3-player .settings").bounding_box()
    assert box["y"] >= 0
    assert 0 <= box["x"] <= size[0] - box["width"]
    page.handle.keyboard.press("Escape")
    page.call("notice", "The browser starts without sound. " + "x" * 60)
    title, notice = (page.handle.locator(f"v3-player {name}").bounding_box() for name in (".title", ".notice"))
    assert title["y"] + title["height"] <= notice["y"]
    assert 0 <= notice["x"] <= size[0] - notice["width"]


def test_the_picture_fades_where_nothing_was_filmed(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """The range of the stream: around the first view."""
    shutil.copytree(baked(), site.stream)
    covered = view_range([support.camera(0)], (0, 0, 0)).to_json()
    edit_manifest(site.stream, lambda values: values["metadata"].update(view_range=covered))
    opacity = "Number(getComputedStyle(player.shadowRoot.querySelector('.stage > canvas')).opacity)"
    page = open_page("?t=0", **CALM)
    page.wait(f"{opacity} === 1")
    page.call("setView", {"azimuth": 170})
    page.wait(f"{opacity} < 0.2")
    assert "Not filmed from here" in page.handle.locator("v3-player .notice").text_content()
    page.call("setView", {"azimuth": 20})
    page.wait(f"{opacity} === 1")


def test_a_device_reports_its_own_figures(stream: Path, open_page: OpenPage) -> None:
    hurry = "{ const wait = setInterval; window.setInterval = (run, ms) => wait(run, ms === 1000 ? 20 : ms); }"
    clipboard = ["clipboard-read", "clipboard-write"]
    page = open_page("?report", hurry, size=(390, 844), permissions=clipboard)
    report = page.handle.locator("v3-player .report")
    report.get_by_role("status").filter(has_text="Measured").wait_for()
    report.get_by_role("button", name="Copy").click()
    page.wait("player.shadowRoot.querySelector('.notice.shown')")
    lines = page.evaluate("() => navigator.clipboard.readText()").splitlines()
    text = dict(line.split(": ", 1) for line in lines)
    assert text["Seconds"] == "10 | 120"
    assert text["Browser"] == page.evaluate("() => navigator.userAgent")
    assert int(text["First image"].removesuffix(" ms")) > 0
    size = page.evaluate("() => document.querySelector('v3-player').engine.screen.renderer.maxTexture")
    assert text["Largest texture"].startswith(f"{size},")
    assert len(text["Decode"].split(" | ")) == len(text["Dropped"].split(" | ")) == 2
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
