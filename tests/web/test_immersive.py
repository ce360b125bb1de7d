"""VR and AR sessions, with an emulated headset (the npm package iwer)."""

import base64
import os
from pathlib import Path

import numpy as np
import pytest
import support
from driver import Baked, Page, psnr
from scipy.spatial.transform import Rotation

from v3studio.studio.cameras import Camera

pytestmark = pytest.mark.web

RUNTIME = Path(__file__).parents[2] / "web" / "node_modules" / "iwer" / "build" / "iwer.min.js"
EYES = 0.063  # meters between the emulated eyes; their vertical field of view is 90 degrees
TABLE = 0.7  # height of the emulated table, as in xr_runtime.js
PSNR = 45.0

_STILL = """([position, quaternion]) => {
  const immersive = document.querySelector('v3-player').ui.immersive;
  immersive.resolution.scale = () => 1;
  headset.position.set(...position);
  headset.quaternion.set(...quaternion);
}"""

# What is in the session's framebuffer once nothing has changed for two drawings: its width, height, and RGBA.
_READ = """() => new Promise(done => {
  const { ui: { immersive }, engine } = document.querySelector('v3-player');
  const { renderer } = immersive;
  const draw = renderer.drawViews;
  let key = '', same = 0;
  renderer.drawViews = (views, ...rest) => {
    draw.call(renderer, views, ...rest);
    const now = JSON.stringify([views, engine.sortedAxis]);
    same = now === key && !engine.sorting && !engine.requested ? same + 1 : 0;
    key = now;
    if (same < 2) return;
    renderer.drawViews = draw;
    const { gl } = renderer, { width, height } = gl.canvas;
    const pixels = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    done([width, height, text(pixels)]);
  };
})"""


SIZE = (500, 240)


def scripts():
    """The page is on a device with an emulated headset."""
    if not RUNTIME.is_file():
        message = "The emulated headset (iwer) is not installed; run `make web`."
        pytest.fail(message) if os.environ.get("CI") else pytest.skip(message)
    return [file.read_text() for file in (RUNTIME, Path(__file__).with_name("xr_runtime.js"))]


def start(page, kind):
    button = page.handle.locator(f"v3-player .bar [data-act='{kind}']")
    button.wait_for()
    button.click()
    page.wait("player.ui.immersive?.views.length === 2")


def pose(page, position, turn=(0.0, 0.0, 0.0)):
    """Put the head there (meters), turned by Euler angles y, x, z in degrees."""
    rotation = Rotation.from_euler("YXZ", turn, degrees=True)
    page.evaluate(_STILL, [list(position), rotation.as_quat().tolist()])
    return np.array(position), rotation.as_matrix()


def eyes(page, head, place, viewer, height):
    """The left and right eye as cameras in the figure's world.

    Args:
        head: position and rotation of the head in the room.
        place: the point of the room where the middle of the figure's floor stands.
        viewer: the point of the room that its front faces.
        height: meters from the floor to the top of its bounding box.
    """
    box = page.evaluate("() => document.querySelector('v3-player').engine.info.box")
    low, high = np.array(box["min"]), np.array(box["max"])
    scale = height / (high - low)[1]
    # The figure's world has y down, and its suggested camera looks along z.
    facing = np.arctan2(viewer[0] - place[0], viewer[2] - place[2])
    to_room = Rotation.from_euler("y", facing).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    floor = (low + high) / 2
    floor[1] = high[1]
    width, rows = page.handle.viewport_size["width"] // 2, page.handle.viewport_size["height"]
    cameras = []
    for side in (-1, 1):
        eye = head[0] + head[1] @ [side * EYES / 2, 0.0, 0.0]
        center = to_room.T @ (eye - place) / scale + floor
        matrix = np.eye(4)
        matrix[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ head[1].T @ to_room
        matrix[:3, 3] = -matrix[:3, :3] @ center
        focal = rows / 2  # 90 degrees
        K = np.array([[focal, 0, width / 2], [0, focal, rows / 2], [0, 0, 1.0]])
        cameras.append(Camera("eye", width, rows, K, matrix))
    return cameras


def halves(page):
    """(H, W, 4) bytes of the left and the right half of what the session shows, top row first."""
    width, height, text = page.evaluate(_READ)
    pixels = np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)[::-1]
    return pixels[:, : width // 2], pixels[:, width // 2 :]


def test_each_eye_sees_what_the_rasterizer_renders_in_vr(page: Page, baked: Baked) -> None:
    page.seek_frame(3)
    view = page.state["view"]
    start(page, "vr")
    # The emulated head stands at 1.6 m and looks along -z: the figure stands 2 m ahead, life-size (it is 1.4 m high).
    head = pose(page, (0.5, 1.3, -0.4), (20.0, -20.0, 5.0))
    (gaussians,) = support.decoded(baked(), 3)
    box = page.evaluate("() => document.querySelector('v3-player').engine.info.box")
    height = box["max"][1] - box["min"][1]
    drawn = [support.draw(gaussians, eye) for eye in eyes(page, head, (0.0, 0.0, -2.0), (0.0, 0.0, 0.0), height)]
    seen = [half[..., :3] for half in halves(page)]
    assert min(psnr(a, b) for a, b in zip(seen, drawn, strict=True)) >= PSNR
    assert psnr(seen[0], drawn[1]) < 35  # the eyes see different pictures
    page.evaluate("() => document.querySelector('v3-player').ui.immersive.end()")
    page.wait("player.ui.immersive === null && !player.engine.needsSetup")
    camera = support.camera(40, size=(240, 300))
    assert psnr(page.picture(support.camera_values(camera)), support.draw(gaussians, camera)) >= PSNR
    assert page.state["view"] == view


def test_a_tap_places_it_on_the_table_in_ar(page: Page, baked: Baked) -> None:
    start(page, "ar")
    head = pose(page, (0.0, 1.6, 0.0), (0.0, -45.0, 0.0))
    page.wait("player.ui.immersive.seen")
    place = (0.0, TABLE, TABLE - 1.6)
    page.wait("Math.abs(player.ui.immersive.placement.place[2] - argument) < 1e-4", place[2])
    page.evaluate("() => headset.controllers.right.updateButtonValue('trigger', 1)")
    page.wait("player.ui.immersive.selecting.size === 1")
    page.evaluate("() => headset.controllers.right.updateButtonValue('trigger', 0)")
    page.wait("player.ui.immersive.placed")
    # It stays where it is while the head moves.
    viewer, head = head[0], pose(page, (0.3, 1.4, -0.3), (25.0, -50.0, 0.0))
    (gaussians,) = support.decoded(baked(), 0)
    drawn = [support.draw(gaussians, eye) for eye in eyes(page, head, place, viewer, 0.5)]
    seen = halves(page)
    assert min(psnr(a[..., :3], b) for a, b in zip(seen, drawn, strict=True)) >= PSNR
    assert seen[0][0, 0, 3] == 0  # the room shows through

    # Two hands pull it to twice its size, and turn it by a quarter.
    page.evaluate(
        """() => { for (const [side, x] of [['left', -0.1], ['right', 0.1]]) {
          headset.controllers[side].position.set(x, 1.2, -0.5);
          headset.controllers[side].updateButtonValue('trigger', 1);
        } }"""
    )
    page.wait("player.ui.immersive.pinch !== null")
    before = page.evaluate("() => ({...document.querySelector('v3-player').ui.immersive.placement})")
    page.evaluate(
        """() => {
          headset.controllers.left.position.set(0, 1.2, -0.7);
          headset.controllers.right.position.set(0, 1.2, -0.3);
        }"""
    )
    page.wait("player.ui.immersive.placement.scale > 1.8 * argument", before["scale"])
    after = page.evaluate("() => ({...document.querySelector('v3-player').ui.immersive.placement})")
    # Grips are a few millimeters beside the controllers' positions. The hands turn clockwise, seen from above.
    assert after["scale"] == pytest.approx(2 * before["scale"], rel=0.1)
    assert np.sin(after["turn"] - before["turn"]) == pytest.approx(-1, abs=0.1)
    assert after["place"] == before["place"]
    # So do two fingers on a phone's screen, which then do not place it elsewhere.
    page.evaluate(
        """async () => {
          const player = document.querySelector('v3-player'), x = [100, 200];
          const touch = (kind, pointerId) =>
            player.dispatchEvent(new PointerEvent(kind, { pointerId, clientX: x[pointerId], clientY: 50 }));
          for (const side of ['left', 'right']) headset.controllers[side].updateButtonValue('trigger', 0);
          for (const pointer of [0, 1]) touch('pointerdown', pointer);
          await new Promise(done => player.ui.immersive.session.requestAnimationFrame(done));
          x[1] = 150;
          touch('pointermove', 1);
          await new Promise(done => player.ui.immersive.session.requestAnimationFrame(done));
          for (const pointer of [0, 1]) touch('pointerup', pointer);
        }"""
    )
    shrunk = page.evaluate("() => ({...document.querySelector('v3-player').ui.immersive.placement})")
    assert shrunk["scale"] == pytest.approx(after["scale"] / 2)
    assert shrunk["turn"] == pytest.approx(after["turn"])
    assert page.evaluate("() => document.querySelector('v3-player').ui.immersive.placed")
    page.evaluate("() => headset.controllers.right.updateButtonValue('a-button', 1)")
    page.wait("player.state.playing")
    page.evaluate("() => document.querySelector('v3-player').ui.immersive.end()")
    page.wait("player.ui.immersive === null && !player.engine.needsSetup")
