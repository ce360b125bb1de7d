"""The menu Share and its dialogs."""

from copy import copy
from pathlib import Path

from open3d.visualization import gui

from v3studio.gui.drawing.palette import DIM, FAIR
from v3studio.gui.models.loop import later
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.exports import Exports
from v3studio.gui.models.take.serving import Serving
from v3studio.gui.models.take.shares import FORMS, PHONES, PHONES_SERVE, ShareRequest, share_words, stale_words
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.widgets.dialogs.base import Dialogs, in_lines
from v3studio.gui.widgets.dialogs.form import Form
from v3studio.gui.widgets.picture import ImagePanel, color
from v3studio.pipelines.share.addresses import qr_pixels
from v3studio.pipelines.share.sharing import ShareSize, share_size
from v3studio.studio.errors import StudioError

STALE_LINES = 4  # lines of the warning that the stream is out of date
QR_SIZE = 22  # largest width of the QR code, in font sizes


class ShareActions:
    """Shares and serves the open take or stream, after asking how."""

    def __init__(
        self, player: PlayerPresenter, workspace: Workspace, exports: Exports, serving: Serving, dialogs: Dialogs,
        notices: Notices,
    ) -> None:  # fmt: skip
        self._player, self._workspace, self._exports, self._serving = player, workspace, exports, serving
        self._dialogs, self._notices = dialogs, notices
        workspace.changed.connect(self._show_stale)
        serving.started.connect(later(self._started))
        serving.failed.connect(self._failed)

    def ask(self, form: str) -> None:
        """Ask for the options, then share. `form` is a key of `FORMS`."""
        size = self._size()
        if size is None:
            return
        words = self._words(size, form)
        impossible = form == "single-file" and not size.single_file_possible
        if not self._notices.outcome(form, words if impossible else ""):
            return
        opened = self._player.opened
        assert opened is not None
        assert isinstance(opened.path, Path)
        source = str(opened.path)
        first = ShareRequest(form, source, opened.title, opened.path.parent)
        self._ask(copy(self._exports.shares.get((form, source), first)), words)

    def _ask(self, request: ShareRequest, size: str, error: str = "") -> None:
        """Ask for title, credits, license and output path. `size`: what it takes; `error`: why it was refused."""
        dialogs = self._dialogs

        def again(error: str = "") -> None:
            self._ask(request, size, error)

        def write() -> None:
            try:
                self._exports.share(request)
            except (StudioError, OSError) as refused:
                again(str(refused))
                return
            self._exports.shares[request.form, request.source] = request
            self._workspace.note(f"Share: writing {request.path}")
            dialogs.close()

        def go() -> None:
            try:
                replaces = request.path.exists()
            except OSError as refused:
                again(f"The output cannot have this name: {refused.strerror}. Choose another one.")
                return
            if not replaces:
                write()
                return
            dialogs.ask(
                "Replace the earlier share?",
                f"{request.path}\nalready exists. It is replaced only if it is an earlier share.",
                [
                    ("replace", "Replace", write),
                    ("back", "Choose another name", again),
                    ("close", "Cancel", lambda: None),
                ],
            )

        form = Form(dialogs, request)
        form.line("title", "Title")
        form.line("credits", "Credits")
        form.line("license", "License")
        if request.form == "folder":
            form.line("address", "Web address, if known")
        form.output(again)
        words = [dialogs.label(size, dim=False), dialogs.label(PHONES[request.form]), *self._stale_parts()]
        title = f"Share: {FORMS[request.form][0]}"
        form.show("share", title, [form.grid, *words], ("save", "Share", go), 90, error, "title")

    def serve(self) -> None:
        """Ask whether to encrypt, then serve; if the take is served already, show its address."""
        opened, serving, dialogs = self._player.opened, self._serving, self._dialogs
        if serving.address and opened is not None and serving.source == str(opened.path):
            self._show_serving()
            return
        size = self._size()
        if size is None:
            return
        assert opened is not None
        source = str(opened.path)
        https = gui.Checkbox("https")
        https.checked = True

        def start() -> None:
            with self._notices.reporting("serve"):
                serving.start(source, bool(https.checked))

        go, words = dialogs.closing(start), self._words(size, "serve")
        parts = [dialogs.label(words, dim=False), dialogs.label(PHONES_SERVE), *self._stale_parts(), https]
        answers = [("save", "Serve", go), ("close", "Cancel", dialogs.close)]
        dialogs.show("serve", "Serve to phones", parts, answers, 80, go)
        dialogs.widgets["https"] = https

    def _started(self) -> None:
        self._notices.clear("serve")
        if self._serving.address and not self._dialogs.name:  # what is being typed elsewhere must not be lost
            self._show_serving()

    def _failed(self, why: str) -> None:
        if self._dialogs.name == "serving":
            self._dialogs.close()
        self._notices.show(why, bad=True, topic="serve")

    def _show_serving(self) -> None:
        dialogs, serving = self._dialogs, self._serving
        picture = ImagePanel()
        picture.show(qr_pixels(serving.address, int(QR_SIZE * dialogs.em)))
        row = gui.Horiz()
        row.add_stretch()
        row.add_child(picture.widget)
        row.add_stretch()
        parts: list[gui.Widget] = [row, dialogs.label(serving.address, dim=False)]
        if serving.fingerprint:
            half = len(serving.fingerprint) // 2 + 1
            words = f"{serving.fingerprint[:half]}\n{serving.fingerprint[half:]}"
            parts.append(dialogs.label(f"SHA-256 fingerprint of the certificate:\n{words}"))
        parts.append(dialogs.label("Scan the code with the phone's camera. Serving ends with the window."))
        answers = [("close", "Hide", dialogs.close), ("stop", "Stop serving", dialogs.closing(serving.stop))]
        dialogs.show("serving", "Serving", parts, answers, 60, dialogs.close)
        dialogs.widgets["qr"] = picture.widget

    def _stale_parts(self) -> list[gui.Label]:
        """Whether the stream is up to date, with room for what may be found out later; none without a take."""
        if self._workspace.take is None:
            return []
        self._dialogs.made["stale"] = label = gui.Label("")
        self._show_stale()
        return [label]

    def _show_stale(self) -> None:
        """Show in the open dialog whether the stream is up to date."""
        workspace, label = self._workspace, (self._dialogs.widgets | self._dialogs.made).get("stale")
        if workspace.take is None or label is None:
            return
        words = stale_words(workspace.assessment.stages.get("bake"), workspace.checked, bool(workspace.problem))
        label.text = in_lines(words or "The stream is up to date.", STALE_LINES)
        label.text_color = color(FAIR if words else DIM)

    def _words(self, size: ShareSize, form: str) -> str:
        """Return what is shared, and how large it is."""
        words, other = share_words(size, form), self._player.shown_other
        return words if other is None else f"{words}\nThis is the open take's stream, not {other.label} on the screen."

    def _size(self) -> ShareSize | None:
        """Return how large the share will be; None, and a message, if there is nothing to share."""
        opened = self._player.opened
        if opened is None or not isinstance(opened.path, Path):
            self._notices.show("Open a take or a stream of this machine first.")
            return None
        with self._notices.reporting("share"):
            return share_size(str(opened.path))
        return None
