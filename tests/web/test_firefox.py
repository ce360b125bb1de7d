"""The player's page in Firefox, where it is installed (Debian's `firefox-esr`): skipped elsewhere.

Playwright has no driver for a distribution's Firefox, so that this one speaks Marionette, Firefox's own protocol.
"""

import base64
import json
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import support
from driver import PATIENCE, PICTURE, PREPARE, Baked, Site, psnr

pytestmark = pytest.mark.web

BINARY = shutil.which("firefox-esr") or shutil.which("firefox")
PREFERENCES = {
    "marionette.port": 0,
    "media.autoplay.default": 0,
    "webgl.force-enabled": True,  # also without a GPU
    "datareporting.policy.dataSubmissionEnabled": False,
    "app.update.disabledForTesting": True,
}


class Firefox:
    """A headless Firefox with one page."""

    def __init__(self, profile: Path) -> None:
        lines = [f"user_pref({json.dumps(name)}, {json.dumps(value)});" for name, value in PREFERENCES.items()]
        (profile / "user.js").write_text("\n".join(lines))
        command = [str(BINARY), "--headless", "--no-remote", "--marionette", "--profile", str(profile)]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        place = profile / "MarionetteActivePort"
        while not (place.is_file() and place.read_text().strip()):
            assert self._process.poll() is None, "Firefox does not start"
        self._socket = socket.create_connection(("127.0.0.1", int(place.read_text())), timeout=PATIENCE / 1000)
        self._numbers = count(1)
        self._read()
        self.send("WebDriver:NewSession", {})
        self.send("WebDriver:SetTimeouts", {"script": PATIENCE, "pageLoad": PATIENCE})

    def send(self, command: str, values: dict[str, Any]) -> Any:
        data = json.dumps([0, next(self._numbers), command, values]).encode()
        self._socket.sendall(b"%d:%b" % (len(data), data))
        _, _, error, result = self._read()
        assert error is None, error
        return result

    def _read(self) -> Any:
        length = b""
        while not length.endswith(b":"):
            length += self._socket.recv(1)
        data = b""
        while len(data) < int(length[:-1]):
            data += self._socket.recv(1 << 16)
        return json.loads(data)

    def evaluate(self, script: str, argument: Any = None) -> Any:
        """The result of a JavaScript function for the argument."""
        call = {"script": f"return ({script})(arguments[0]);", "args": [argument], "sandbox": None}
        return self.send("WebDriver:ExecuteScript", call)["value"]

    def wait(self, condition: str) -> None:
        """Wait until a JavaScript expression over `player` (the element) and `seen` is true."""
        self.evaluate(
            f"""() => new Promise(done => {{
              const look = () => {{
                const player = document.querySelector('v3-player'), seen = window.seen;
                if ({condition}) done(); else requestAnimationFrame(look);
              }};
              look();
            }})"""
        )

    def open(self, address: str) -> None:
        self.send("WebDriver:Navigate", {"url": address})
        self.evaluate(PREPARE)
        self.wait("(player?.state?.ready && player.ui) || player?.shadowRoot.querySelector('.failure:not([hidden])')")

    def close(self) -> None:
        with suppress(OSError, AssertionError):
            self.send("Marionette:Quit", {"flags": ["eForceQuit"]})
        self._process.wait(PATIENCE / 1000)
        self._socket.close()


@contextmanager
def _running(profile: Path) -> Iterator[Firefox]:
    browser = Firefox(profile)
    try:
        yield browser
    finally:
        browser.close()


@pytest.fixture(scope="module")
def firefox(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Firefox]:
    if BINARY is None:
        pytest.skip("Firefox is not installed")
    with _running(tmp_path_factory.mktemp("firefox")) as browser:
        yield browser


@pytest.mark.parametrize("decoder", ["webcodecs", "video"])
def test_frames_are_those_of_the_rasterizer(firefox: Firefox, site: Site, stream: Path, decoder: str) -> None:
    firefox.open(f"http://127.0.0.1:{site.port}/?t=0&decoder={decoder}")
    assert (
        firefox.evaluate("() => document.querySelector('v3-player').shadowRoot.querySelector('.why').textContent") == ""
    )
    assert firefox.evaluate("() => document.querySelector('v3-player').engine.stream.path") == decoder
    for frame in (0, 6):
        firefox.evaluate("frame => document.querySelector('v3-player').engine.seekFrame(frame)", frame)
        firefox.wait(f"player.state.frame === {frame}")
        view = support.camera(40, size=(240, 300))
        text = firefox.evaluate(PICTURE, [support.camera_values(view), [0, 0, 0]])
        picture = np.frombuffer(base64.b64decode(text), np.uint8).reshape(300, 240, 4)[::-1, :, :3]
        (gaussians,) = support.decoded(stream, frame)
        assert psnr(picture, support.draw(gaussians, view)) >= 45.0


def test_it_plays_seeks_and_pauses(firefox: Firefox, site: Site, stream: Path) -> None:
    firefox.open(f"http://127.0.0.1:{site.port}/")
    firefox.wait("(seen.looped ?? []).length")
    firefox.evaluate(
        "() => document.querySelector('v3-player').shadowRoot.querySelector('.bar [data-act=play]').click()"
    )
    firefox.wait("!player.state.playing")
    firefox.evaluate("() => document.querySelector('v3-player').seek(0.24)")
    firefox.wait("player.state.frame === 6")
    assert firefox.evaluate("() => window.seen.error ?? []") == []
    assert firefox.evaluate("() => window.seen.notice ?? []") == []


def test_a_single_file_plays_from_the_disk(firefox: Firefox, baked: Baked, tmp_path: Path) -> None:
    from v3studio.pipelines.share.sharing import share

    share(baked(), tmp_path / "take.html")
    firefox.open((tmp_path / "take.html").as_uri())
    firefox.wait("player.state.playing && player.state.frame > 2")
