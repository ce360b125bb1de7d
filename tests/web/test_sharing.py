"""Pages of `v3studio serve` and `v3studio share` play in a browser, also from a plain web server and the disk."""

import functools
import http.server
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import support
from driver import Baked, OpenPage, Page, psnr

from tests.support.errors import refuses
from v3studio.pipelines.share.page import PageText, first_files, read_public_marks
from v3studio.pipelines.share.serving import serve
from v3studio.pipelines.share.sharing import share
from v3studio.pipelines.takes.authored.marks import Mark, MarkView, change_mark
from v3studio.pipelines.takes.take import Take

pytestmark = pytest.mark.web

TEXT = PageText('Walk <1> & "2"', "Jane Doe's studio", "CC BY 4.0 </script><!--")
SIZE = (640, 500)  # wide enough for all buttons


@contextmanager
def plain_server(folder: Path) -> Iterator[str]:
    """Python's own web server: no ranges, no CORS."""
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
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
    (gaussians,) = support.decoded(stream, 6)
    assert psnr(page.picture(support.camera_values(view)), support.draw(gaussians, view)) >= 45.0


def head(page: Page) -> tuple[str, str]:
    """Title and credits as they are shown."""
    heading = page.handle.locator("v3-player .head")
    return heading.locator(".title").inner_text(), heading.locator(".credits").inner_text()


def fetched_once(page: Page, manifest: str, stream: Path) -> None:
    """The page fetches the manifest before its worker starts, and the first group, and nobody fetches them again."""
    requests = page.requests
    first = first_files((stream / "manifest.json").read_bytes())
    assert len(first) == 2
    worker = next(number for number, request in enumerate(requests) if request.startswith("blob:"))
    for file in ("manifest.json", *first):
        address = manifest.replace("manifest.json", file)
        assert requests.count(address) == 1, requests
    assert requests.index(manifest) < worker
    # requests of the worker are listed, too
    assert any(request.endswith(".mp4") for request in requests[worker:]), requests


def test_the_served_page_plays(baked: Baked, open_page: OpenPage) -> None:
    with serve(baked()) as serving:
        page = open_page(address=serving.address, size=SIZE)
        plays_right(page, baked())
        assert head(page) == ("Test figure", "")
        fetched_once(page, f"{serving.address}manifest.json", baked())
        assert page.handle.title() == "Test figure"


def test_one_of_several_streams_plays_over_https(baked: Baked, open_page: OpenPage, tmp_path: Path) -> None:
    names = ("b plain", "a #1 50% ?&'\"<x>é影")
    for name in names:
        shutil.copytree(baked(), tmp_path / name)
    with serve(tmp_path, https=True) as serving:
        page = open_page(address=f"{serving.bases[0]}/", wait=False)
        links = page.handle.locator("a")
        assert links.all_inner_texts() == sorted(names)
        links.first.click()
        page.wait_ready()
        assert page.evaluate("() => document.querySelector('v3-player').engine.info.checksums")
        page.wait("player.state.playing && player.state.frame > 0")


def test_a_folder_plays_from_a_plain_server_below_a_path(baked: Baked, open_page: OpenPage, tmp_path: Path) -> None:
    """Nor does it play another stream under its title."""
    place = tmp_path / "some" / "where é"
    share(baked(), place, TEXT)
    shutil.copytree(baked(lengths=(2,)), tmp_path / "other")
    with plain_server(tmp_path) as address:
        page = open_page(address=f"{address}/some/where%20é/", size=SIZE)
        plays_right(page, baked())
        assert head(page) == (TEXT.title, f"{TEXT.credits} · {TEXT.license}")
        assert page.handle.title() == TEXT.title
        page.click("link")
        page.wait("location.search.includes('t=0.24&view=')")
        fetched_once(page, f"{address}/some/where%20%C3%A9/stream/manifest.json", baked())
        page.handle.goto(f"{address}/some/where%20é/?src={address}/other/manifest.json&t=0")
        page.wait_ready()
        assert page.state["frameCount"] == 9
        assert "video" in page.handle.locator("v3-player .notice").inner_text()
        assert all(request.startswith((f"{address}/some/where", "blob:", "data:")) for request in page.requests)


def test_a_folder_says_why_it_does_not_play_from_disk(baked: Baked, open_page: OpenPage, tmp_path: Path) -> None:
    share(baked(), tmp_path / "shared", TEXT)
    page = open_page(address=(tmp_path / "shared" / "index.html").as_uri(), wait=False)
    page.handle.get_by_role("alert").wait_for()
    text = page.handle.get_by_role("alert").inner_text()
    assert "web server" in text
    assert ".html" in text


def test_a_single_file_plays_from_the_disk(baked: Baked, open_page: OpenPage, tmp_path: Path) -> None:
    file = tmp_path / "take é.html"
    share(baked(), file, TEXT)
    page = open_page(address=file.as_uri(), size=SIZE)
    plays_right(page, baked())
    assert head(page) == (TEXT.title, f"{TEXT.credits} · {TEXT.license}")
    page.click("link")
    page.wait("player.shadowRoot.querySelector('.notice').textContent.match(/link|address/i)")
    page.handle.goto(f"{file.as_uri()}?t=0.2&view=30,10,2.5,0,0,0")
    page.wait_ready()
    assert page.state["frame"] == 5
    assert page.state["view"]["azimuth"] == pytest.approx(30)
    assert all(request.startswith((file.as_uri(), "blob:", "data:")) for request in page.requests), page.requests


def test_marks_are_published_as_notes_with_next(finished: Path, open_page: OpenPage, tmp_path: Path) -> None:
    take = Take.open(Path(shutil.copytree(finished, tmp_path / "project")) / "take")
    with refuses("share.no_marks", file=take.marks):
        read_public_marks(str(take.root))
    target = (0.1, 0.0, 0.2)
    for frame, note, eye in ((4, "Look <b>here</b>", (3, 0, 0)), (1, "The hand", (0, 0, -4)), (2, "", (1, 1, 1))):
        view = MarkView(eye=eye, target=target, fov=40, place=target)
        change_mark(take.marks, frame, Mark(frame=frame, note=note, author="Jane", view=view), None)
    change_mark(take.marks, 3, Mark(frame=3, note="without a view"), None)
    marks = read_public_marks(str(take.root))
    assert "Jane" not in marks
    share(take.root, tmp_path / "shared", PageText(marks=marks))
    with plain_server(tmp_path / "shared") as address:
        page = open_page("?t=0", address=f"{address}/?t=0", size=SIZE, reduced_motion="reduce")
        caption = page.handle.locator("v3-player .caption")
        caption.get_by_text("2 notes").wait_for()
        shown = []
        for note in ("The hand", "Look <b>here</b>", "The hand"):
            caption.get_by_role("button", name="Next").click()
            caption.get_by_text(note).wait_for()
            shown.append((page.state["frame"], page.state["view"]["distance"]))
        first, second = (1, (0.1**2 + 4.2**2) ** 0.5), (4, (2.9**2 + 0.2**2) ** 0.5)
        assert [frame for frame, _ in shown] == [1, 4, 1]
        assert [distance for _, distance in shown] == pytest.approx([first[1], second[1], first[1]], rel=1e-3)
        assert page.state["view"]["target"] == pytest.approx(target)
        assert page.handle.locator("v3-player .pins i").count() == 1
        page.seek_frame(0)
        caption.get_by_text("2 notes").wait_for()


def test_the_poster_needs_no_script(baked: Baked, open_page: OpenPage, tmp_path: Path) -> None:
    share(baked(), tmp_path / "shared", TEXT)
    with plain_server(tmp_path / "shared") as address:
        page = open_page(address="about:blank", wait=False)
        page.handle.route("**/*.js", lambda _route: None)  # they never arrive
        page.handle.goto(address, wait_until="commit")
        page.handle.wait_for_function("document.querySelector('v3-player > img')?.naturalWidth > 0")
        assert page.handle.locator("v3-player > img").is_visible()
        assert page.handle.locator("v3-player > h1").inner_text() == f"{TEXT.title} 0:01"
        assert page.handle.locator("video, canvas").count() == 0
        assert not [request for request in page.requests if request.endswith((".mp4", ".bin"))]
