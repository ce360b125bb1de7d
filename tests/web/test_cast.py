"""The page of a cast, against the rasterizer."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from driver import Baked, OpenPage, Site, psnr
from PIL import Image

from v3studio.pipelines.share.cast_frames import CastFrames
from v3studio.pipelines.share.cast_images import cast_image
from v3studio.pipelines.share.sharing import share
from v3studio.studio.cameras import Camera
from v3studio.studio.formats import ply
from v3studio.studio.gaussians import Gaussians

pytestmark = pytest.mark.web

SIZE = (240, 180)
DOCUMENT = {"format": "v3studio-cast", "version": 1, "title": "Two"}
VIEW = {"position": [0, 2, 4], "target": [0, 0.3, 0], "fov": 40}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """The document of a cast with two performers who reach through one another, and a ball among them."""
    center, turn, size = torch.zeros(1, 3), torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), -2.5)
    ply.write(
        tmp_path / "ball.ply",
        Gaussians(center, turn, size, torch.tensor([6.0]), torch.tensor([[[1.77, -1.77, -1.77]]])),
    )
    items = [
        {"stream": "stream", "position": [-0.2, 0, 0], "turn": [0, 30, 0]},
        {"stream": "stream", "position": [0.2, 0, 0.1], "scale": 0.8, "start": 1000},
        {"splats": "ball.ply", "position": [0, 0.6, 0.2], "scale": 1.5},
    ]
    ground = {"color": [0.8, 0.8, 0.8], "shadow": 0.9, "radius": 100}
    values = {**DOCUMENT, "background": [0, 0, 1], "camera": VIEW, "ground": ground, "items": items}
    (tmp_path / "cast.json").write_text(json.dumps(values))
    return tmp_path / "cast.json"


def test_a_cast_looks_as_the_rasterizer_draws_it(site: Site, baked: Baked, open_page: OpenPage, place: Path) -> None:
    (place.parent / "stream").symlink_to(baked(degree=1))
    share(place, site.folder / "together")
    page = open_page(address=f"http://127.0.0.1:{site.port}/together/index.html", size=SIZE, wait=False)
    frames = "cast.performers.map(({playback}) => playback.frame)"
    shown = "cast.performers.every(({playback}) => playback.statistics.shown > 0)"
    page.handle.wait_for_function(f"globalThis.cast?.performers.length === 3 && {frames}[0] > 2 && {shown}")
    assert page.evaluate(f"() => {frames}[1]") == 0  # it has not begun
    page.handle.get_by_role("button", name="Pause").click()
    page.handle.get_by_role("button", name="Play").wait_for()
    timeline = page.handle.get_by_role("slider", name="Time")
    timeline.press("Home")
    for _ in range(3):
        timeline.press("ArrowRight")
    page.handle.wait_for_function(f"{frames}[0] === 3 && cast.clock.frame === 3 && cast.screen.sharp")
    hide = """() => {
      const {shadowRoot} = document.querySelector("v3-cast");
      for (const part of shadowRoot.querySelectorAll(".bar, .top, .hint")) part.hidden = true;
    }"""
    page.evaluate(hide)
    got = np.asarray(Image.open(io.BytesIO(page.handle.screenshot())).convert("RGB"))
    cast = CastFrames(place)
    camera = Camera.look_at((0, 2, 4), (0, 0.3, 0), (0, 1, 0), width=SIZE[0], height=SIZE[1], field_of_view=40)
    want, before = ((255 * cast_image(cast, camera, frame) + 0.5).astype(np.uint8) for frame in (3, 0))
    cast.close()
    assert psnr(got, want) > 36
    assert psnr(got, before) < 30
    # A key turns the view, and a button turns it back.
    page.handle.locator(".stage").focus()
    page.handle.keyboard.press("ArrowLeft")
    page.handle.wait_for_function("cast.camera.azimuth !== 0")
    page.handle.keyboard.press("r")
    page.handle.wait_for_function("cast.camera.azimuth === 0")
    # Nothing is lost with the graphics context.
    page.evaluate(
        """async () => {
          const {gl} = cast.renderer;
          const lost = gl.getExtension("WEBGL_lose_context");
          const told = (name) => new Promise(done => gl.canvas.addEventListener(name, done, {once: true}));
          let event = told("webglcontextlost");
          lost.loseContext();
          await event;
          event = told("webglcontextrestored");
          setTimeout(() => lost.restoreContext());
          await event;
          cast.screen.dirty = true;
        }"""
    )
    page.handle.wait_for_function("cast.screen.sharp")
    again = np.asarray(Image.open(io.BytesIO(page.handle.screenshot())).convert("RGB"))
    assert psnr(again, want) > 36
    # On a phone, the field of view shows both to the sides.
    page.handle.set_viewport_size({"width": 120, "height": 260})
    reach = page.evaluate(
        """() => {
          const {fx, rotation: r, translation: t} = cast.camera.pinhole(120, 260);
          const ends = cast.performers.flatMap(({corners}) => corners).map((p) => {
            const [x, , z] = [0, 1, 2].map((k) => r[3 * k] * p[0] + r[3 * k + 1] * p[1] + r[3 * k + 2] * p[2] + t[k]);
            return Math.abs(fx * x / z) / 60;
          });
          return Math.max(...ends);
        }"""
    )
    assert 0.6 < reach <= 1
