"""The start page: what its parts do, and when it is on screen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from urllib.parse import unquote

from gui.models.folders import kind_of
from gui.models.loop import LOOP
from gui.models.take.new_take import NewTake, make_sample_take, sample_settings
from gui.models.take.take_queue import TakeQueue
from gui.pages.start.page import StartPage
from gui.platform.clipboard import Clipboard
from gui.shell import Shell
from studio.errors import StudioError
from studio.storage import is_address

LOOK_EVERY = 0.25
"""Seconds between two looks at the files of the page."""


class StartActions:
    """See the module.

    Args:
        window: the main window.
        queue: the queue of takes.
        clipboard: where a pasted path comes from.
        others: what "new", "open", "address" and "queue" do.
        new_take: asks for what is missing of a new take.
    """

    def __init__(
        self,
        window: Shell,
        queue: TakeQueue,
        clipboard: Clipboard,
        others: Mapping[str, Callable[[], object]],
        new_take: Callable[[NewTake], object],
    ) -> None:
        self._window, self._clipboard, self._others, self._new_take = window, clipboard, others, new_take
        self.page = StartPage(queue, sample_settings() is not None)
        self.page.changed.connect(window.changed)
        self._asked = self._pasting = False
        self._timer = LOOP.every(LOOK_EVERY, self._look)

    def update(self) -> None:
        """Show the page if it is asked for or nothing is open, else hide it."""
        window = self._window
        opened = window.player.opened
        wanted = self._asked or (opened is None and not window.opening)
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
        """Do what a part of the page stands for, see `StartPicture`."""
        window, page = self._window, self.page
        kind, _, number = name.partition(" ")
        if kind == "back":
            self.hide()
        elif kind == "card":
            self._open_card(int(number))
        elif kind == "remove":
            if int(number) < len(page.places):
                window.preferences.forget(page.places[int(number)])
                window.preferences.save()
        elif kind == "forget":
            window.preferences.recent = window.preferences.recent_there()
            window.preferences.save()
        elif kind == "start":
            page.queue.start()
        elif kind == "stop":
            page.queue.stop()
        elif kind == "sample":
            self.open_sample()
        else:
            self._others[kind]()
        self._timer.soon()

    def _open_card(self, number: int) -> None:
        card = self.page.card(number)
        if card is not None and card.kind == "missing":
            words = f"{card.place}: no such folder. It was moved, deleted, or is on a disk that is not connected."
            self._window.notices.show(words, bad=True, topic="open")
        elif number < len(self.page.places):
            self.open(self.page.places[number])

    def open(self, place: str) -> None:
        """Open a take or a stream; the page goes once it is open."""
        self._window.open(place)

    def open_sample(self) -> None:
        """Open the take of the sample capture, which is created first if need be."""
        window = self._window
        try:
            take, new = make_sample_take()
        except StudioError as error:
            window.notices.show(str(error), bad=True, topic="open")
            return
        self.open(str(take))
        if new:
            window.notices.show(f"Created a take of the sample capture: {take}", path=take, topic="sample")

    def paste(self) -> None:
        """Open the path on the clipboard, once it is known."""
        if self._clipboard.ask():
            self._pasting = True
        else:
            self._window.notices.show("There is no clipboard to paste from.", bad=True, topic="open")

    def pasted(self, text: str) -> None:
        """Open a path or URL; a folder that is neither a take nor a stream becomes the footage of a new take."""
        words = path_in(text)
        if not words:
            self._window.notices.show(
                "The clipboard has no text. Copy the path of a folder first.", bad=True, topic="open"
            )
        elif "\n" in words or len(words) > 4096:
            first = words.splitlines()[0][:60]
            self._window.notices.show(
                f"The clipboard has no path: '{first} ...'. Copy the path of one folder.", bad=True, topic="open"
            )
        elif is_address(words):
            self.open(words)
        else:
            try:
                path = Path(words).expanduser()
            except RuntimeError:
                self._window.notices.show(
                    f"{words}: this machine has no such user. Copy the whole path, which starts with /.",
                    bad=True,
                    topic="open",
                )
                return
            if path.is_dir() and kind_of(path) == "folder":
                self._new_take(NewTake(footage=str(path)))
            else:
                self.open(str(path))

    def opened(self) -> None:
        """Something has been opened."""
        self._asked = False
        self.update()

    def copied(self, text: str) -> None:
        """Open what came from the clipboard, if it was asked for."""
        if self._pasting:
            self._pasting = False
            self.pasted(text)

    def close(self) -> None:
        """End the thread."""
        LOOP.stop(self._timer)
        self.page.close()


def path_in(text: str) -> str:
    """The path or URL in copied text: without spaces and quotes around it, and a `file://` URL, as file managers copy
    it, as a path."""
    words = text.strip().strip("'\"")
    if not words.startswith("file://"):
        return words
    return unquote(words.removeprefix("file://").removeprefix("localhost"))  # RFC 8089
