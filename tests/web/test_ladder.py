"""Renditions, pages of the index, checks of the decoder."""

import shutil

import pytest
import support
from driver import Baked, OpenPage, Site, psnr

from tests.support.streams import edit_manifest

pytestmark = pytest.mark.web


def test_a_stream_with_renditions_and_pages_plays(site: Site, baked: Baked, open_page: OpenPage) -> None:
    shutil.copytree(baked(ladder=(16, 34), lengths=(5, 4, 3), paged=True), site.stream)
    page = open_page()
    page.wait("(seen.looped ?? []).length >= 2")
    # A busy machine may drop all frames of the last group, which lasts 0.12 s, in each loop.
    page.seek_frame(10)
    frames = {entry["frame"] for entry in page.seen("time")}
    assert {10} <= frames <= set(range(12))
    (gaussians,), view = support.decoded(site.stream, 10), support.camera(40, size=(240, 300))
    page.wait("player.engine.group.id === 'qp16'")
    assert psnr(page.picture(support.camera_values(view)), support.draw(gaussians, view)) >= 45
    assert not page.seen("error")
    assert not page.seen("notice")


def test_on_an_insecure_page_a_better_rendition_comes(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """On a LAN address over plain HTTP there is neither WebCodecs nor crypto.subtle. The <video> element of a group is
    closed while it is read, as the group is fetched again in a better rendition."""
    shutil.copytree(baked(ladder=(16, 34), splats=300), site.stream)
    page = open_page(address=f"http://player.test:{site.port}/")
    page.wait("(seen.looped ?? []).length")
    assert not page.seen("notice")
    engine = "document.querySelector('v3-player').engine"
    state = page.evaluate(f"() => [isSecureContext, {engine}.stream.path, {engine}.info.checksums]")
    assert state == [False, "video", False]


def test_a_decoder_that_is_not_exact_is_not_used(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """Nor where playing begins after the picture that is checked."""

    def spoil(values):
        values["groups"][1]["renditions"][0]["video"]["checks"][0]["crc32"] ^= 1

    shutil.copytree(baked(ladder=(16,)), site.stream)
    edit_manifest(site.stream, spoil)
    page = open_page("?decoder=webcodecs&t=0")
    page.call("seek", 8 / 25)
    page.wait("(seen.notice ?? []).length && player.state.frame < 5")
    assert "decodes the video inexactly" in page.seen("notice")[0]
    page.call("play")
    page.wait("(seen.looped ?? []).length >= 1")
    assert {entry["frame"] for entry in page.seen("time")} <= set(range(5))
