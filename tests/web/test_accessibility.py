"""The page can be read, touched, and operated with keys alone: contrast, sizes, focus, and what screen readers find."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from driver import OpenPage, Page, Site
from PIL import Image

pytestmark = pytest.mark.web

SMALL = """() => {
  const root = document.querySelector('v3-player').shadowRoot;
  const all = root.querySelectorAll('button, input, [role=slider]');
  return [...all].filter(one => one.checkVisibility({visibilityProperty: true})).flatMap(one => {
    const {width, height} = one.getBoundingClientRect();
    const name = one.className || one.dataset.act || one.role;
    return Math.min(width, height) < 44 ? [`${name}: ${width} x ${height}`] : [];
  });
}"""


def luminance(pixels: np.ndarray) -> np.ndarray:
    """Relative luminance of sRGB bytes (WCAG 2.2)."""
    values = pixels / 255
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return linear @ np.array([0.2126, 0.7152, 0.0722])


def have_contrast(page, *parts: str) -> None:
    """The text of these parts, with the most frequent luminance around it."""
    image = luminance(np.asarray(Image.open(io.BytesIO(page.handle.screenshot())).convert("RGB"), float))
    for part in parts:
        box = page.handle.locator(f"v3-player {part}").bounding_box()
        x, y, width, height = (round(box[name]) for name in ("x", "y", "width", "height"))
        pixels = image[y : y + height, x : x + width].reshape(-1)
        counts, edges = np.histogram(pixels, 64, (0, 1))
        ground = float(np.median(pixels[np.digitize(pixels, edges[1:-1]) == counts.argmax()]))
        ratios = (ground + 0.05) / (pixels.min() + 0.05), (pixels.max() + 0.05) / (ground + 0.05)
        assert max(ratios) >= 4.5, part


@pytest.mark.parametrize("background", ["black", "gray", "white", "green"])
def test_text_has_contrast_on_every_background(page: Page, background: str) -> None:
    page.handle.set_viewport_size({"width": 390, "height": 844})
    page.evaluate(
        """() => {
          const root = document.querySelector('v3-player').shadowRoot;
          root.querySelector('.credits').textContent = 'Jane Doe Studio · CC BY 4.0';
          root.querySelector('.hint small').textContent = 'pinch to zoom';
          root.querySelector('.notice').textContent = 'Not filmed from here.';  // a real one disappears
          for (const part of ['.hint', '.notice']) root.querySelector(part).classList.add('shown');
        }"""
    )
    page.call("setBackground", background)
    page.handle.wait_for_timeout(500)  # transitions; motion is reduced, but not the next image
    have_contrast(page, ".title", ".credits", ".now", ".hint small", ".notice")
    page.click("settings")
    have_contrast(page, ".settings h2", ".settings h3 >> nth=0", ".settings [value='true'] + span")


@pytest.fixture(params=["light", "dark"])
def high_contrast(request: pytest.FixtureRequest, page: Page) -> Iterator[Page]:
    """The page in the system's high contrast: forced colors, of a light and a dark theme."""
    page.handle.emulate_media(forced_colors="active", color_scheme=request.param)
    yield page
    page.handle.emulate_media(forced_colors="none", color_scheme="light")


def test_controls_are_visible_in_high_contrast(high_contrast: Page) -> None:
    page = high_contrast
    page.call("seek", 0.3)
    page.handle.mouse.move(320, 60)
    page.handle.wait_for_timeout(500)  # transitions
    shown = page.handle.locator("v3-player .bar button:visible")
    buttons = shown.evaluate_all("all => all.map(button => button.dataset.act)")
    assert {"play", "settings"} <= set(buttons)
    have_contrast(page, *(f".bar [data-act='{act}']" for act in buttons), ".track", ".now")
    page.click("settings")
    have_contrast(page, ".settings .close", ".settings h2")
    grounds = """() => {
      const root = document.querySelector('v3-player').shadowRoot;
      const choices = ['[value="1"] + span', '[value="2"] + span', '.swatch.white', '.swatch.green'];
      return choices.map(choice => getComputedStyle(root.querySelector(choice)).backgroundColor);
    }"""
    assert len(set(page.evaluate(grounds))) == 4, "what is chosen looks different, and colors are those to choose from"


@pytest.mark.parametrize("size", [(390, 844), (740, 360)])
def test_everything_to_touch_has_44_pixels(page: Page, size: tuple[int, int]) -> None:
    page.handle.set_viewport_size({"width": size[0], "height": size[1]})
    assert page.evaluate(SMALL) == []
    page.click("settings")
    assert page.evaluate(SMALL) == []
    reached = """all => all.filter(one => one.checkVisibility()).flatMap(one => {
      one.scrollIntoView();
      const {left, top, width, height} = one.getBoundingClientRect();
      const {shadowRoot} = document.querySelector('v3-player');
      const there = shadowRoot.elementFromPoint(left + width / 2, top + height / 2);
      return one.contains(there) ? [] : [one.textContent || one.className];
    })"""
    assert page.handle.locator("v3-player .settings :is(button, input)").evaluate_all(reached) == []
    page.handle.keyboard.press("Escape")
    for key in ("?", "i"):
        page.handle.locator("v3-player .stage").press(key)
        assert page.evaluate(SMALL) == []
        page.handle.keyboard.press("Escape")


def test_radio_buttons_respond_to_arrow_keys(page: Page) -> None:
    page.click("settings")
    chosen = page.handle.locator("v3-player [name=speed]:checked")
    chosen.focus()
    page.handle.keyboard.press("ArrowRight")
    assert page.state["speed"] == 1.5
    assert chosen.input_value() == "1.5"
    page.handle.keyboard.press("ArrowRight")
    page.handle.keyboard.press("ArrowRight")
    assert page.state["speed"] == 0.25, "around the end"
    page.handle.keyboard.press("Tab")
    focused = "() => document.querySelector('v3-player').shadowRoot.activeElement.value"
    assert page.evaluate(focused) == "true", "one stop for each group"


def test_the_focus_passes_through(page: Page) -> None:
    """From the element before the player to the one after it, with Tab alone, also while a sheet is open."""
    page.evaluate(
        """() => {
          for (const [where, id] of [['beforebegin', 'before'], ['afterend', 'after']])
            document.querySelector('v3-player').insertAdjacentHTML(where, `<button id="${id}">x</button>`);
        }"""
    )
    for key in ("Escape", "?"):
        page.handle.locator("v3-player .stage").press(key)
        page.handle.locator("#before").focus()
        seen = []
        while "after" not in seen and len(seen) < 60:
            page.handle.keyboard.press("Tab")
            seen.append(page.evaluate("() => document.activeElement.id"))
        assert seen[-1] == "after"
    page.evaluate("() => { for (const id of ['before', 'after']) document.getElementById(id).remove(); }")


WORDS = """() => {
  const root = document.querySelector('v3-player').shadowRoot;
  const all = [...root.querySelectorAll('*')].filter(one => one.closest('.head, .time, kbd, td, style') === null);
  const named = all.flatMap(one => ['aria-label', 'title'].map(name => one.getAttribute(name)));
  const texts = all.flatMap(one => [...one.childNodes].filter(node => node.nodeType === 3).map(node => node.data));
  return [...named, ...texts].map(text => text?.trim()).filter(text => /[a-z]{2}/i.test(text ?? ''));
}"""


@pytest.mark.parametrize(("browser_language", "attribute"), [("ja-JP", None), ("en-US", "ja"), ("fr-FR", "ja-JP")])
def test_all_words_are_in_the_language_of_the_author_or_the_browser(
    site: Site, stream: Path, open_page: OpenPage, browser_language: str, attribute: str | None
) -> None:
    if attribute is not None:
        index = site.folder / "index.html"
        index.write_text(index.read_text().replace("<v3-player ", f'<v3-player lang="{attribute}" '))
    page = open_page("?t=0.3", locale=browser_language, reduced_motion="reduce")
    page.handle.locator("v3-player .stage").press("i")
    page.wait("player.shadowRoot.querySelector('.info th')")
    latin = [text for text in page.evaluate(WORDS) if text.isascii() and text not in ("VR", "AR")]
    assert latin == []
    assert page.handle.locator("v3-player .bar").get_attribute("lang") == "ja"


def test_a_language_that_the_player_lacks_is_english(stream: Path, open_page: OpenPage) -> None:
    page = open_page("?t=0.3", locale="fr-FR", reduced_motion="reduce")
    assert page.handle.locator("v3-player [data-act='settings']").get_attribute("title") == "Settings"
