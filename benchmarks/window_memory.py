"""Memory of the window over many rounds of what a user does in it.

    python benchmarks/window_memory.py TAKE [--minutes 60] [--out rounds.jsonl]

Copies the take and drives the real window. A round: opens one copy, plays it, plays its scene, goes through all stages
and back to Review, returns to the start page, opens the other copy's stream, plays it, and returns to the start page.
After each round, writes a JSON line with the resident memory, what `malloc` has in use and holds free, how much of what
is in use are decoded frames and images in caches (the faster the machine plays, the more) and how much is not, and the
numbers of caches, Python objects, threads and open files. At the end, prints the first and last rounds and the growth
per round. Needs a display; without one, use `xvfb-run -s "-screen 0 1400x900x24"`.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import psutil

from gui.app import check_display
from gui.models.playback.frame_cache import FrameCache
from studio.capture.lru_cache import ByteCache
from studio.errors import StudioError

STAGES = ("capture", "calibrate", "initialize", "train", "bake", "review")
PATIENCE = 120.0
"""Seconds in which something must come on screen."""

FIRST_ROUNDS = 0.25
"""Share of the rounds that are left out of the growth: caches of drivers and allocators fill up in them."""


def allocated() -> tuple[float, float] | None:
    """MiB of the C library's heaps that are in use, and that are free, of which some may have been given back to the
    system; None if it is not glibc."""
    library = ctypes.CDLL(None)
    if not hasattr(library, "malloc_info"):
        return None
    library.open_memstream.restype = ctypes.c_void_p
    library.free.argtypes = library.fclose.argtypes = [ctypes.c_void_p]
    library.malloc_info.argtypes = [ctypes.c_int, ctypes.c_void_p]
    text, size = ctypes.c_void_p(), ctypes.c_size_t()
    stream = library.open_memstream(ctypes.byref(text), ctypes.byref(size))
    library.malloc_info(0, stream)
    library.fclose(stream)
    root = ElementTree.fromstring(ctypes.string_at(text.value or 0, size.value))
    library.free(text)
    # the elements directly below the root are the sums of all heaps
    sums = {one.get("type", ""): int(one.get("size", 0)) for one in root if one.tag in ("total", "system")}
    free, mapped = sums["fast"] + sums["rest"], sums["mmap"]
    return (sums["current"] - free + mapped) / 2**20, free / 2**20


def measure(number: int, start: float) -> dict[str, float | int | None]:
    """The state of this process after a round."""
    gc.collect()
    process = psutil.Process()
    memory = allocated()
    # all that exist, whoever holds them: one of a closed source counts too
    every = gc.get_objects()
    frames = [one.held for one in every if type(one) is FrameCache and one.held]
    images = [one.used for one in every if type(one) is ByteCache and one.used]
    cached = (sum(frames) + sum(images)) / 2**20
    return {
        "round": number,
        "seconds": round(time.monotonic() - start, 1),
        "resident_mib": round(process.memory_info().rss / 2**20, 1),
        "malloc_used_mib": round(memory[0], 1) if memory is not None else None,
        "malloc_free_mib": round(memory[1], 1) if memory is not None else None,
        "frames_mib": round(sum(frames) / 2**20, 1),
        "images_mib": round(sum(images) / 2**20, 1),
        "other_used_mib": round(memory[0] - cached, 1) if memory is not None else None,
        "caches": len(frames) + len(images),
        "objects": len(every),
        "threads": process.num_threads(),
        "files": process.num_fds(),
    }


def growth(values: list[float]) -> float:
    """Growth per round, the slope of a straight line (least squares), without the first rounds."""
    late = np.array(values[int(FIRST_ROUNDS * len(values)) :])
    if len(late) < 3:
        raise StudioError("benchmark.too_short", f"{len(values)} rounds are too few", fix="Give it more --minutes.")
    return float(np.polyfit(np.arange(len(late)), late, 1)[0])


class Rounds:
    """Drives a window.

    Args:
        size: of the window, pixels.
        device: that draws it.
        play: seconds for which each thing is played.
    """

    def __init__(self, size: tuple[int, int], device: str, play: float) -> None:
        from open3d.visualization import gui

        from gui.window import MainWindow

        self._application = gui.Application.instance
        self._application.initialize()
        self.window = MainWindow(size, None, device, device.endswith("(software)"))
        self._seconds = play
        self.frames = 0

    def _until(self, accept: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + PATIENCE
        while not accept():
            if not self._application.run_one_tick():
                raise StudioError("benchmark.closed", "the window was closed")
            if time.monotonic() > end:
                said = self.window.player.message or self.window.notices.text
                raise StudioError("benchmark.hangs", f"{what}: nothing in {PATIENCE:.0f} s {said}".strip())

    def _settle(self, what: str) -> None:
        ticks = self.window.ticks
        self._until(lambda: self.window.ticks > ticks + 3 and self.window.views.settled, what)

    def _play(self) -> None:
        self.window.player.transport.play()
        until, before = time.monotonic() + self._seconds, self.window.pictures
        self._until(lambda: time.monotonic() > until and self.window.pictures > before, "playback")
        self.frames += self.window.pictures - before
        self.window.player.transport.pause()

    def _open(self, path: Path) -> None:
        self.window.open(str(path))
        self._until(lambda: not self.window.opening, f"opening {path}")
        opened = self.window.player.opened
        if opened is None or str(opened.path) != str(path):
            raise StudioError("benchmark.not_opened", self.window.notices.text, file=path)
        self._until(lambda: self.window.player.picture is not None, f"the first picture of {path}")

    def _start_page(self) -> None:
        self.window.actions.start.show()
        self._settle("the start page")
        self.window.actions.start.hide()

    def round(self, take: Path, stream: Path) -> None:
        """One round."""
        self._open(take)
        self._play()
        self.window.views.choose("scene")
        self._settle("the scene")
        self._play()
        for stage in STAGES:
            self.window.select(stage)
            self._settle(stage)
        self.window.views.choose("scene")
        self._settle("Review")
        self._start_page()
        self._open(stream)
        self._play()
        self._start_page()

    def close(self) -> None:
        """Close the window."""
        self.window.close()
        while self._application.run_one_tick():
            pass
        self.window.closed()


def main() -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path, metavar="TAKE", help="trained and baked")
    parser.add_argument("--minutes", type=float, default=60.0, help="default %(default)s")
    parser.add_argument("--play", type=float, default=4.0, help="seconds of each playback (default %(default)s)")
    parser.add_argument("--size", default="1280x800", metavar="WxH")
    parser.add_argument("--out", type=Path, help="file for a JSON line per round")
    options = parser.parse_args()
    width, _, height = options.size.partition("x")
    rows: list[dict[str, float | int | None]] = []
    try:
        if not options.minutes > 0:
            what = f"--minutes {options.minutes:g} leaves no time for a round"
            raise StudioError("benchmark.too_short", what, fix="Give it more --minutes.")
        device = check_display()
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            os.environ["XDG_CONFIG_HOME"] = os.environ["XDG_STATE_HOME"] = str(folder / "settings")
            copies = [Path(shutil.copytree(options.take, folder / f"copy_{number}")) for number in range(2)]
            rounds = Rounds((int(width), int(height)), device, options.play)
            start = time.monotonic()
            while not rows or time.monotonic() < start + 60 * options.minutes:
                one, other = copies[:: 1 if len(rows) % 2 else -1]
                rounds.round(one, other / "stream")
                rows.append(measure(len(rows) + 1, start))
                line = json.dumps(rows[-1])
                print(line, flush=True)
                if options.out is not None:
                    with options.out.open("a") as file:
                        file.write(line + "\n")
            rounds.close()
        resident = [float(row["resident_mib"] or 0) for row in rows]
        print(f"{device}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; window of {options.size}")
        print(f"{len(rows)} rounds in {rows[-1]['seconds']} s, {rounds.frames} pictures played")
        print(f"resident MiB, first rounds: {resident[:3]}, last rounds: {resident[-3:]}")
        columns = ("resident_mib", "malloc_used_mib", "frames_mib", "images_mib", "other_used_mib", "malloc_free_mib")
        for what in (*columns, "objects"):
            found = [float(value) for row in rows if (value := row[what]) is not None]
            if found:
                print(f"{what}: {growth(found):+.2f} per round, without the first {FIRST_ROUNDS:.0%} of the rounds")
    except StudioError as error:
        print(f"window_memory: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
