"""The player's picture matches the rasterizer, and its values match the Python decoder."""

import base64
import shutil
from dataclasses import replace

import numpy as np
import pytest
import support
from driver import Baked, OpenPage, Site, psnr

pytestmark = pytest.mark.web

PSNR = 45.0


_TAP = """{
  // What the worker sends, before the player takes it.
  window.pictures = [];
  const descriptor = Object.getOwnPropertyDescriptor(Worker.prototype, 'onmessage');
  Object.defineProperty(Worker.prototype, 'onmessage', {
    set(handler) {
      descriptor.set.call(this, event => {
        const {type, value: picture} = event.data;
        if (type === 'picture')
          window.pictures.push({frame: picture.frame, luma: text(picture.luma.slice()), count: picture.count,
            order: text(new Uint8Array(picture.order.slice(0, picture.count).buffer))});
        handler(event);
      });
    },
  });
}"""


@pytest.mark.parametrize(
    ("decoder", "degree", "b_frames"), [("webcodecs", 3, 2), ("webcodecs-software", 0, 0), ("video", 0, 7)]
)
def test_every_luma_byte_and_what_cameras_see(
    site: Site, baked: Baked, open_page: OpenPage, decoder: str, degree: int, b_frames: int
) -> None:
    shutil.copytree(baked(degree=degree, b_frames=b_frames), site.stream)
    page = open_page(f"?decoder={decoder}&t=0", _TAP)
    frames = support.decoded(site.stream, *range(9))
    want = [picture for group in range(2) for picture in support.luma(site.stream, group)]
    seen, drawn = [], []
    for frame in range(9):
        page.seek_frame(frame)
        if frame % 2 == 0:
            number = frame // 2
            place = {"elevation": -20 + 14 * number, "distance": 1.2 + 0.4 * number}
            view = support.camera(72.0 * number, **place, size=(240, 300))
            background = [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.2, 0.5, 0.8)][number % 3]
            seen.append(page.picture(support.camera_values(view), background))
            drawn.append(support.draw(frames[frame], view, background))
    assert min(map(psnr, seen, drawn)) >= PSNR
    # the test can tell pictures apart: the previous frame differs
    assert psnr(support.draw(frames[7], view, background), drawn[-1]) < 40
    got = {entry["frame"]: entry for entry in page.evaluate("() => window.pictures")}
    assert sorted(got) == list(range(9))
    for frame, picture in enumerate(want):
        luma = np.frombuffer(base64.b64decode(got[frame]["luma"]), np.uint8)
        assert np.array_equal(luma, picture.reshape(-1)), f"frame {frame}"
    come_back_to_front(got[3]["order"], frames[3])


def come_back_to_front(order, gaussians):
    """All splats, sorted for the suggested camera, with which the player starts."""
    pixels = support.morton_pixels(48, len(gaussians))  # of 1500 splats in a tile of 48 x 48
    splat_of = {pixel: splat for splat, pixel in enumerate(pixels)}
    splats = [splat_of[int(pixel)] for pixel in np.frombuffer(base64.b64decode(order), np.uint32)]
    assert sorted(splats) == list(range(len(gaussians)))
    view = support.camera(0)
    depths = (gaussians.means.numpy() @ view.rotation.T + view.translation)[:, 2]
    steps = np.diff(depths[splats])
    assert steps.max() <= (depths.max() - depths.min()) / 65535 + 1e-5


def test_each_group_is_rendered_with_its_dilation(site: Site, baked: Baked, open_page: OpenPage) -> None:
    """In a small picture, where splats are about a pixel wide, it shows."""
    shutil.copytree(baked(dilations=(0.05, 0.9)), site.stream)
    page = open_page("?t=0")
    view = support.camera(70, distance=2.6, size=(64, 80))
    for frame, dilation in ((2, 0.05), (6, 0.9), (3, 0.05)):
        (gaussians,) = support.decoded(site.stream, frame)
        assert gaussians.dilation == dilation
        page.seek_frame(frame)
        picture = page.picture(support.camera_values(view))
        assert psnr(picture, support.draw(gaussians, view)) >= PSNR
        assert psnr(picture, support.draw(replace(gaussians, dilation=0.3), view)) < PSNR - 10  # it would be seen
