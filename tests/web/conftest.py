"""A browser, the built player on a test server, and small streams to play."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import support
from driver import Page, Site

ROOT = Path(__file__).parents[2]
PLAYER = ROOT / "v3web" / "player"
CHROMIUM = "/usr/bin/chromium"
FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--host-resolver-rules=MAP player.test 127.0.0.1",  # a host name that, unlike localhost, does not count as secure
    # WebGPU in software, which the player uses only with `?renderer=webgpu`; its canvas needs Vulkan everywhere.
    "--enable-unsafe-webgpu",
    "--use-angle=swiftshader",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    "--enable-precise-memory-info",
    "--js-flags=--expose-gc",
]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "web: plays in a real browser; needs Chromium and the built player")


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


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Headless Chromium. Skips the test if it is missing, but fails in CI, where it is required."""
    missing = _missing()
    if missing is not None:
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A web server for a folder that contains only the player."""
    folder = tmp_path / "site"
    shutil.copytree(PLAYER, folder)
    with Site(folder) as server:
        yield server


@pytest.fixture
def open_page(browser: Any, site: Site) -> Iterator[Callable[..., Page]]:
    """`open_page(query, ...)`: the player's page on the stream in `site.stream`."""
    contexts: list[Any] = []
    pages: list[Page] = []

    def make(
        query: str = "",
        *,
        size: tuple[int, int] = (400, 500),
        wait: bool = True,
        setup: Callable[[Any], None] | None = None,
        host: str = "127.0.0.1",
        path: str = "/",
        **options: Any,
    ) -> Page:
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
        contexts.append(context)
        handle = context.new_page()
        if setup is not None:
            setup(handle)
        page = Page(handle)
        pages.append(page)
        handle.goto(f"http://{host}:{site.port}{path}{query}")
        if wait:
            page.wait_ready()
        return page

    yield make
    errors = [error for page in pages for error in page.errors]
    for context in contexts:
        context.close()
    assert not errors, errors


@pytest.fixture(scope="session")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """`baked(...)`: a stream of the test figure, baked once per kind; copy it to change it."""
    done: dict[tuple[tuple[str, Any], ...], Path] = {}

    def get(**options: Any) -> Path:
        key = tuple(sorted(options.items()))
        if key not in done:
            done[key] = support.bake(tmp_path_factory.mktemp("stream") / "stream", **options)
        return done[key]

    return get


@pytest.fixture
def stream(site: Site, baked: Callable[..., Path]) -> Path:
    """A stream of two groups (5 and 4 frames) at `stream/` of the site, which the test may change."""
    shutil.copytree(baked(), site.stream)
    return site.stream
