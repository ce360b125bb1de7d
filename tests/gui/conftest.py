"""A small stream to open, and a real window on a private X server, driven by real mouse and keyboard events."""

import contextlib
import itertools
import json
import math
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
import torch
from PIL import Image, ImageGrab

from tests.support.shared import made_once
from tests.support.tiny_capture import write_project
from tests.support.waiting import POLL, HandClock, wait_until
from tests.support.warm_python import warm_python
from tests.support.x_server import x_server
from v3studio.gui.actions.commands import MENUS
from v3studio.gui.actions.menus import places
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.sources import load
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.models.worker import close_all
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.raycast import RaycastMesh
from v3studio.pipelines.config import load_config
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.take import Take
from v3studio.studio.gaussians import SH_C0, Gaussians
from v3studio.studio.stream import BakeSettings, bake_group, write_manifest

ARTIFACTS = Path(__file__).parents[2] / "test-artifacts"
"""Screenshots of tests that failed; ignored by git."""

FPS = 12.0
GROUPS = ((0, 8), (8, 4))  # first frame, frames
SIZE = "1024x800"
"""Size of the window, as small as all dialogs allow: a software renderer takes time for each pixel."""

EM = 16
"""Font size of the window on the private X server, pixels."""

CLICK = ("mousedown", 1, "mouseup", 1)
"""Arguments of xdotool."""

STILL = 25
"""Ticks without a change after which a widget counts as still. Panels show a change only when they are next drawn,
up to `gui.window.LONGER_PAUSE` later; a tick takes at least 9.5 ms."""


def body(frame: int, splats: int = 600) -> Gaussians:
    """An upright ellipsoid shell that moves along x; its color shows the direction."""
    generator = torch.Generator().manual_seed(5)
    shell = torch.nn.functional.normalize(torch.randn(splats, 3, generator=generator), dim=1)
    means = shell * torch.tensor([0.3, 0.25, 0.8]) + torch.tensor([0.15 * math.sin(0.4 * frame), 0.0, 0.9])
    color = 0.5 + 0.4 * shell
    return Gaussians.from_activated(
        means=means,
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(splats, 1),
        scales=torch.full((splats, 3), 0.045),
        opacities=torch.full((splats,), 0.95),
        sh=((color - 0.5) / SH_C0)[:, None, :],
    )


def write_stream(folder: Path, made: Callable[[int], Gaussians] = body) -> None:
    """Bake a stream of 12 frames in two groups, whose splats `made` returns."""
    settings = BakeSettings(quality=10, preset="ultrafast")
    groups = [
        bake_group([made(frame) for frame in range(first, first + count)], folder, index, first, settings)
        for index, (first, count) in enumerate(GROUPS)
    ]
    write_manifest(folder, groups, FPS, settings, {})


@pytest.fixture(scope="session")
def stream_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what `write_stream` writes."""
    return made_once(tmp_path_factory, "walking stream", write_stream)


@pytest.fixture(scope="session")
def footage_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `capture/` and `ball.yaml`. Read-only."""
    return made_once(tmp_path_factory, "footage", write_project)


@pytest.fixture
def take_copy(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished take, which is read-only."""
    return Path(shutil.copytree(finished / "take", tmp_path / "take"))


@pytest.fixture(autouse=True)
def threads_end() -> Iterator[None]:
    """Fails if threads do not end in time, as with the window."""
    yield
    assert close_all()


@pytest.fixture
def workspace() -> Iterator[Workspace]:
    """A workspace without a take."""
    workspace = Workspace()
    yield workspace
    if workspace.job is not None:
        workspace.job.cancel()


@pytest.fixture
def views(workspace: Workspace) -> Iterator[StageViews]:
    """The stage views of that workspace."""
    views = StageViews(workspace, PlayerPresenter(read_mesh=RaycastMesh))
    yield views
    assert views.player.close()


@pytest.fixture
def clock() -> HandClock:
    """A clock for what is shown for a while."""
    return HandClock()


@pytest.fixture
def player(finished: Path) -> Iterator[PlayerPresenter]:
    """A small player of the finished take, with its footage."""
    player, take = PlayerPresenter(), Take.open(finished / "take")
    player.adopt(*load(take.root))
    player.context = Inputs(take, load_config(take.config))
    player.resize(256, 192)
    yield player
    assert player.close()


@pytest.fixture(scope="session")
def display() -> Iterator[str]:
    """A private X server's display name, for example ":101"."""
    missing = [program for program in ("Xvfb", "xdotool") if shutil.which(program) is None]
    if missing:
        pytest.skip(f"the window's test needs {', '.join(missing)}; `make test` installs them")
    with x_server() as name:
        yield name


State = dict[str, Any]
Place = tuple[float, float]
Until = tuple[str, Callable[[State], bool]]
"""A state to wait for after an action, as `RunningWindow.wait_for` takes it."""


def ready(state: State) -> bool:
    """Whether an opened take or stream is shown."""
    return bool(not state["start"] and not state["opening"] and state["settled"] and state["shown"] is not None)


class RunningWindow:
    """`v3studio-gui` in a separate process. Mouse and keys return the awaited state if `until` is given.

    Args:
        display: the X server.
        log: file for its state lines.
        arguments: arguments of the command.
        program: arguments of Python that start the program.
        plays: whether playback starts when a take is opened. It takes both processors for as long as it goes on.
    """

    def __init__(
        self,
        display: str,
        log: Path,
        *arguments: str,
        program: tuple[str, ...] = ("-m", "v3studio.gui.app"),
        plays: bool = False,
    ) -> None:
        self.log = log
        self._read = 0
        self._states: list[State] = []
        self._entered = False
        self._corner: list[int] = []  # of its content on the screen
        self.environment = {
            **os.environ, "DISPLAY": display, "OMP_NUM_THREADS": "2", "LP_NUM_THREADS": "1",
            "XDG_CONFIG_HOME": str(log.parent / "config"), "XDG_STATE_HOME": str(log.parent / "state"),
        }  # fmt: skip
        self.environment.pop("WAYLAND_DISPLAY", None)
        settings = log.parent / "config" / "v3studio" / "window.json"
        settings.parent.mkdir(parents=True, exist_ok=True)
        chosen = json.loads(settings.read_text()) if settings.exists() else {}
        settings.write_text(json.dumps({**chosen, "play_on_opening": plays}))
        self.stderr = log.with_suffix(".stderr")
        with self.stderr.open("wb") as errors:
            command = (*program, "--log-state", log, "--size", SIZE, *arguments)  # the last size counts
            self.process = warm_python().popen(command, env=self.environment, output=errors)

    def states(self) -> list[State]:
        """All state lines so far."""
        if self.log.exists():
            with self.log.open("rb") as file:
                file.seek(self._read)
                data = file.read()
            whole = data[: data.rfind(b"\n") + 1]  # the last line may be incomplete
            self._read += len(whole)
            self._states += [json.loads(line) for line in whole.splitlines()]
        return self._states

    def wait_for(self, what: str, accept: Callable[[State], bool], seconds: float = 120.0) -> State:
        """Wait for a state that is accepted and return it; fail with `what` after a number of seconds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            states = self.states()
            if states and accept(states[-1]):
                return states[-1]
            if self.process.poll() is not None:
                break
            time.sleep(POLL)
        self._fail(f"no state with {what} (status {self.process.poll()})\n{self._story()}")

    def saw(self, what: str, accept: Callable[[State], bool]) -> State:
        """Wait for a state that passes: any state so far counts, also if it is over."""
        self.wait_for(what, lambda _: any(map(accept, self.states())))
        return next(filter(accept, self.states()))

    def _fail(self, why: str) -> NoReturn:
        """End the test; the screen is kept in `ARTIFACTS`."""
        ARTIFACTS.mkdir(exist_ok=True)
        self.screenshot().save(ARTIFACTS / f"{self.log.parent.name}.png")
        pytest.fail(why)

    def _story(self, changes: int = 12) -> str:
        """Tell what changed last, and what the window has said."""
        states = self.states()
        lines = []
        for before, after in itertools.pairwise(states[-changes - 1 :]):
            changed = {key: value for key, value in after.items() if key != "time" and value != before[key]}
            lines.append(f"{after['time']:.2f} " + ", ".join(f"{key}={value!s:.80}" for key, value in changed.items()))
        told = ("stage", "mode", "dialog", "frame", "shown", "playing", "settled", "texts", "notice", "message")
        last = {key: states[-1][key] for key in told} if states else {}
        return "\n".join((*lines, f"last: {last}", self.stderr.read_text()[-1000:]))

    def xdotool(self, *arguments: object) -> str:
        """Run xdotool on the window's display."""
        command = ["xdotool", *map(str, arguments)]
        return subprocess.run(command, env=self.environment, capture_output=True, text=True, check=True).stdout

    def box(self, widget: str, still: int = STILL) -> tuple[int, int, int, int]:
        """Left, top, width and height of a widget on the screen, once it has been still for some ticks."""
        left, top, width, height = self._place(widget, still)
        if not self._corner:  # without a window manager, nothing moves the window
            lines = self.xdotool("search", "--name", "V3 Studio", "getwindowgeometry", "--shell", "%1").splitlines()
            geometry = dict(line.split("=") for line in lines if "=" in line)
            self._corner = [int(geometry["X"]), int(geometry["Y"])]
        return self._corner[0] + left, self._corner[1] + top, width, height

    def point(self, widget: str, across: float = 0.5, down: float = 0.5) -> tuple[int, int]:
        """Screen pixel of a position on a widget, 0 to 1 on both axes."""
        left, top, width, height = self.box(widget)
        return int(left + across * width), int(top + down * height)

    def pixels(self, widget: str) -> np.ndarray:
        """(H, W, 3) uint8 RGB: what the screen shows where a widget is."""
        left, top, width, height = self.box(widget)
        return np.array(self.screenshot())[top : top + height, left : left + width]

    def ticks(self, count: int = 3) -> None:
        """Wait for a number of ticks of the window. It polls events in each tick, so pending X events have been handled
        by then, however busy the machine is. A tick takes at least 9.5 ms."""
        file = self.log.with_name(self.log.name + ".ticks")
        start = int(file.read_bytes())
        enough = lambda: int(file.read_bytes()) >= start + count  # noqa: E731
        wait_until(f"{count} ticks", lambda: enough() or self.process.poll() is not None)

    def drawn(self) -> None:
        """Wait until the window has handled pending X events and has been drawn. To be drawn, it sends itself an Expose
        event through the X server, which may take longer than some ticks; a query afterwards makes sure that the event
        has arrived."""
        self.ticks()
        self.xdotool("getmouselocation")
        self.ticks()

    def _place(self, widget: str, still: int, seconds: float = 120.0) -> list[int]:
        """The widget's frame, once it is visible and has not moved for some ticks."""
        end = time.monotonic() + seconds
        place: list[int] | None = None
        while time.monotonic() < end:
            before = place
            place = self.states()[-1]["widgets"].get(widget)
            if place is not None and place == before and place[2] > 0:
                return list(place)
            self.ticks(max(still - 6, 0))
            self.drawn()  # takes six ticks
        self._fail(f"{widget} never stopped moving; its frame is {place}")

    def across_frame(self, frame: int) -> float:
        """Position of a frame on the timeline widget, 0 to 1."""
        state = self.states()[-1]
        left, width = state["timeline_left"], state["timeline_width"]
        return float((left + (frame + 0.5) / state["frames"] * width) / state["widgets"]["timeline"][2])

    def on_timeline(self, frame: int, what: str = "plots") -> Place:
        """The place of a frame on the timeline: over its "images", which select a span, or its "plots"."""
        return self.across_frame(frame), self.part("timeline", what)[1]

    def select_span(self, first: int, last: int) -> State:
        """Drag over the images of the timeline."""
        span = (f"frames {first} to {last}", lambda s: s["span"] == [first, last])
        return self.drag("timeline", self.on_timeline(first, "images"), self.on_timeline(last, "images"), until=span)

    def stage(self, name: str) -> None:
        """Click a stage in the list."""
        self.choose("stages", name)
        at = self.wait_for(name, lambda s: s["stage"] == name)["pictures"]
        # during playback there is always another picture to render
        self.wait_for(f"{name} shown", lambda s: s["settled"] or s["pictures"] > at + 2)

    @property
    def _whole(self) -> str:
        """The widget whose upper left corner is that of the window's content."""
        return "start page" if self.states() and self.states()[-1]["start"] else "stages"

    def part(self, widget: str, name: str) -> Place:
        """The place of something in a widget that is an image, 0 to 1 on both axes."""
        state = self.wait_for(f"{name} in {widget}", lambda s: name in s["parts"].get(widget, {}))
        across, down = state["parts"][widget][name]
        return across, down

    def choose(self, widget: str, name: str, button: int = 1, until: Until | None = None) -> State:
        """Click a part of a widget that is an image."""
        self.part(widget, name)
        place = self.box(widget)  # parts move with their widget
        at = self.part(widget, name)
        x, y = (round(start + share * room) for start, share, room in zip(place, at, place[2:], strict=False))
        return self.send("mousemove", x, y, "mousedown", button, "mouseup", button, until=until)

    def menu_place(self, name: str) -> tuple[int, int]:
        """Screen pixel of the title of a menu, or of an item of the open menu by its key."""
        left, top, _, _ = self.box(self._whole, still=0)
        across, down = places(MENUS, EM)[name]
        return left + round(across), top + round(down)

    def menu(self, title: str, name: str, until: Until | None = None) -> State:
        """Choose an item of a menu by its key."""
        self.press(*self.menu_place(title))
        return self.press(*self.menu_place(name), until)

    def rest(self) -> None:
        """Leave dialogs, notices and everything else that Escape leaves, and show the stream in Review."""
        while (state := self.states()[-1])["dialog"]:
            self.key("Escape", until=("no dialog", lambda s, open_=state["dialog"]: s["dialog"] != open_))
        self.key("Escape")
        self.stage("review")

    def open(self, path: Path) -> State:
        """Open a take or a stream; returns the state once it is shown."""
        self.menu("File", "address", until=("the question", lambda s: s["dialog"] == "address" and s["typing"]))
        self.enter_text("dialog line", str(path))
        return self.key("Return", until=(path.name, lambda s: s["title"] == f"{path.name} - V3 Studio" and ready(s)))

    def click(self, widget: str, across: float = 0.5, down: float = 0.5, until: Until | None = None) -> State:
        """Press and release the left button on a widget."""
        return self.press(*self.point(widget, across, down), until)

    def press(self, x: int, y: int, until: Until | None = None) -> State:
        """Press and release the left button at a position on the screen."""
        return self.send("mousemove", x, y, *CLICK, until=until)

    def send(self, *arguments: object, until: Until | None = None) -> State:
        """Send an input event; return when the window has handled it and has been drawn. The query after the event
        makes sure that the X server has processed it."""
        self.xdotool(*arguments, "getmouselocation")
        self.drawn()
        return self.wait_for(*until) if until is not None else self.states()[-1]

    def drag(self, widget: str, start: Place, end: Place, button: int = 1, until: Until | None = None) -> State:
        """Drag across a widget in steps. The toolkit takes the pointer's position of the moment for that of a press."""
        left, top, width, height = self.box(widget)
        (a, b), (c, d) = start, end
        places = [
            (round(left + (a + t * (c - a)) * width), round(top + (b + t * (d - b)) * height)) for t in (0, 0.5, 1)
        ]
        self.send("mousemove", *places[0], "mousedown", button)
        self.xdotool("mousemove", *places[1], "getmouselocation")
        self.ticks()
        return self.send("mousemove", *places[2], "mouseup", button, until=until)

    def retype(self, widget: str, text: str) -> None:
        """Replace the text of a field."""
        self.click(widget, 0.9)
        self.chord("a")
        if text:
            self.enter_text(widget, text, selected=True)
        else:
            self.key("BackSpace", until=(f"{widget} to be empty", lambda s: s["texts"].get(widget) == ""))

    def enter_text(self, widget: str, text: str, selected: bool = False) -> None:
        """Type into the field with the keyboard focus, and wait until it contains the text: appended, or replacing its
        text if that is selected."""
        whole = text if selected else self.states()[-1]["texts"].get(widget, "") + text
        self.xdotool("type", "--delay", 1, text)
        self.wait_for(f"{whole!r} in {widget}", lambda s: s["texts"].get(widget) == whole)

    def key(self, name: str, until: Until | None = None) -> State:
        self._enter()
        return self.send("key", name, until=until)

    def _enter(self) -> None:
        """Bring the pointer into the window, because there is no window manager to give it the focus."""
        if not self._entered:
            self._entered = True
            self.send("mousemove", *self.point(self._whole, 0.9, 0.98))

    def chord(self, name: str, *modifiers: str, until: Until | None = None) -> State:
        """Press a key with Ctrl and other modifiers."""
        held = ("Control_L", *modifiers)
        down, up = (tuple(word for key in held for word in (way, key)) for way in ("keydown", "keyup"))
        self._enter()
        return self.send(*down, "key", name, *up, until=until)

    def screenshot(self) -> Image.Image:
        """The whole screen, RGB."""
        return ImageGrab.grab(xdisplay=self.environment["DISPLAY"])

    def close(self) -> int:
        """SIGTERM; returns the exit status."""
        self.process.terminate()
        return self.process.wait(120)


def assert_apart(window: RunningWindow, width: int, height: int) -> None:
    """No two widgets of the layout overlap, and all are inside the window."""
    window.drawn()  # what a state tells between two layouts is on no screen
    shown = window.states()[-1]["widgets"]
    frames = {name: np.array(frame) for name, frame in shown.items() if not name.startswith(("dialog", "hint"))}
    frames = {name: frame for name, frame in frames.items() if not name.startswith("setting") and frame[2] > 0}
    assert len(frames) > 15
    for name, a in frames.items():
        assert a[0] >= 0
        assert a[0] + a[2] <= width, name
        assert a[1] + a[3] <= height, name
        assert min(a[2], a[3]) >= 16, f"{name} is too small to be used: {a}"
        for other, b in frames.items():
            if name < other:
                across = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
                down = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
                assert across <= 0 or down <= 0, f"{name} {a} lies over {other} {b}"


@pytest.fixture
def open_window(display: str, tmp_path: Path) -> Iterator[Callable[..., RunningWindow]]:
    """`open_window("PATH", ...)` starts the window; it is always closed after the test."""
    windows: list[RunningWindow] = []

    def start(*arguments: str, **options: Any) -> RunningWindow:
        windows.append(RunningWindow(display, tmp_path / f"state{len(windows)}.jsonl", *arguments, **options))
        return windows[-1]

    yield start
    for window in windows:
        window.process.kill()
        window.process.wait()


@pytest.fixture(scope="module")
def take(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the finished take for all tests of a file."""
    return Path(shutil.copytree(finished / "take", tmp_path_factory.mktemp("window") / "take"))


@contextlib.contextmanager
def running(*arguments: Any, **options: Any) -> Iterator[RunningWindow]:
    """A window, with the arguments of `RunningWindow`, that must not have failed until it is closed."""
    window = RunningWindow(*arguments, **options)
    try:
        yield window
        assert window.close() == 0, window.stderr.read_text()[-2000:]
        assert "top-level" not in window.stderr.read_text(), "Open3D draws more than 20 widgets of a window wrongly"
    finally:
        window.process.kill()


@pytest.fixture(scope="module")
def shared_window(display: str, take: Path, request: pytest.FixtureRequest) -> Iterator[RunningWindow]:
    """A window on the take, for all tests of a file, which may have `ARGUMENTS` for it."""
    arguments = getattr(request.module, "ARGUMENTS", ())
    with running(display, take.with_name("state.jsonl"), str(take), *arguments) as window:
        window.wait_for("the take", lambda s: ready(s) and s["stages"]["review"][0] == "done")
        yield window
    assert "Traceback" not in window.stderr.read_text()


@pytest.fixture
def window(shared_window: RunningWindow) -> RunningWindow:
    """The window of the file, at rest. Tests take back what they change."""
    shared_window.rest()
    return shared_window
