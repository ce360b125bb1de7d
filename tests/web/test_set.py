"""The set behind the performer: one picture with the performer, sorted together, fetched after it, and switched off."""

import shutil

import pytest
import support
from driver import Baked, OpenPage, Site, psnr

from v3studio.studio.stream import StreamReader

pytestmark = pytest.mark.web


def test_performer_and_set_are_one_picture(site: Site, baked: Baked, open_page: OpenPage) -> None:
    shutil.copytree(baked(degree=1, behind=2500), site.stream)
    page = open_page("?t=0")
    page.wait("player.engine.behind?.count === 2500")
    with StreamReader.open(site.stream) as reader:
        behind = reader.set_splats()
    assert behind is not None
    for frame, azimuth in ((0, 20), (4, 200), (6, 110)):
        (performer,) = support.decoded(site.stream, frame)
        page.seek_frame(frame)
        view = support.camera(azimuth, distance=2.1)
        wanted, alone = (support.draw(splats, view) for splats in (performer.before(behind), performer))
        assert psnr(page.picture(support.camera_values(view)), wanted) >= 42
        page.call("setBackground", "black")
        assert psnr(page.picture(support.camera_values(view)), alone) >= 45
        page.call("setBackground", "set")
        assert psnr(alone, wanted) < 25  # the test can tell them apart


def test_the_set_comes_after_the_first_group(site: Site, baked: Baked, open_page: OpenPage) -> None:
    shutil.copytree(baked(degree=1, behind=2500), site.stream)
    page = open_page("?t=0&background=white")
    page.wait("player.engine.info.hasSet")
    with StreamReader.open(site.stream) as reader:
        own = [file.path for part in reader.manifest.set for file in part.files]
        first = [file.path for file in reader.index.files(0)]
    asked = lambda: [path.removeprefix("/stream/") for path, _ in site.requests]  # noqa: E731
    assert not set(own) & set(asked())  # it is not shown
    page.call("setBackground", "set")
    page.wait("player.engine.behind?.count === 2500")
    order = [path for path in asked() if path in {*own, *first}]
    assert order.index(own[0]) > max(order.index(path) for path in first if path in order)
    assert [path for path in order if path in own] == own
