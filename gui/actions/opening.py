"""Opening takes, streams and URLs."""

import ctypes
import threading
from collections.abc import Callable

from v3studio.gui.models.playback.sources import Opened, load
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.gui.shell import Shell
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians

Loaded = tuple[Opened, Gaussians | None]


class Opening:
    """See the module. `ended`: called once something is opened, or was not, with whether it was."""

    def __init__(self, window: Shell, ended: Callable[[bool], object]) -> None:
        self._window, self._ended = window, ended
        self._worker: LatestWorker[str, Loaded] = LatestWorker(load, "v3studio open", self._loaded)

    def open(self, place: str) -> None:
        """Open a take, a stream or a URL; bad input is reported in the window."""
        window = self._window
        window.workspace.opening = place
        window.notices.show(f"Opening {place} ...", topic="open")
        self._worker.ask(place)

    def _loaded(self, done: Done[str, Loaded]) -> None:
        window, error = self._window, done.error
        window.workspace.opening = ""
        if done.result is None:
            bug = f"{done.request}: cannot be opened: {type(error).__name__}: {error}"
            window.notices.show(str(error) if isinstance(error, StudioError) else bug, bad=True, topic="open")
            self._ended(False)
            return
        window.notices.clear("open")
        opened, first = done.result
        take = opened.take
        window.player.adopt(opened, first)
        window.workspace.open(take)
        window.views.forget()
        # the previous take's buffers have just been freed; on a thread, because it can take half a second
        threading.Thread(target=_return_freed_memory, name="v3studio memory", daemon=True).start()
        window.exports.path.open(take.camera_path if take is not None else None, window.workspace.history)
        window.marks.open(take.marks if take is not None else None)
        window.notices.outcome("marks file", str(window.marks.damage or ""))
        window.preferences.opened(str(opened.path))
        window.preferences.save()
        window.player.background = window.preferences.background
        window.views.select("review" if opened.sources else "capture")
        if opened.sources and window.preferences.play_on_opening:
            window.player.transport.play()
        window.window.set_needs_layout()
        self._ended(True)


def _return_freed_memory() -> None:
    """Return unused pages to the system, if this is glibc: it keeps what dozens of threads, which decode and render,
    freed in up to eight heaps per core."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(ctypes.c_size_t(0))
