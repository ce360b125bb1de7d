"""What the menu Share does."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from gui.models.loop import later
from gui.models.take.shares import ShareRequest, share_words, stale_words
from gui.shell import Shell
from gui.widgets.dialogs.share import ask_serve, ask_share, show_serving, show_stale
from pipelines.share.sharing import ShareSize, share_size
from studio.errors import StudioError


class ShareActions:
    """See the module.

    Args:
        window: the main window.
    """

    def __init__(self, window: Shell) -> None:
        self._window = window
        self._request: ShareRequest | None = None
        window.workspace.changed.connect(self._show_stale)
        window.serving.started.connect(later(self._started))
        window.serving.failed.connect(partial(window.notices.show, bad=True, topic="serve"))

    def ask(self, form: str) -> None:
        """Ask for the options, then share. `form` is a key of `FORMS`."""
        window = self._window
        size = self._size()
        if size is None:
            return
        words = share_words(size, form)
        if form == "single-file" and not size.single_file_possible:
            window.notices.show(words, bad=True, topic=form)
            return
        window.notices.clear(form)
        opened = window.player.opened
        assert opened is not None
        assert isinstance(opened.path, Path)
        request = self._request = ShareRequest(form, str(opened.path), opened.title, opened.path.parent, self.stale)
        request.begin_with(window.preferences.last_share(form, request.source))
        ask_share(window.dialogs, request, words, self._share)

    def _share(self, request: ShareRequest) -> None:
        window = self._window
        window.exports.share(request)
        window.preferences.shared(request.form, request.source, request.kept())
        window.preferences.save()
        window.workspace.note(f"Share: writing {request.path}")

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
        ask_serve(window.dialogs, share_words(size, "serve"), self.stale, partial(self._start, str(opened.path)))

    def _start(self, source: str, https: bool) -> None:
        try:
            self._window.serving.start(source, https)
        except OSError as error:
            self._window.notices.show(str(error), bad=True, topic="serve")

    def stop(self) -> None:
        """Stop serving."""
        self._window.serving.stop()

    def _started(self) -> None:
        window = self._window
        window.notices.clear("serve")
        if window.serving.address and not window.dialogs.name:  # what is being typed elsewhere must not be lost
            show_serving(window.dialogs, window.serving, self.stop)

    def _show_stale(self) -> None:
        """Show in the open dialog whether the stream is up to date."""
        words = self.stale
        if self._request is not None:
            self._request.stale = words
        show_stale(self._window.dialogs, words)

    @property
    def stale(self) -> str | None:
        """See `stale_words`; None for a stream without a take."""
        workspace = self._window.workspace
        if workspace.take is None:
            return None
        bake = workspace.assessment.stages.get("bake")
        return stale_words(bake, workspace.checked, workspace.unreadable)

    def _size(self) -> ShareSize | None:
        """What sharing takes; None, and a message, if there is nothing to share."""
        window = self._window
        opened = window.player.opened
        if opened is None or not isinstance(opened.path, Path):
            window.notices.show("Open a take or a stream of this machine first.")
            return None
        try:
            size = share_size(str(opened.path))
        except (StudioError, OSError) as error:
            window.notices.show(str(error), bad=True, topic="share")
            return None
        window.notices.clear("share")
        return size
