"""A small stream to open, and a real window on a private X server, driven by real mouse and keyboard events."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from studio.gaussians import SH_C0, Gaussians
from studio.stream import BakeSettings, bake_group, write_manifest

FPS = 12.0
GROUPS = ((0, 8), (8, 4))  # first frame, frames


def body(frame: int, splats: int = 600) -> Gaussians:
    """An upright ellipsoid shell that walks along x; its colour tells direction."""
    generator = torch.Generator().manual_seed(5)
    shell = torch.nn.functional.normalize(torch.randn(splats, 3, generator=generator), dim=1)
    means = shell * torch.tensor([0.3, 0.25, 0.8]) + torch.tensor([0.15 * math.sin(0.4 * frame), 0.0, 0.9])
    colour = 0.5 + 0.4 * shell
    return Gaussians.from_activated(
        means=means,
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(splats, 1),
        scales=torch.full((splats, 3), 0.045),
        opacities=torch.full((splats,), 0.95),
        sh=((colour - 0.5) / SH_C0)[:, None, :],
    )


@pytest.fixture(scope="session")
def stream_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A baked stream of 12 frames in two groups."""
    folder = tmp_path_factory.mktemp("gui") / "walking stream"
    settings = BakeSettings(qp=10, preset="ultrafast")
    groups = [
        bake_group([body(frame) for frame in range(first, first + count)], folder, index, first, settings)
        for index, (first, count) in enumerate(GROUPS)
    ]
    write_manifest(folder, groups, FPS, settings, {})
    return folder


@pytest.fixture(scope="session")
def display() -> Iterator[str]:
    """A private X server's display name, for example ":101"."""
    missing = [program for program in ("Xvfb", "xdotool", "import") if shutil.which(program) is None]
    if missing:
        pytest.skip(f"the window's test needs {', '.join(missing)}; `make test` installs them")
    read_end, write_end = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write_end), "-screen", "0", "1400x900x24", "-nolisten", "tcp"],
        pass_fds=[write_end],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write_end)
    try:
        with os.fdopen(read_end) as pipe:
            number = pipe.readline().strip()
        assert number, f"Xvfb ended with status {server.wait()}"
        yield f":{number}"
    finally:
        server.terminate()
        server.wait(10)


class RunningWindow:
    """`v3studio-gui` in a process of its own.

    Args:
        display: the X server.
        log: file for its state lines.
        arguments: of the command.
    """

    def __init__(self, display: str, log: Path, *arguments: str) -> None:
        self.log = log
        self.environment = {**os.environ, "DISPLAY": display, "OMP_NUM_THREADS": "2"}
        self.environment.pop("WAYLAND_DISPLAY", None)
        self.stderr = log.with_suffix(".stderr")
        with self.stderr.open("wb") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "gui.app", "--log-state", str(log), *arguments],
                env=self.environment,
                stdout=errors,
                stderr=errors,
            )

    def states(self) -> list[dict[str, Any]]:
        """All state lines so far."""
        text = self.log.read_text() if self.log.exists() else ""
        return [json.loads(line) for line in text.splitlines(keepends=True) if line.endswith("\n")]

    def wait_for(self, what: str, accept: Callable[[dict[str, Any]], bool], seconds: float = 60.0) -> dict[str, Any]:
        """The newest state, once it is accepted; fails with `what` after so many seconds."""
        end = time.monotonic() + seconds
        state: dict[str, Any] = {}
        while time.monotonic() < end:
            states = self.states()
            if states:
                state = states[-1]
                if accept(state):
                    return state
            if self.process.poll() is not None:
                break
            time.sleep(0.05)
        pytest.fail(
            f"no state with {what} (status {self.process.poll()}); last: {state}; {self.stderr.read_text()[-2000:]}"
        )

    def xdotool(self, *arguments: object) -> str:
        """Run xdotool on the window's display."""
        done = subprocess.run(
            ["xdotool", *map(str, arguments)], env=self.environment, capture_output=True, text=True, check=True
        )
        return done.stdout

    def point(self, widget: str, across: float = 0.5, down: float = 0.5) -> tuple[int, int]:
        """Screen pixels of a place on a widget, 0 to 1 each way."""
        left, top, width, height = self.states()[-1]["widgets"][widget]
        window = self.xdotool("search", "--name", "V3 Studio").split()[0]
        geometry = dict(
            line.split("=") for line in self.xdotool("getwindowgeometry", "--shell", window).splitlines() if "=" in line
        )
        return (
            int(geometry["X"]) + int(left + across * width),
            int(geometry["Y"]) + int(top + down * height),
        )

    def click(self, widget: str, across: float = 0.5, down: float = 0.5) -> None:
        """Press and release the left button; both must fall on different drawn frames, slow as they may be."""
        self.xdotool("mousemove", *self.point(widget, across, down))
        time.sleep(0.5)
        self.xdotool("mousedown", 1)
        time.sleep(0.6)
        self.xdotool("mouseup", 1)
        time.sleep(0.3)

    def drag(self, widget: str, start: tuple[float, float], end: tuple[float, float], button: int = 1) -> None:
        """Drag over a widget in steps."""
        self.xdotool("mousemove", *self.point(widget, *start))
        time.sleep(0.5)
        self.xdotool("mousedown", button)
        time.sleep(0.5)
        for step in range(1, 9):
            part = step / 8
            place = (start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1]))
            self.xdotool("mousemove", *self.point(widget, *place))
            time.sleep(0.05)
        time.sleep(0.4)
        self.xdotool("mouseup", button)

    def key(self, name: str) -> None:
        """Press a key."""
        self.xdotool("keydown", name)
        time.sleep(0.15)
        self.xdotool("keyup", name)
        time.sleep(0.1)

    def screenshot(self, path: Path) -> Path:
        """The whole screen as a PNG."""
        subprocess.run(["import", "-window", "root", str(path)], env=self.environment, check=True, timeout=60)
        return path

    def close(self, seconds: float = 20.0) -> int:
        """SIGTERM; returns the exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.process.wait(seconds)


@pytest.fixture
def open_window(display: str, tmp_path: Path) -> Iterator[Callable[..., RunningWindow]]:
    """`open_window("PATH", ...)` starts the window; it is ended after the test whatever happens."""
    windows: list[RunningWindow] = []

    def start(*arguments: str) -> RunningWindow:
        windows.append(RunningWindow(display, tmp_path / f"state{len(windows)}.jsonl", *arguments))
        return windows[-1]

    yield start
    for window in windows:
        if window.process.poll() is None:
            window.process.kill()
            window.process.wait()


@pytest.fixture(scope="session")
def artefacts() -> Path:
    """Folder for screenshots to look at; git ignores it."""
    folder = Path(__file__).parents[2] / "test-artefacts"
    folder.mkdir(exist_ok=True)
    return folder
