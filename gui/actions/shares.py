"""What the menu Share does."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from gui.panels.share_dialogs import ask_serve, ask_share, show_serving
from gui.presenters.run.shares import ShareRequest, size_words
from gui.shell import Shell
from pipelines.share import ShareSize, share_size
from studio.errors import StudioError


class ShareActions:
    """See the module.

    Args:
        window: the main window.
    """

    def __init__(self, window: Shell) -> None:
        self._window = window

    def ask(self, form: str) -> None:
        """Ask for the options, then share. `form` is a key of `FORMS`."""
        window = self._window
        size = self._size()
        if size is None:
            return
        words = size_words(size, form)
        if form == "single-file" and not size.single_file_possible:
            window.dialogs.message("Share", words)
            return
        opened = window.player.opened
        assert opened is not None
        assert isinstance(opened.path, Path)
        request = ShareRequest(form, str(opened.path), opened.title, opened.path.parent)

        ask_share(window.dialogs, request, words, window.exports.share)

    def serve(self) -> None:
        """Ask how, then serve; if the take is served already, show its address."""
        window = self._window
        opened, serving = window.player.opened, window.serving
        if serving.address and opened is not None and serving.source == str(opened.path):
            show_serving(window.dialogs, serving, self.stop)
            return
        size = self._size()
        if size is None:
            return
        assert opened is not None
        ask_serve(window.dialogs, size_words(size, "serve"), partial(self._start, str(opened.path)))

    def _start(self, source: str, https: bool) -> None:
        try:
            self._window.serving.start(source, https)
        except OSError as error:
            self._window.dialogs.message("Share", str(error))

    def stop(self) -> None:
        """Stop serving."""
        self._window.serving.stop()

    def poll(self) -> bool:
        """Call at each tick; returns whether something changed."""
        window = self._window
        serving = window.serving
        if not serving.poll():
            return False
        if serving.failure:
            window.dialogs.message("Share", serving.failure)
            serving.failure = ""
        elif serving.address and not window.dialogs.name:  # what is being typed elsewhere must not be lost
            show_serving(window.dialogs, serving, self.stop)
        return True

    def _size(self) -> ShareSize | None:
        """What sharing takes; None, and a message, if there is nothing to share."""
        window = self._window
        opened = window.player.opened
        if opened is None or not isinstance(opened.path, Path):
            window.dialogs.message("Share", "Open a take or a stream of this machine first.")
            return None
        try:
            return share_size(str(opened.path))
        except (StudioError, OSError) as error:
            window.dialogs.message("Share", str(error))
            return None
