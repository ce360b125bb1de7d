"""The player in other browsers than Chromium: Firefox and WebKitGTK, which their own remote protocols drive."""

import json
import os
import shutil
import socket
import subprocess
import time
import urllib.request
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import pytest
import support
from driver import PATIENCE, PREPARE, Baked, Page, Site, psnr

from tests.support.x_server import x_server

pytestmark = pytest.mark.web

SIZE = (240, 300)
# WebGL2 without a GPU. A decoder in a process of its own gives RGB, as if luma had a limited range: it is not exact.
PREFERENCES = {
    "webgl.force-enabled": True,
    "gfx.webrender.software": True,
    "media.rdd-process.enabled": False,
    "media.rdd-ffmpeg.enabled": False,
    "media.allow-audio-non-utility": True,
}
T = TypeVar("T")


def once_there(connect: Callable[[], T]) -> T:
    """The result of a call that fails until a program listens."""
    until = time.monotonic() + PATIENCE / 1000
    while True:
        try:
            return connect()
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)


class Driven(Page, ABC):
    """One page in a browser that WebDriver's commands drive."""

    def __init__(self) -> None:
        self.send("SetTimeouts", script=PATIENCE)

    @abstractmethod
    def send(self, command: str, **parameters: Any) -> Any: ...

    def evaluate(self, script: str, argument: Any = None) -> Any:
        call = f"const done = arguments[1]; Promise.resolve(({script})(arguments[0])).then(done, e => done(String(e)))"
        return self.send("ExecuteAsyncScript", script=call, args=[argument])

    def wait(self, condition: str, argument: Any = None) -> None:
        self.evaluate(
            f"""argument => new Promise(done => {{
              const look = () => {{
                const player = document.querySelector('v3-player'), seen = window.seen;
                if ({condition}) done(); else setTimeout(look, 50);
              }};
              look();
            }})""",
            argument,
        )


class Firefox(Driven):
    """Firefox, by Marionette."""

    def __init__(self, port: int) -> None:
        self._connection = once_there(lambda: socket.create_connection(("127.0.0.1", port), PATIENCE / 1000))
        self._stream = self._connection.makefile("rb")
        self._read()
        self.send("NewSession", capabilities={})
        super().__init__()

    @staticmethod
    def command(port: int, folder: Path) -> list[str]:
        lines = [f"user_pref({json.dumps(name)}, {json.dumps(value)});\n" for name, value in PREFERENCES.items()]
        (folder / "user.js").write_text("".join(lines) + f'user_pref("marionette.port", {port});\n')
        return ["firefox", "--marionette", "--no-remote", "--profile", str(folder)]

    def _read(self) -> Any:
        length = b""
        while not length.endswith(b":"):
            length += self._stream.read(1)
        return json.loads(self._stream.read(int(length[:-1])))

    def send(self, command: str, **parameters: Any) -> Any:
        text = json.dumps([0, 1, f"WebDriver:{command}", parameters]).encode()
        self._connection.sendall(b"%d:%s" % (len(text), text))
        _, _, error, result = self._read()
        assert error is None, error
        return result.get("value")


class WebKit(Driven):
    """WebKitGTK's MiniBrowser, by WebKitWebDriver."""

    PATHS: ClassVar = {
        "NewSession": "",
        "SetTimeouts": "timeouts",
        "Navigate": "url",
        "ExecuteAsyncScript": "execute/async",
    }

    def __init__(self, port: int) -> None:
        self._address = f"http://127.0.0.1:{port}/session"
        [browser] = Path("/usr/lib").glob("*/webkit2gtk-4.1/MiniBrowser")
        options = {"binary": str(browser), "args": ["--automation"]}
        wanted = {"alwaysMatch": {"webkitgtk:browserOptions": options}}
        session = once_there(lambda: self.send("NewSession", capabilities=wanted))
        self._address += f"/{session['sessionId']}"
        super().__init__()

    @staticmethod
    def command(port: int, folder: Path) -> list[str]:
        return ["WebKitWebDriver", f"--port={port}"]

    def send(self, command: str, **parameters: Any) -> Any:
        address = f"{self._address}/{self.PATHS[command]}".rstrip("/")
        request = urllib.request.Request(address, json.dumps(parameters).encode(), {"Content-Type": "application/json"})
        with urllib.request.urlopen(request, timeout=PATIENCE / 1000) as answer:
            return json.load(answer)["value"]


@pytest.fixture(scope="module", params=[Firefox, WebKit])
def other(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driven]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    folder = tmp_path_factory.mktemp("browser")
    command = request.param.command(port, folder)
    missing = [program for program in (command[0], "Xvfb") if shutil.which(program) is None]
    if request.param is WebKit and not list(Path("/usr/lib").glob("*/gstreamer-1.0/libgstlibav.so")):
        missing.append("gstreamer1.0-libav, which decodes H.264,")
    if missing:
        pytest.skip(f"{' and '.join(missing)} not installed")
    with x_server() as display:
        software = {"LIBGL_ALWAYS_SOFTWARE": "1", "WEBKIT_DISABLE_SANDBOX_THIS_IS_DANGEROUS": "1"}
        environment = {**os.environ, **software, "DISPLAY": display}
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
        try:
            yield request.param(port)
        finally:
            process.terminate()
            process.wait(60)


def opened(other: Driven, site: Site, stream: Path, query: str) -> None:
    shutil.copytree(stream, site.stream)
    other.send("Navigate", url=f"http://127.0.0.1:{site.port}/{query}")
    other.evaluate(PREPARE)
    failure = "player.shadowRoot.querySelector('.failure')"
    other.wait(f"(player.state.ready && player.ui) || !{failure}.hidden")
    why = other.evaluate(f"() => {{ const player = document.querySelector('v3-player'); return {failure}.innerText; }}")
    assert other.state["ready"], why


def test_it_draws_what_the_rasterizer_draws(other: Driven, site: Site, baked: Baked) -> None:
    opened(other, site, baked(degree=1), "?t=0")
    for frame in (0, 5, 6):  # of two groups
        other.seek_frame(frame)
        view = support.camera(72.0 * frame, size=SIZE)
        want = support.draw(support.decoded(site.stream, frame)[0], view)
        assert psnr(other.picture(support.camera_values(view)), want) > 45
    assert psnr(support.draw(support.decoded(site.stream, 5)[0], view), want) < 40


def test_it_plays_in_a_loop(other: Driven, site: Site, baked: Baked) -> None:
    opened(other, site, baked(), "")
    other.wait("player.state.playing && player.engine.statistics.shown > 12")
    other.call("pause")
    other.wait("!player.state.playing")
