"""One file, live streams, and better renditions after a slow beginning."""

import json
import os
import shutil

import pytest
import support
from driver import Baked, OpenPage, Site

from v3studio.studio.stream import StreamReader
from v3studio.studio.stream.write_archive import write_archive

pytestmark = pytest.mark.web


def test_one_file_by_address_and_dropped(site: Site, baked: Baked, open_page: OpenPage) -> None:
    file = site.folder / "clip.v3s"
    with StreamReader.open(baked(ladder=(16, 34), lengths=(5, 4, 3), paged=True)) as reader:
        write_archive(reader, file)
    page = open_page("?src=clip.v3s")
    page.wait("(seen.looped ?? []).length")
    assert {path for path, _ in site.requests if "manifest" in path or "files" in path} == set()
    assert all(wanted for path, wanted in site.requests if path == "/clip.v3s")
    page.evaluate(
        """async () => {
          const data = await (await fetch('clip.v3s')).arrayBuffer();
          const files = new DataTransfer();
          files.items.add(new File([data], 'dropped.v3s'));
          window.seen = {};
          const stage = document.querySelector('v3-player').shadowRoot.querySelector('.stage');
          stage.dispatchEvent(new DragEvent('drop', {dataTransfer: files, bubbles: true, cancelable: true}));
        }"""
    )
    page.wait("(seen.looped ?? []).length")
    assert page.evaluate("() => document.querySelector('v3-player').engine.info.frameCount") == 12
    assert not page.seen("notice")


def test_a_live_stream_is_followed(site: Site, baked: Baked, open_page: OpenPage) -> None:
    folder = support.live(baked(ladder=(16,), lengths=(5, 4, 3)), site.stream, 1)
    page = open_page()
    page.wait("player.state.frame === 4 && (seen.waiting ?? []).at(-1) === true")
    assert page.state["live"]
    support.live(folder, site.stream, 2)
    page.wait("player.state.frame === 8")
    assert not page.seen("looped")
    support.live(folder, site.stream, 3, live=False)
    page.wait("(seen.looped ?? []).length")
    frames = [entry["frame"] for entry in page.seen("time")]
    lap = frames[: next(i for i in range(1, len(frames)) if frames[i] < frames[i - 1])]
    assert {0, 4, 8} <= set(lap)  # a busy machine drops others: all three of the last group, too
    page.wait("seen.time.some(({frame}) => frame > 8)")  # in one of the loops
    assert not page.state["live"]
    assert not page.seen("notice")


def test_a_paused_page_gets_the_best_rendition(site: Site, baked: Baked, open_page: OpenPage) -> None:
    shutil.copytree(baked(ladder=(16, 34), lengths=(5, 4, 3), paged=True), site.stream)
    manifest = json.loads((site.stream / "manifest.json").read_bytes())
    videos = [rendition["video"]["path"] for rendition in manifest["groups"][0]["renditions"]]
    site.bytes_per_second = 60_000  # below the rate of the better rendition
    page = open_page("?t=0.04")
    first = [path for path, _ in site.requests].index
    page.wait("(seen.time ?? []).length >= 2")  # drawn again
    assert first(f"/stream/{videos[1]}") < [path for path, _ in site.requests].index(f"/stream/{videos[0]}")
    assert page.state["frame"] == 1


def replacing(site, new, served):
    """A page's route: as the bake does, another stream takes the place of the site's after so many of its files."""
    asked, replaced = [], []

    def answer(route):
        asked.append(route.request.url)
        if served and len(asked) > served and not replaced:  # a page without an image opens the new stream unasked
            route.request.frame.wait_for_function("() => (window.seen?.time ?? []).length > 0")
        if len(asked) > served and not replaced:
            replaced.append(True)
            old = set((site.stream / "files").iterdir())
            shutil.copytree(new / "files", site.stream / "files", dirs_exist_ok=True)
            shutil.copy2(new / "manifest.json", site.folder / "manifest.json")
            os.replace(site.folder / "manifest.json", site.stream / "manifest.json")
            for path in old - {site.stream / "files" / path.name for path in (new / "files").iterdir()}:
                path.unlink()
        route.continue_()

    return answer


def test_a_stream_that_is_baked_again_during_playback(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """One notice with a button, which shows the new version at the same time and view; no group is left out."""
    shutil.copytree(baked(lengths=(3,) * 8), site.stream)
    page = open_page(address="about:blank", wait=False)
    page.handle.route("**/stream/files/*", replacing(site, baked(lengths=(3,) * 8, qp=34), 4))
    page.handle.goto(f"http://127.0.0.1:{site.port}/?t=0")
    page.wait_ready()
    page.call("setView", {"azimuth": 40})
    page.call("setSpeed", 0.1)  # a busy machine drops no frames: else it may go past the groups that are there at once
    page.call("play")
    button = page.handle.get_by_role("button", name="Show the new version")
    button.wait_for()
    page.wait("player.state.frame === 5")  # the last one that is there
    # The worker is asked for a frame of each missing group, and then for one that is there.
    page.evaluate(
        """async () => {
          const {stream} = document.querySelector('v3-player').engine, axis = [0, 0, 1, 0];
          for (let frame = 6; frame < 24; frame += 3)
            await new Promise(done => {
              stream.on('picture', ({frame}) => { if (frame === 5) done(); });
              for (const one of [frame, 5]) stream.request({type: 'present', frame: one, axis, seek: false});
            }); }"""
    )
    assert page.seen("notice") == []
    assert len(page.seen("updated")) == 1
    assert page.evaluate("() => document.querySelector('v3-player').engine.stream.leftOut.size") == 0
    assert not page.handle.locator("v3-player .spinner").is_visible()
    page.call("setSpeed", 1)
    page.evaluate("() => { window.seen.time = []; window.seen.ready = []; }")
    button.click()
    page.wait("seen.ready.length")
    assert page.seen("time")[0]["frame"] == 5
    assert page.state["playing"]
    assert page.state["view"]["azimuth"] == 40
    assert not button.is_visible()
    page.wait("(seen.looped ?? []).length")
    assert page.seen("notice") == []


def test_a_new_bake_shows_to_a_loop_that_is_in_memory(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """It asks for nothing more, but looks when the viewer comes back, and in between."""
    shutil.copytree(baked(), site.stream)
    page = open_page()
    page.wait("(seen.looped ?? []).length > 1")
    shutil.copytree(baked(qp=34), site.stream, dirs_exist_ok=True)
    page.evaluate("() => { document.dispatchEvent(new Event('visibilitychange')); }")
    page.handle.get_by_role("button", name="Show the new version").click()
    page.wait("seen.opened.length === 2 && player.state.ready")
    assert len(page.seen("updated")) == 1
    assert page.seen("notice") == []
