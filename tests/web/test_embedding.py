"""`<v3-player>` in another page behaves like `<video>` there."""

import shutil

import pytest

pytestmark = pytest.mark.web

PAGE = """<!doctype html><meta name="viewport" content="width=device-width"><p>Text</p>
<v3-player src="stream/" {attributes} style="width: 100%; height: 300px"></v3-player>
<p style="height: 2000px">More text</p><script type="module" src="v3-player.js"></script>"""


def open_host(site, open_page, attributes, **options):
    (site.folder / "host.html").write_text(PAGE.format(attributes=attributes))
    return open_page(path="/host.html", **options)


def test_fingers_turn_sideways_and_scroll_the_page_up_and_down(site, baked, open_page):
    shutil.copytree(baked(ladder=(16,), splats=300, clicks=(0.12,)), site.stream)
    page = open_host(site, open_page, "controls muted autoplay loop", has_touch=True, is_mobile=True)
    page.wait("player.state.playing && (seen.looped ?? []).length && player.engine.sound.present")
    assert page.state["muted"] is True
    page.swipe(((200, 200), (-120, 0)))
    page.wait("player.state.view.azimuth < -10")
    assert page.evaluate("() => scrollY") == 0
    before = page.state["view"]
    page.swipe(((200, 200), (0, -120)))
    page.wait("scrollY > 50")
    assert page.state["view"]["elevation"] == pytest.approx(before["elevation"])


def test_without_controls_there_are_none(stream, site, open_page):
    page = open_host(site, open_page, "", reduced_motion="reduce")
    for part in (".bar", ".start", ".hint"):
        assert not page.handle.locator(f"v3-player {part}").is_visible()
    page.handle.locator("v3-player .stage").press("?")
    assert not page.handle.locator("v3-player .help").is_visible()
    page.evaluate("() => document.querySelector('v3-player').setAttribute('controls', '')")
    assert page.handle.locator("v3-player .bar").is_visible()
