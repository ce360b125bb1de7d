"""Opening takes, streams and URLs."""

import ctypes
import threading
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote

from v3studio.gui.models.folders import Kind, kind_of
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.sources import Opened, load
from v3studio.gui.models.preferences import Preferences
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.platform.clipboard import Clipboard
from v3studio.gui.platform.keyboard import KEYS, type_text
from v3studio.gui.platform.presses import Chords, Press
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.gui.widgets.dialogs.take import NewTakeDialog
from v3studio.pipelines.new_take import NewTake
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.storage import is_address

Loaded = tuple[Opened, Gaussians | None]


class Opening:
    """Opens places on a thread.

    Signals:
        opened: a take, or None for a stream, is in the workspace and the player.
        refused: a place could not be opened.
    """

    def __init__(
        self, player: PlayerPresenter, workspace: Workspace, views: StageViews, preferences: Preferences,
        notices: Notices,
    ) -> None:  # fmt: skip
        self._player, self._workspace, self._views = player, workspace, views
        self._preferences, self._notices = preferences, notices
        self.opened: Signal[[Take | None]] = Signal()
        self.refused: Signal[[]] = Signal()
        self._worker: LatestWorker[str, Loaded] = LatestWorker(load, "v3studio open", self._loaded)

    def open(self, place: str) -> None:
        """Open a take, a stream or a URL; bad input is reported in the window."""
        self._workspace.opening = place
        self._notices.show(f"Opening {place} ...", topic="open")
        self._worker.ask(place)

    def _loaded(self, done: Done[str, Loaded]) -> None:
        player, error = self._player, done.error
        self._workspace.opening = ""
        if done.result is None:
            bug = f"{done.request}: cannot be opened: {type(error).__name__}: {error}"
            self._notices.show(str(error) if isinstance(error, StudioError) else bug, bad=True, topic="open")
            self.refused.emit()
            return
        self._notices.clear("open")
        opened, first = done.result
        player.adopt(opened, first)
        self._workspace.open(opened.take)
        self._views.forget()
        # the previous take's buffers have just been freed; on a thread, because it can take half a second
        threading.Thread(target=_return_freed_memory, name="v3studio memory", daemon=True).start()
        self._preferences.opened(str(opened.path))
        self._preferences.save()
        player.background = self._preferences.background
        self._views.select("review" if opened.sources else "capture")
        if opened.sources and self._preferences.play_on_opening:
            player.transport.play()
        self.opened.emit(opened.take)


class OpenDialogs:
    """Asks what to open, or what a new take is made of. `open_place`: opens a path or URL."""

    def __init__(
        self, player: PlayerPresenter, preferences: Preferences, dialogs: Dialogs, open_place: Callable[[str], None],
        changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self._player, self._preferences, self._dialogs, self._open = player, preferences, dialogs, open_place
        self._new_take = NewTakeDialog(dialogs, self._create, changed)

    def new_take(self, new: NewTake | None = None) -> None:
        """Ask for footage, settings and the take's folder. `new`: what is known of them."""
        self._new_take.show(new or NewTake())

    def _create(self, new: NewTake) -> None:
        try:
            root = new.create()
        except StudioError as error:
            self._new_take.show(new, str(error))
            return
        self._dialogs.close()
        self._open(str(root))

    def ask(self) -> None:
        """Ask for the folder or the file of a take, a stream or a cast."""
        opened = self._player.opened
        known = [Path(name) for name in self._preferences.recent if "://" not in name]
        if opened is not None and isinstance(opened.path, Path):
            known.insert(0, opened.path)
        start = self._dialogs.usual_folder(*(path.parent for path in known))
        title, endings = "Open take, stream or cast", (".v3s", ".json")
        ask_path(self._dialogs, title, start, "take", self._open, endings=endings)

    def ask_address(self) -> None:
        """Ask for the URL of a stream."""
        words = "URL of the stream's folder, for example https://example.org/streams/walk"
        answer = ("open", "Open", lambda text: self._open(text.strip()))
        self._dialogs.line("address", "Open stream from URL", words, "", answer)


class PasteActions:
    """Opens what was copied, or types it into the text field that has kept Ctrl+V: the toolkit's fields paste only what
    was copied in them. `open_place`: opens a path or URL. `new_take`: asks for more about a new take. `chords`: while
    Ctrl is held, fields take no text."""

    def __init__(
        self, clipboard: Clipboard, notices: Notices, open_place: Callable[[str], None],
        new_take: Callable[[NewTake], object], chords: Chords,
    ) -> None:  # fmt: skip
        self._clipboard, self._notices, self._open, self._new_take = clipboard, notices, open_place, new_take
        self._chords, self._into_field, self._copied_inside = chords, False, False
        self._text: str | None = None  # to be typed

    def paste(self) -> None:
        """Open the path on the clipboard, once it is known."""
        if not self._clipboard.ask():
            self._notices.show("There is no clipboard to paste from.", bad=True, topic="open")

    def kept(self, press: Press) -> None:
        """Paste into the text field that has kept a press of Ctrl+V."""
        if press.control and press.code in (KEYS["c"], KEYS["x"]):
            self._copied_inside = True  # the toolkit pastes this from now on
        elif press.control and press.code == KEYS["v"] and not self._copied_inside:
            self._into_field = self._clipboard.ask()

    @property
    def waits(self) -> bool:
        """Whether something is about to be typed."""
        return self._into_field or self._text is not None

    def poll(self) -> None:
        """Open or type the text once the clipboard has answered. Call at each tick."""
        text = self._clipboard.poll()
        if text is not None and self._into_field:
            self._into_field, self._text = False, (path_in(text).splitlines() or [""])[0]
        elif text is not None:
            self._pasted(text)
        if self._text is not None and not self._chords.control:
            text, self._text = self._text, None
            if not type_text(text):
                problem = f"'{text[:60]}' has letters that this keyboard lacks, so it cannot be pasted."
                self._notices.show(problem, bad=True, topic="paste")

    def _pasted(self, text: str) -> None:
        """Open a path or URL; a folder that is neither a take nor a stream becomes the footage of a new take."""
        words = path_in(text)
        problem = ""
        if not words:
            problem = "The clipboard has no text. Copy the path of a folder first."
        elif "\n" in words or len(words) > 4096:
            problem = f"The clipboard has no path: '{words.splitlines()[0][:60]} ...'. Copy the path of one folder."
        elif is_address(words):
            self._open(words)
        else:
            try:
                path = Path(words).expanduser()
            except RuntimeError:
                problem = f"{words}: this machine has no such user. Copy the whole path, which starts with /."
            else:
                if path.is_dir() and kind_of(path) == Kind.FOLDER:
                    self._new_take(NewTake(footage=str(path)))
                else:
                    self._open(str(path))
        if problem:
            self._notices.show(problem, bad=True, topic="open")


def path_in(text: str) -> str:
    """The path or URL in copied text, without spaces and quotes around it; a file manager's `file://` URL as a path."""
    words = text.strip().strip("'\"")
    if not words.startswith("file://"):
        return words
    return unquote(words.removeprefix("file://").removeprefix("localhost"))  # RFC 8089


def _return_freed_memory() -> None:
    """Return unused pages to the system, if this is glibc: it keeps what dozens of threads, which decode and render,
    freed in up to eight heaps per core."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(ctypes.c_size_t(0))
