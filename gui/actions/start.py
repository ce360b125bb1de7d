"""The start page: what its parts do, and when it is on screen."""

from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote

from v3studio.gui.models.folders import kind_of
from v3studio.gui.models.loop import LOOP
from v3studio.gui.models.take.take_queue import TakeQueue
from v3studio.gui.pages.start.page import StartPage
from v3studio.gui.platform.clipboard import Clipboard
from v3studio.gui.shell import Shell
from v3studio.pipelines.new_take import NewTake, make_sample_take, sample_settings
from v3studio.studio.storage import is_address

LOOK_EVERY = 0.25  # seconds between two looks at the files of the page


class StartActions:
    """See the module. `act`: does what an item of the menus stands for, by its key. `new_take`: asks for more."""

    def __init__(
        self,
        window: Shell,
        queue: TakeQueue,
        clipboard: Clipboard,
        act: Callable[[str], object],
        new_take: Callable[[NewTake], object],
    ) -> None:
        self._window, self._clipboard, self._act, self._new_take = window, clipboard, act, new_take
        self.page = StartPage(queue, sample_settings() is not None)
        self.page.changed.connect(window.changed)
        self._asked = False
        self._timer = LOOP.every(LOOK_EVERY, self._look)

    def update(self) -> None:
        """Show the page if it is asked for or nothing is open, else hide it."""
        window = self._window
        opened = window.player.opened
        wanted = self._asked or (opened is None and not window.workspace.opening)
        if window.start.shown != wanted:
            window.layout.set_start(wanted)
        self._timer.soon()
        window.changed()

    def _look(self) -> None:
        opened = self._window.player.opened
        if self._window.start.shown:
            self.page.back = opened.title if opened is not None else ""
            self.page.look(self._window.preferences.recent)

    def show(self) -> None:
        """Show the page over the open take or stream."""
        self._window.player.transport.pause()
        self._asked = True
        self.update()

    def hide(self) -> bool:
        """Show the open take or stream again; returns whether the page was over it."""
        was_shown, self._asked = self._asked and self._window.player.opened is not None, False
        self.update()
        return was_shown

    def toggle(self) -> None:
        """Show the page, or the open take or stream."""
        if not self.hide():
            self.show()

    def act(self, name: str) -> None:
        """Do what a part of the page stands for, see `StartImage`."""
        kind, _, number = name.partition(" ")
        actions: dict[str, Callable[[], object]] = {
            "back": self.hide,
            "card": lambda: self._open_card(int(number)),
            "remove": lambda: self._remove_card(int(number)),
            "forget": self._forget_missing,
            "start": self.page.queue.start,
            "stop": self.page.queue.stop,
            "sample": self.open_sample,
        }
        actions.get(kind, lambda: self._act(kind))()
        self._timer.soon()

    def _remove_card(self, number: int) -> None:
        if number < len(self.page.places):
            self._window.preferences.forget(self.page.places[number])
            self._window.preferences.save()

    def _forget_missing(self) -> None:
        preferences = self._window.preferences
        preferences.recent = preferences.recent_there()
        preferences.save()

    def _open_card(self, number: int) -> None:
        if number >= len(self.page.places):
            return
        place = self.page.places[number]
        card = self.page.cards.get(place)
        if card is not None and card.kind == "missing":
            words = f"{place}: no such folder. It was moved, deleted, or is on a disk that is not connected."
            self._window.notices.show(words, bad=True, topic="open")
        else:
            self._window.open(place)

    def open_sample(self) -> None:
        """Open the take of the sample capture, which is created first if need be."""
        window = self._window
        with window.notices.reporting("open"):
            take, new = make_sample_take()
            window.open(str(take))
            if new:
                window.notices.show(f"Created a take of the sample capture: {take}", path=take, topic="sample")

    def paste(self) -> None:
        """Open the path on the clipboard, once it is known."""
        if not self._clipboard.ask():
            self._window.notices.show("There is no clipboard to paste from.", bad=True, topic="open")

    def pasted(self, text: str) -> None:
        """Open a path or URL; a folder that is neither a take nor a stream becomes the footage of a new take."""
        words = path_in(text)
        problem = ""
        if not words:
            problem = "The clipboard has no text. Copy the path of a folder first."
        elif "\n" in words or len(words) > 4096:
            problem = f"The clipboard has no path: '{words.splitlines()[0][:60]} ...'. Copy the path of one folder."
        elif is_address(words):
            self._window.open(words)
        else:
            try:
                path = Path(words).expanduser()
            except RuntimeError:
                problem = f"{words}: this machine has no such user. Copy the whole path, which starts with /."
            else:
                if path.is_dir() and kind_of(path) == "folder":
                    self._new_take(NewTake(footage=str(path)))
                else:
                    self._window.open(str(path))
        if problem:
            self._window.notices.show(problem, bad=True, topic="open")


def path_in(text: str) -> str:
    """The path or URL in copied text, without spaces and quotes around it; a file manager's `file://` URL as a path."""
    words = text.strip().strip("'\"")
    if not words.startswith("file://"):
        return words
    return unquote(words.removeprefix("file://").removeprefix("localhost"))  # RFC 8089
