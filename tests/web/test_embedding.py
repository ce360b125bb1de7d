"""`<v3-player>` in another page behaves like `<video>` there."""

import shutil
from pathlib import Path

import pytest
from driver import Baked, OpenPage, Site

pytestmark = pytest.mark.web

PAGE = """<!doctype html><meta name="viewport" content="width=device-width"><p>Text</p>
<v3-player src="stream/" %s style="width: 100%%; height: 300px"></v3-player>
<p style="height: 2000px">More text</p><script type="module" src="v3-player.js"></script>"""


def test_fingers_turn_sideways_and_scroll_the_page_up_and_down(site: Site, baked: Baked, open_page: OpenPage) -> None:
    shutil.copytree(baked(ladder=(16,), splats=300, clicks=(0.12,)), site.stream)
    page = open_page(html=PAGE % "controls muted autoplay loop", has_touch=True, is_mobile=True)
    page.wait("player.state.playing && (seen.looped ?? []).length && player.engine.sound?.present")
    assert page.state["muted"] is True
    page.swipe(((200, 200), (-120, 0)))
    page.wait("player.state.view.azimuth < -10")
    assert page.evaluate("() => scrollY") == 0
    before = page.state["view"]
    page.swipe(((200, 200), (0, -120)))
    page.wait("scrollY > 50")
    assert page.state["view"]["elevation"] == pytest.approx(before["elevation"])


def test_without_controls_there_are_none(stream: Path, open_page: OpenPage) -> None:
    page = open_page(html=PAGE % "", reduced_motion="reduce")
    for part in (".bar", ".start", ".hint"):
        assert not page.handle.locator(f"v3-player {part}").is_visible()
    page.handle.locator("v3-player .stage").press("?")
    assert not page.handle.locator("v3-player .help").is_visible()
    page.evaluate("() => document.querySelector('v3-player').setAttribute('controls', '')")
    assert page.handle.locator("v3-player .bar").is_visible()


POLICY = "default-src 'none'; script-src 'self'; worker-src blob:; connect-src 'self'; img-src 'self'; media-src blob:"
STRICT = """<!doctype html><meta http-equiv="Content-Security-Policy" content="{policy}">
<v3-player src="stream/" poster="poster.png" controls></v3-player><script type="module" src="v3-player.js"></script>"""


def open_strict(site, baked, open_page, policy, *scripts):
    shutil.copytree(baked(clicks=(0.12,)), site.stream)
    return open_page("", *scripts, html=STRICT.format(policy=policy), wait=False)


def test_under_the_policy_of_the_guide(site: Site, baked: Baked, open_page: OpenPage) -> None:
    text = (Path(__file__).parents[2] / "docs" / "WEB.md").read_text(encoding="utf-8")
    assert f"Content-Security-Policy: {POLICY}\n" in text
    listen = (
        "addEventListener('securitypolicyviolation', event => (window.refused ??= []).push(event.violatedDirective))"
    )
    page = open_strict(site, baked, open_page, POLICY, listen)
    page.wait_ready()
    page.call("play")
    page.wait("(seen.looped ?? []).length || player.state.frame === 8")
    page.click("settings")
    color = page.handle.locator("v3-player .swatch.green").evaluate("one => getComputedStyle(one).backgroundColor")
    assert color == "rgb(0, 176, 64)"
    assert page.evaluate("() => window.refused ?? []") == []


@pytest.mark.parametrize("directive", ["worker-src blob:", "connect-src 'self'"])
def test_a_policy_that_forbids_it_is_named(site: Site, baked: Baked, open_page: OpenPage, directive: str) -> None:
    """Over the poster."""
    page = open_strict(site, baked, open_page, POLICY.replace(f"{directive}; ", ""))
    page.wait("(seen.error ?? []).length")
    assert directive.partition(" ")[0] in page.seen("error")[0]
    assert page.handle.locator("v3-player .failure").is_visible()
    assert page.handle.locator("v3-player .poster img").is_visible()


def test_without_webgl_it_says_so_and_tries_again(stream: Path, open_page: OpenPage) -> None:
    lose = """window.original = HTMLCanvasElement.prototype.getContext;
      HTMLCanvasElement.prototype.getContext = () => null;"""
    page = open_page("", lose, wait=False)
    page.wait("(seen.error ?? []).length")
    assert "WebGL" in page.seen("error")[0]
    page.evaluate("() => { HTMLCanvasElement.prototype.getContext = window.original; seen.error = []; }")
    page.handle.get_by_role("button", name="Try again").click()
    page.wait_ready()


def test_a_sandbox_is_named(stream: Path, open_page: OpenPage) -> None:
    page = open_page(html='<!doctype html><iframe sandbox="allow-scripts" src="./"></iframe>', wait=False)
    alert = page.handle.frame_locator("iframe").get_by_role("alert")
    alert.wait_for()
    assert "sandbox" in alert.inner_text()
