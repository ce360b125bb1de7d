"""What the menu Share does, and its dialogs."""

from pathlib import Path

from open3d.visualization import gui

from gui.drawing.palette import DIM, FAIR
from gui.models.loop import later
from gui.models.take.shares import FORMS, PHONES, PHONES_SERVE, ShareRequest, share_words, stale_words
from gui.shell import Shell
from gui.widgets.dialogs.base import in_lines
from gui.widgets.dialogs.form import Form
from gui.widgets.picture import ImagePanel, color
from pipelines.share.addresses import qr_pixels
from pipelines.share.sharing import ShareSize, share_size
from studio.errors import StudioError

STALE_LINES = 4  # lines of the warning that the stream is out of date
QR_SIZE = 22  # largest width of the QR code, in font sizes


class ShareActions:
    """See the module; it acts through the main window."""

    def __init__(self, window: Shell) -> None:
        self._window = window
        window.workspace.changed.connect(self._show_stale)
        window.serving.started.connect(later(self._started))
        window.serving.failed.connect(self._failed)

    def ask(self, form: str) -> None:
        """Ask for the options, then share. `form` is a key of `FORMS`."""
        window = self._window
        size = self._size()
        if size is None:
            return
        words = share_words(size, form)
        impossible = form == "single-file" and not size.single_file_possible
        if not window.notices.outcome(form, words if impossible else ""):
            return
        opened = window.player.opened
        assert opened is not None
        assert isinstance(opened.path, Path)
        request = ShareRequest(form, str(opened.path), opened.title, opened.path.parent)
        request.begin_with(window.preferences.last_share(form, request.source))
        self._ask(request, words)

    def _ask(self, request: ShareRequest, size: str, error: str = "") -> None:
        """Ask for title, credits, license and output path. `size`: what it takes; `error`: why it was refused."""
        dialogs = self._window.dialogs

        def again(error: str = "") -> None:
            self._ask(request, size, error)

        def write() -> None:
            try:
                self._share(request)
            except (StudioError, OSError) as refused:
                again(str(refused))
            else:
                dialogs.close()

        def go() -> None:
            try:
                replaces = request.replaces
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

        dialogs.widgets = {}
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
            self._show_serving()
            return
        size = self._size()
        if size is None:
            return
        assert opened is not None
        self._ask_serve(share_words(size, "serve"), str(opened.path))

    def _ask_serve(self, size: str, source: str) -> None:
        """Ask whether to encrypt; `size`: what a phone will fetch, a sentence."""
        dialogs = self._window.dialogs
        dialogs.widgets = {}
        https = gui.Checkbox("https")
        https.checked = True
        serve = dialogs.closing(lambda: self._start(source, bool(https.checked)))
        parts = [dialogs.label(size, dim=False), dialogs.label(PHONES_SERVE), *self._stale_parts(), https]
        answers = [("save", "Serve", serve), ("close", "Cancel", dialogs.close)]
        dialogs.show("serve", "Serve to phones", parts, answers, 80, serve)
        dialogs.widgets["https"] = https

    def _start(self, source: str, https: bool) -> None:
        with self._window.notices.reporting("serve"):
            self._window.serving.start(source, https)

    def stop(self) -> None:
        self._window.serving.stop()

    def _started(self) -> None:
        window = self._window
        window.notices.clear("serve")
        if window.serving.address and not window.dialogs.name:  # what is being typed elsewhere must not be lost
            self._show_serving()

    def _failed(self, why: str) -> None:
        if self._window.dialogs.name == "serving":
            self._window.dialogs.close()
        self._window.notices.show(why, bad=True, topic="serve")

    def _show_serving(self) -> None:
        """Show the address and its QR code."""
        dialogs, serving = self._window.dialogs, self._window.serving
        dialogs.widgets = {}
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
        answers = [("close", "Hide", dialogs.close), ("stop", "Stop serving", dialogs.closing(self.stop))]
        dialogs.show("serving", "Serving", parts, answers, 60, dialogs.close)
        dialogs.widgets["qr"] = picture.widget

    def _stale_parts(self) -> list[gui.Label]:
        """Whether the stream is up to date, with room for what may be found out later; none without a take."""
        if self.stale is None:
            return []
        self._window.dialogs.widgets["stale"] = label = gui.Label("")
        self._show_stale()
        return [label]

    def _show_stale(self) -> None:
        """Show in the open dialog whether the stream is up to date."""
        words, label = self.stale, self._window.dialogs.widgets.get("stale")
        if words is None or label is None:
            return
        label.text = in_lines(words or "The stream is up to date.", STALE_LINES)
        label.text_color = color(FAIR if words else DIM)

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
        with window.notices.reporting("share"):
            return share_size(str(opened.path))
        return None
