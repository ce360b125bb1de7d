"""Playing, seeking and looping; failures of the network and the device."""

import itertools
import shutil
from pathlib import Path

import pytest
import support
from driver import Baked, OpenPage, Page, Site

from tests.support.streams import damage, edit_manifest, group_files

pytestmark = pytest.mark.web

SIZE = (320, 240)
DIFFERENT = "new Set(seen.time.map(({frame}) => frame)).size"
"""How many different frames were shown."""


def test_it_plays_automatically_and_loops_until_it_shall_stop(site: Site, stream: Path, open_page: OpenPage) -> None:
    """Loops fetch nothing again."""
    # Slow, so that a busy machine drops few frames.
    edit_manifest(stream, lambda values: values.update(fps=8.0))
    page = open_page()
    page.wait("(seen.looped ?? []).length >= 2")
    page.wait(f"{DIFFERENT} === 9")  # a busy machine needs more loops to show each
    frames = [entry["frame"] for entry in page.seen("time")]
    assert set(frames) == set(range(9))
    backwards = sum(b < a for a, b in itertools.pairwise(frames))
    assert abs(backwards - len(page.seen("looped"))) <= 1, "only forward, except for loops"
    page.evaluate("() => document.querySelector('v3-player').removeAttribute('loop')")
    page.wait("(seen.ended ?? []).length && !player.state.playing")
    assert page.state["frame"] == 8
    before = len(page.seen("time"))
    page.call("play")
    page.wait("seen.ended.length === 2 && !player.state.playing")
    assert min(entry["frame"] for entry in page.seen("time")[before:]) < 8, "from the beginning"
    paths = [path for path, _ in site.requests if path.endswith((".mp4", ".bin"))]
    assert len(paths) == 4 == len(set(paths))
    assert not page.seen("error")
    assert not page.seen("notice")


def test_seeking_shows_the_very_frame(page: Page) -> None:
    assert page.state["frame"] == 0
    assert not page.state["playing"]
    for seconds, frame in ((0.16, 4), (0.2, 5), (0.0, 0), (99.0, 8), (0.04, 1)):
        page.call("seek", seconds)
        page.wait("player.state.frame === argument", frame)
    # Of many seeks at once, the last counts.
    page.evaluate(
        """() => { const p = document.querySelector('v3-player');
          for (let k = 0; k < 200; k++) p.seek((k % 9) / 25); p.seek(7 / 25); }"""
    )
    page.wait("!player.ui.timeline.seeking && player.engine.requested === null")
    assert page.state["frame"] == 7


def test_damaged_groups_are_left_out(site: Site, baked: Baked, open_page: OpenPage) -> None:
    stream = shutil.copytree(baked(lengths=(3,) * 8), site.stream)
    files = [group_files(stream, 1)[0], group_files(stream, 3)[1], group_files(stream, 5)[1]]
    for file, how in zip(files, ("flipped", "truncated", "missing"), strict=True):
        damage(file, how)
    page = open_page()
    page.wait("(seen.looped ?? []).length >= 2")
    left_out = {frame for group in (1, 3, 5) for frame in range(3 * group, 3 * group + 3)}
    assert {entry["frame"] for entry in page.seen("time")} <= set(range(24)) - left_out
    notices = page.seen("notice")
    assert len(notices) == 3
    for file, group in zip(files, (1, 3, 5), strict=True):  # fetched in parallel, so in any order
        (notice,) = [notice_text for notice_text in notices if f"files/{file.name}" in notice_text]
        assert f"Frames {3 * group} to {3 * group + 2} are skipped." in notice
    # Seeking into one continues with what follows.
    page.call("pause")
    page.call("seek", 10 / 25)
    page.wait("player.state.frame === 12")


def test_a_cut_connection_is_resumed_where_it_broke(site: Site, stream: Path, open_page: OpenPage) -> None:
    """And a slow one plays from the first group on."""
    video = f"files/{group_files(stream, 0)[1].name}"
    site.cut = {video: group_files(stream, 0)[1].stat().st_size - 100}
    page = open_page("?t=0")  # the first image is in what has arrived
    site.bytes_per_second = sum(file.stat().st_size for file in group_files(stream, 1)) / 2
    site.break_off.set()
    page.call("play")
    page.wait("(seen.looped ?? []).length >= 1")
    ranges = [wanted for path, wanted in site.requests if path.endswith(video)]
    assert ranges[0] is None
    assert int(ranges[1].removeprefix("bytes=").removesuffix("-")) > 0
    assert any("trying again" in notice for notice in page.seen("notice"))
    assert not page.seen("error")


def test_a_pause_during_a_wait_ends_it(site: Site, stream: Path, open_page: OpenPage) -> None:
    video = f"files/{group_files(stream, 0)[1].name}"
    site.cut = {video: group_files(stream, 0)[1].stat().st_size - 100}
    page = open_page("?t=0")  # the first image, and no other
    page.call("play")
    page.wait("seen.waiting?.at(-1) === true && player.shadowRoot.querySelector('.veil.busy')")
    page.call("pause")
    site.break_off.set()
    page.wait("player.engine.ready !== null")
    assert page.seen("waiting")[-1] is False
    assert not page.handle.locator("v3-player .spinner").is_visible()


_LOSE = """() => new Promise(done => {
  const canvas = document.querySelector('v3-player').shadowRoot.querySelector('canvas');
  const lose = canvas.getContext('webgl2').getExtension('WEBGL_lose_context');
  canvas.addEventListener('webglcontextlost', () => setTimeout(() => lose.restoreContext(), 50));
  canvas.addEventListener('webglcontextrestored', () => done());
  lose.loseContext();
})"""


def test_the_context_is_lost_and_restored(page: Page) -> None:
    page.seek_frame(2)
    view = support.camera_values(support.camera(30, size=(200, 250)))
    before = page.picture(view)
    page.evaluate(_LOSE)
    page.seek_frame(3)
    page.seek_frame(2)
    assert (page.picture(view) == before).all()
    page.call("play")
    page.wait("(seen.looped ?? []).length >= 1")


def test_a_hidden_page_does_not_run_on(page: Page) -> None:
    page.call("play")
    page.wait("player.state.frame > 0")
    # What switching tabs does: no animation frames for an hour, and the event before and after.
    moved = page.evaluate(
        """() => {
          const {engine} = document.querySelector('v3-player'), before = engine.position;
          const change = () => document.dispatchEvent(new Event('visibilitychange'));
          change();
          engine.advance(performance.now() + 3.6e6);
          change();
          return engine.position - before; }"""
    )
    assert abs(moved) < 1
    page.wait("(seen.looped ?? []).length > argument", len(page.seen("looped")))
    assert not page.seen("error")


def test_twenty_loops_need_no_more_memory(page: Page) -> None:
    def used_after(loops: int) -> int:
        page.wait("(seen.looped ?? []).length >= argument", loops)
        page.evaluate("() => { window.seen = {}; }")  # what the test itself recorded
        # Some objects are freed only by the collection after the one that finds them.
        return page.evaluate(
            """async () => {
              for (let i = 0; i < 3; i++) { gc(); await new Promise(done => setTimeout(done, 30)); }
              return performance.memory.usedJSHeapSize; }"""
        )

    page.call("setSpeed", 4)
    page.call("play")
    before = used_after(10)  # measured in the same way after everything has been compiled and cached
    assert used_after(20) < before + 1_000_000
