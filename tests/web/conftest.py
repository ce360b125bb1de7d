"""A browser, the built player on a test server, and small streams to play."""

import hashlib
import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
import support
from driver import Baked, OpenPage, Page, Site
from PIL import Image

from tests.support.shared import made_once

ROOT = Path(__file__).parents[2]
PLAYER = ROOT / "v3studio" / "player"
CHROMIUM = "/usr/bin/chromium"
FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--host-resolver-rules=MAP player.test 127.0.0.1",  # a host name that, unlike localhost, does not count as secure
    "--ignore-certificate-errors",  # the server makes its own
    "--use-angle=swiftshader",
    "--disable-gpu-rasterization",  # without a GPU, text and buttons cost less
    "--enable-precise-memory-info",
    "--js-flags=--expose-gc",
]

WATCHDOG = 240
"""Seconds after which the browser of a test is killed, so that the test fails instead of waiting forever: pytest's own
timeout interrupts Playwright's event loop, which may not survive that."""


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "web: plays in a real browser; needs Chromium and the built player")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """If not even killing the browser helps, the whole process ends; pytest-xdist starts another."""
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.timeout(WATCHDOG + 120, method="thread"))


def _missing() -> str | None:
    """None if the tests can run, else a message that says what to install."""
    if not Path(CHROMIUM).exists():
        return f"Chromium is not installed ({CHROMIUM}); run `make system-tests`."
    if not (PLAYER / "v3-player.js").is_file():
        return f"The player is not built ({PLAYER.relative_to(ROOT)}); run `make web`."
    try:
        import playwright  # noqa: F401
    except ImportError:
        return "The package playwright is not installed; run `make setup`."
    return None


class _Chromium:
    """Headless Chromium, started again after it was killed."""

    def __init__(self, playwright: Any) -> None:
        self._playwright = playwright
        self._running: Any = None
        self._failure: str | None = None
        self._free: dict[str, list[Page]] = {}

    def get(self) -> Any:
        """Raises at once after a start that failed, since each further one would wait for its minutes, too."""
        if self._failure is not None:
            pytest.fail(f"Chromium did not start for an earlier test: {self._failure}")
        if self._running is None or not self._running.is_connected():
            try:
                self._running = self._playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
                self._free = {}
            except Exception as error:
                self._failure = str(error).splitlines()[0]
                raise
        return self._running

    @contextmanager
    def page(
        self, size: tuple[int, int], *scripts: str, reduced_motion: str = "no-preference", **options: Any
    ) -> Iterator[Page]:
        """An empty page. One test after another uses it, as a new one takes a second of CPU time; they are on different
        ports, so that they share neither storage nor caches. `scripts` run before those of what it shows."""
        browser = self.get()
        free = self._free.setdefault(repr(options), [])
        page = free.pop() if free else Page(browser.new_context(**options).new_page())
        page.handle.set_viewport_size({"width": size[0], "height": size[1]})
        page.handle.emulate_media(reduced_motion=reduced_motion)
        with ExitStack() as added:
            for script in scripts:
                added.enter_context(page.handle.add_init_script(script))
            yield page
        page.leave()
        free.append(page)

    def kill(self) -> None:
        """From any thread: what waits for the browser fails."""
        for process in psutil.Process().children(recursive=True):
            if "chrom" in process.name():
                with suppress(psutil.NoSuchProcess):
                    process.kill()

    def close(self) -> None:
        if self._running is not None and self._running.is_connected():
            self._running.close()


@pytest.fixture(scope="session")
def chromium() -> Iterator[_Chromium]:
    """Skips the test if Chromium is missing, but fails in CI, where it is required."""
    missing = _missing()
    if missing is not None:
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = _Chromium(playwright)
        yield running
        running.close()


@pytest.fixture
def browser(chromium: _Chromium) -> Iterator[Any]:
    """Chromium, for as long as one test may take."""
    watchdog = threading.Timer(WATCHDOG, chromium.kill)
    watchdog.daemon = True
    watchdog.start()
    yield chromium.get()
    watchdog.cancel()


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A web server for a folder that contains only the player and a poster."""
    folder = tmp_path / "site"
    shutil.copytree(PLAYER, folder)
    Image.new("RGB", (8, 8)).save(folder / "poster.png")
    with Site(folder) as server:
        yield server


@pytest.fixture
def open_page(chromium: _Chromium, browser: Any, site: Site) -> Iterator[OpenPage]:
    """`open_page(query, ...)`: the player's page on the stream in `site.stream`; `html`: a page of this text beside it,
    `address`: any other page."""
    pages: list[Page] = []
    with ExitStack() as opened:

        def make(
            query: str = "",
            *scripts: str,
            size: tuple[int, int] = (320, 240),
            wait: bool = True,
            html: str | None = None,
            address: str | None = None,
            **options: Any,
        ) -> Page:
            page = opened.enter_context(chromium.page(size, *scripts, **options))
            pages.append(page)
            if html is not None:
                (site.folder / "host.html").write_text(html)
            name = "" if html is None else "host.html"
            page.handle.goto(address or f"http://127.0.0.1:{site.port}/{name}{query}")
            if wait:
                page.wait_ready()
            return page

        yield make
        errors = [error for page in pages for error in page.errors]
    assert not errors, errors


@pytest.fixture(scope="session")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Baked:
    """`baked(...)`: a stream of the test figure, baked once per kind; copy it to change it."""

    def get(**options: Any) -> Path:
        kind = hashlib.sha256(repr(sorted(options.items())).encode()).hexdigest()[:12]
        make = lambda folder: support.bake(folder / "stream", **options)  # noqa: E731
        return made_once(tmp_path_factory, f"figure {kind}", make) / "stream"

    return get


@pytest.fixture
def stream(site: Site, baked: Baked) -> Path:
    """A stream of two groups (5 and 4 frames) at `stream/` of the site, which the test may change."""
    shutil.copytree(baked(), site.stream)
    return site.stream


SHARED_SIZE = (640, 500)

_RESET = """() => {
  const player = document.querySelector('v3-player');
  player.pause();
  player.setSpeed(1);
  player.setLoop(true);
  player.setBackground('stream');
  player.dispatchEvent(new KeyboardEvent('keydown', {key: 'Escape'}));
  player.resetView();
  player.engine.seekFrame(0);
  window.seen = {};
}"""


@pytest.fixture(scope="module")
def shared_page(
    request: pytest.FixtureRequest, chromium: _Chromium, baked: Baked, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Page]:
    """One page for all tests of a file that only need a stream; `page` resets it. The file may have `scripts()` to run
    before those of the page, and its `SIZE`."""
    size, scripts = _size(request), getattr(request.module, "scripts", list)()
    folder = tmp_path_factory.mktemp("shared") / "site"
    shutil.copytree(PLAYER, folder)
    shutil.copytree(baked(), folder / "stream")
    clipboard = ["clipboard-read", "clipboard-write"]
    with (
        Site(folder) as site,
        chromium.page(size, *scripts, reduced_motion="reduce", permissions=clipboard) as page,
    ):
        page.handle.goto(f"http://127.0.0.1:{site.port}/?t=0")
        page.wait_ready()
        yield page


def _size(request: pytest.FixtureRequest) -> tuple[int, int]:
    return getattr(request.module, "SIZE", SHARED_SIZE)


@pytest.fixture
def page(request: pytest.FixtureRequest, shared_page: Page, browser: Any) -> Iterator[Page]:
    """The file's page, paused at the first frame and the first view; motion is reduced."""
    width, height = _size(request)
    shared_page.handle.set_viewport_size({"width": width, "height": height})
    shared_page.evaluate(_RESET)
    shared_page.wait("player.state.frame === 0 && !player.state.playing && player.state.view.azimuth === 0")
    yield shared_page
    assert not shared_page.errors, shared_page.errors
