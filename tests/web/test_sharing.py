"""What `v3studio serve` and `v3studio share` give plays in a browser, also from a plain web server and the disk."""

from __future__ import annotations

import functools
import http.server
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import support
import uvicorn
from driver import Page, psnr

from pipelines.share.certificates import make_certificate
from pipelines.share.page import PageText, first_files
from pipelines.share.player_files import read_player
from pipelines.share.served import find_streams
from pipelines.share.server import listen
from pipelines.share.sharing import share
from pipelines.share.web_app import build_app

pytestmark = pytest.mark.web

TEXT = PageText('Walk <1> & "2"', "Jane Doe's studio", "CC BY 4.0 </script><!--")
SIZE = (640, 500)  # wide enough for all buttons


@pytest.fixture
def open_address(browser: Any) -> Iterator[Callable[..., Page]]:
    """`open_address(address, ...)`: any page with a player."""
    contexts, pages = [], []

    def go(address: str, requests: list[str] | None = None, wait: bool = True, **options: Any) -> Page:
        context = browser.new_context(viewport={"width": SIZE[0], "height": SIZE[1]}, **options)
        contexts.append(context)
        handle = context.new_page()
        if requests is not None:
            handle.on("request", lambda request: requests.append(request.url))
        page = Page(handle)
        pages.append(page)
        handle.goto(address)
        if wait:
            page.wait_ready()
        return page

    yield go
    errors = [error for page in pages for error in page.errors]
    for context in contexts:
        context.close()
    assert not errors, errors


@contextmanager
def serving(folder: Path, https: bool = False) -> Iterator[str]:
    """`v3studio serve` over a folder; its address."""
    with listen("127.0.0.1", 0) as sock:
        app = build_app(find_streams(str(folder)), read_player())
        config = uvicorn.Config(app, log_level="error", lifespan="off")
        if https:
            config.load()
            config.ssl = make_certificate(["127.0.0.1"]).context
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]})
        thread.start()
        try:
            yield f"http{'s' * https}://127.0.0.1:{sock.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join(10)


@contextmanager
def plain_server(folder: Path) -> Iterator[str]:
    """Python's own web server: no ranges, no CORS."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_arguments: Any) -> None:
            pass

    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()


def plays_right(page: Page, stream: Path) -> None:
    """It plays by itself, and a frame is the rasterizer's picture of what Python decodes."""
    page.wait("player.state.playing && new Set((seen.time ?? []).map(time => time.frame)).size > 2")
    page.seek_frame(6)
    view = support.camera(40, size=(240, 300))
    python = support.PythonFrames(stream)
    want = support.draw(python.gaussians(6), view)
    python.close()
    assert psnr(page.picture(support.camera_values(view)), want) >= 45.0


def head(page: Page) -> tuple[str, str]:
    """Title and credits as they are shown."""
    found = page.handle.locator("v3-player .head")
    return found.locator(".title").inner_text(), found.locator(".credits").inner_text()


def fetched_once(requests: list[str], manifest: str, stream: Path) -> None:
    """The page fetches the manifest and the first group before its worker starts, and nobody fetches them again."""
    first = first_files((stream / "manifest.json").read_bytes())
    assert len(first) == 2
    worker = next(number for number, request in enumerate(requests) if request.startswith("blob:"))
    for file in ("manifest.json", *first):
        address = manifest.replace("manifest.json", file)
        assert requests.count(address) == 1, requests
        assert requests.index(address) < worker
    # requests of the worker are listed, too
    assert any(request.endswith(".mp4") for request in requests[worker:]), requests


def test_the_served_page_plays(baked, open_address):
    with serving(baked()) as address:
        requests: list[str] = []
        page = open_address(address, requests)
        plays_right(page, baked())
        assert head(page) == ("Test figure", "")
        fetched_once(requests, f"{address}/manifest.json", baked())
        assert page.handle.title() == "Test figure"


def test_of_several_streams_one_is_chosen_and_plays_over_https(baked, open_address, tmp_path):
    names = ("b plain", "a #1 50% ?&'\"<x>é影")
    for name in names:
        shutil.copytree(baked(), tmp_path / name)
    with serving(tmp_path, https=True) as address:
        page = open_address(address, wait=False, ignore_https_errors=True)
        links = page.handle.locator("a")
        assert links.all_inner_texts() == sorted(names)
        links.first.click()
        page.wait_ready()
        assert page.evaluate("() => document.querySelector('v3-player').engine.info.checksums")
        page.wait("player.state.playing && player.state.frame > 0")


def test_a_shared_folder_plays_from_a_plain_server_below_a_path(baked, open_address, tmp_path):
    place = tmp_path / "some" / "where é"
    share(baked(), place, TEXT)
    requests: list[str] = []
    with plain_server(tmp_path) as address:
        page = open_address(f"{address}/some/where%20é/", requests)
        plays_right(page, baked())
        assert head(page) == (TEXT.title, f"{TEXT.credits} · {TEXT.license}")
        assert page.handle.title() == TEXT.title
        page.click("link")
        page.wait("location.search.includes('view=')")
        again = open_address(page.evaluate("() => location.href"))
        assert again.state["frame"] == 6
        assert not again.state["playing"]
    assert all(request.startswith((f"{address}/some/where", "blob:", "data:")) for request in requests), requests
    fetched_once(requests, f"{address}/some/where%20%C3%A9/stream/manifest.json", baked())


def test_a_single_file_plays_from_the_disk(baked, open_address, tmp_path):
    file = tmp_path / "take é.html"
    share(baked(), file, TEXT, single_file=True)
    requests: list[str] = []
    page = open_address(file.as_uri(), requests)
    plays_right(page, baked())
    assert head(page) == (TEXT.title, f"{TEXT.credits} · {TEXT.license}")
    page.click("link")
    page.wait(
        "document.querySelector('v3-player').shadowRoot.querySelector('.notice').textContent.match(/link|address/i)"
    )
    again = open_address(f"{file.as_uri()}?t=0.2&view=30,10,2.5,0,0,0")
    assert again.state["frame"] == 5
    assert again.state["view"]["azimuth"] == pytest.approx(30)
    assert all(request.startswith((file.as_uri(), "blob:", "data:")) for request in requests), requests
