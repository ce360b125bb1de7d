"""PlayerPresenter: the state of the playback view. The window asks it at each tick what has changed."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gui.presenters.drawing import draw
from gui.presenters.orbit import OrbitCamera
from gui.presenters.sources import FrameSource, Opened, open_path
from gui.presenters.transport import Transport
from gui.presenters.worker import Done, LatestWorker
from studio.cameras import Camera
from studio.errors import StudioError
from studio.gaussians import Gaussians

BACKGROUNDS = {"dark": (0.11, 0.12, 0.13), "black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0)}
NOTHING_OPEN = "Open a take or a stream: File > Open, or v3studio-gui FOLDER."

Color = tuple[float, float, float]
DrawFn = Callable[[Gaussians, Camera, Color], np.ndarray]


@dataclass(frozen=True, eq=False)
class Wish:
    """A picture to be made: these splats from here."""

    source: FrameSource
    frame: int
    orbit: OrbitCamera
    size: tuple[int, int]
    background: Color


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that was made.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        frame: 0-based.
        source: name of the source ("decoded", "trained").
        splats: how many Gaussians it was drawn from.
        load_seconds, draw_seconds: what getting the Gaussians and drawing them took.
    """

    image: np.ndarray
    frame: int
    source: str
    splats: int
    load_seconds: float
    draw_seconds: float


class PlayerPresenter:
    """What is open, which frame is due, from where it is seen, and the newest picture.

    Args:
        draw_function: makes the pixels; tests give their own.
        now: a clock in seconds that never runs backwards.
    """

    def __init__(self, draw_function: DrawFn = draw, now: Callable[[], float] = time.monotonic) -> None:
        self._draw = draw_function
        self._now = now
        self._worker: LatestWorker[Wish, Picture] = LatestWorker(self._work, "v3studio viewport")
        self._asked: Wish | None = None
        self._shown_times: deque[float] = deque(maxlen=120)
        self.opened: Opened | None = None
        self.source: FrameSource | None = None
        self.transport = Transport(1, 25.0, now=now)
        self.orbit = OrbitCamera()
        self.home = self.orbit
        self.size = (960, 540)
        self.background = "dark"
        self.picture: Picture | None = None
        self.message = NOTHING_OPEN

    # What is open

    def open(self, path: str | Path) -> bool:
        """Open a take or a stream in place of what is open. On bad input `message` says what is wrong."""
        try:
            opened = open_path(Path(path))
            first = opened.default.gaussians(0)
        except StudioError as error:
            self.message = str(error)
            return False
        except Exception as error:  # a defect of ours: it must not take the window with it
            self.message = f"{path} could not be opened: {type(error).__name__}: {error}"
            return False
        self._close_sources()
        self.opened, self.source = opened, opened.default
        self.transport = Transport(self.source.frame_count, self.source.fps, self.source.group_starts, now=self._now)
        visible = first.means[first.opacities > 0.1]
        points = (visible if len(visible) else first.means).detach().cpu().numpy()
        self.home = OrbitCamera.around(points, opened.up)
        if opened.view is not None:
            self.home = OrbitCamera.looking_through(opened.view, self.home.target, opened.up)
        self.orbit = self.home
        self.picture = None
        self.message = ""
        return True

    @property
    def title(self) -> str:
        """What the window is called."""
        return f"{self.opened.title} - V3 Studio" if self.opened else "V3 Studio"

    @property
    def source_names(self) -> list[str]:
        """What can be shown of what is open."""
        return list(self.opened.sources) if self.opened else []

    def choose_source(self, name: str) -> bool:
        """Show another of `source_names` at the same frame; False where it is not there."""
        if self.opened is None or name not in self.opened.sources:
            return False
        if self.source is not self.opened.sources[name]:
            frame, playing = self.transport.frame, self.transport.playing
            loop, speed = self.transport.loop, self.transport.speed
            self.source = self.opened.sources[name]
            self.transport = Transport(
                self.source.frame_count, self.source.fps, self.source.group_starts, now=self._now
            )
            self.transport.loop, self.transport.speed = loop, speed
            self.transport.seek(frame)
            if playing:
                self.transport.play()
            self.message = ""
        return True

    # The view

    def resize(self, width: int, height: int) -> None:
        """The viewport has this many pixels now."""
        self.size = (max(int(width), 16), max(int(height), 16))

    def drag_orbit(self, dx: float, dy: float) -> None:
        """Turn by a drag in pixels."""
        self.orbit = self.orbit.orbit(dx, dy)

    def drag_pan(self, dx: float, dy: float) -> None:
        """Move by a drag in pixels."""
        self.orbit = self.orbit.pan(dx, dy, self.size[1])

    def wheel(self, notches: float) -> None:
        """Nearer or farther."""
        self.orbit = self.orbit.zoom(notches)

    def reset_view(self) -> None:
        """Back to where the view was on opening."""
        self.orbit = self.home

    def next_background(self) -> str:
        """Dark, black, white, and again."""
        names = list(BACKGROUNDS)
        self.background = names[(names.index(self.background) + 1) % len(names)]
        return self.background

    # Pictures

    def poll(self) -> Picture | None:
        """Ask for what is due and return a new picture if one is there. Never waits; call at each tick."""
        if self.source is not None:
            wish = Wish(self.source, self.transport.frame, self.orbit, self.size, BACKGROUNDS[self.background])
            if self._asked is None or not _same(wish, self._asked):
                self._asked = wish
                self._worker.ask(wish)
        done = self._worker.take()
        return self._received(done) if done is not None else None

    def _received(self, done: Done[Wish, Picture]) -> Picture | None:
        if done.request.source is not self.source:
            return None  # of what was open before
        if done.error is not None:
            what = str(done.error) if isinstance(done.error, StudioError) else repr(done.error)
            self.message = f"Frame {done.request.frame + 1}: {what}"
            self.transport.pause()
            return None
        self.picture = done.result
        self.message = ""
        self._shown_times.append(self._now())
        return self.picture

    def _work(self, wish: Wish) -> Picture:
        start = time.perf_counter()
        gaussians = wish.source.gaussians(wish.frame)
        loaded = time.perf_counter()
        image = self._draw(gaussians, wish.orbit.camera(*wish.size), wish.background)
        end = time.perf_counter()
        return Picture(image, wish.frame, wish.source.name, len(gaussians), loaded - start, end - loaded)

    @property
    def settled(self) -> bool:
        """True where the newest picture shows what was last asked for."""
        return self._worker.idle

    @property
    def rate(self) -> float:
        """Pictures a second handed to the window over the last two seconds."""
        horizon = self._now() - 2.0
        recent = [moment for moment in self._shown_times if moment >= horizon]
        return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0

    @property
    def status(self) -> str:
        """One line of figures on the newest picture."""
        if self.picture is None or self.source is None:
            return ""
        picture = self.picture
        parts = [
            picture.source,
            f"frame {picture.frame + 1} of {self.source.frame_count}",
            f"{picture.frame / self.source.fps:.2f} s",
            f"{picture.splats:,} splats",
            f"load {1000 * picture.load_seconds:.0f} ms",
            f"draw {1000 * picture.draw_seconds:.0f} ms",
        ]
        if self.transport.playing:
            parts.append(f"{self.rate:.0f} pictures/s")
        return "   ".join(parts)

    def close(self) -> bool:
        """End the thread and let go of files. Returns whether the thread ended in time."""
        ended = self._worker.close()
        self._close_sources()
        return ended

    def _close_sources(self) -> None:
        if self.opened is not None:
            for source in self.opened.sources.values():
                source.close()


def _same(one: Wish, other: Wish) -> bool:
    return (
        one.source is other.source
        and one.orbit is other.orbit
        and (one.frame, one.size, one.background) == (other.frame, other.size, other.background)
    )
