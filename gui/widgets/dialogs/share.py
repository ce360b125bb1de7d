"""Dialogs of the menu Share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from open3d.visualization import gui

from gui.drawing.palette import DIM, FAIR
from gui.models.take.serving import Serving
from gui.models.take.shares import FORMS, PHONES, PHONES_SERVE, ShareRequest
from gui.widgets.dialogs.base import Answer, Dialogs, broken, filled
from gui.widgets.dialogs.folder import ask_path
from gui.widgets.dialogs.options import Form, refusal
from gui.widgets.picture import PictureWidget, color
from pipelines.share.addresses import qr_pixels
from studio.errors import StudioError

STALE_LINES = 4
"""Lines of the warning that the stream is out of date."""

QR_SIZE = 22
"""Largest width of the QR code, in font sizes."""


def ask_share(
    dialogs: Dialogs, request: ShareRequest, size: str, start: Callable[[ShareRequest], None], error: str = ""
) -> None:
    """Title, credits, license, output path.

    Args:
        dialogs: where it is shown.
        request: the defaults; modified while the dialog is open.
        size: what the share takes, a sentence.
        start: called by "Share". If it raises StudioError or OSError, the dialog says why and keeps what was typed.
        error: why sharing was refused.
    """
    dialogs.widgets = {}
    form = Form(dialogs, request)
    form.line("title", "Title")
    form.line("credits", "Credits")
    form.line("license", "License")
    if request.form == "folder":
        form.line("address", "Address, if known")
    target = gui.TextEdit()
    target.text_value = request.target
    target.set_on_text_changed(request.set_target)

    def browse() -> None:
        def again() -> None:
            ask_share(dialogs, request, size, start)

        def done(folder: str) -> None:
            request.move_to(Path(folder))
            again()

        ask_path(dialogs, "Output folder", Path(request.target).parent, "folder", done, again)

    def write() -> None:
        try:
            start(request)
        except (StudioError, OSError) as refused:
            ask_share(dialogs, request, size, start, str(refused))
        else:
            dialogs.close()

    def go() -> None:
        try:
            replaces = request.replaces
        except OSError as refused:
            words = f"The output cannot have this name: {refused.strerror}. Choose another one."
            ask_share(dialogs, request, size, start, words)
            return
        if not replaces:
            write()
            return
        dialogs.ask(
            "Replace the earlier share?",
            f"{request.path}\nis there already. If it is an earlier share, it is replaced; anything else is refused.",
            [
                ("replace", "Replace", write),
                ("back", "Choose another name", lambda: ask_share(dialogs, request, size, start)),
                ("close", "Cancel", lambda: None),
            ],
        )

    form.output(target, browse)
    parts: list[gui.Widget] = [
        form.grid,
        dialogs.label(size, dim=False),
        dialogs.label(PHONES[request.form]),
        *stale_parts(dialogs, request.stale),
    ]
    if error:
        parts.append(refusal(dialogs, error))
    answers: list[Answer] = [("save", "Share", go), ("close", "Cancel", dialogs.close)]
    dialogs.show("share", f"Share: {FORMS[request.form][0]}", parts, answers, 90, go)
    dialogs.widgets |= {**form.widgets, "line": target}
    first = form.widgets["title"]
    assert isinstance(first, gui.TextEdit)
    dialogs.focus(first)


def stale_parts(dialogs: Dialogs, words: str | None) -> list[gui.Label]:
    """Whether the stream is up to date, with room for what may be found out later; none without a take."""
    if words is None:
        return []
    dialogs.widgets["stale"] = label = gui.Label("")
    show_stale(dialogs, words)
    return [label]


def show_stale(dialogs: Dialogs, words: str | None) -> bool:
    """Change what the open dialog says of it, if it does; returns whether it has changed. `words` as of
    `stale_parts`."""
    label = dialogs.widgets.get("stale")
    if words is None or not isinstance(label, gui.Label):
        return False
    lines = broken(words or "The stream is up to date.").splitlines()[:STALE_LINES]
    text = "\n".join(filled(lines, STALE_LINES))
    changed = bool(label.text != text)
    label.text, label.text_color = text, color(FAIR if words else DIM)
    return changed


def ask_serve(dialogs: Dialogs, size: str, stale: str | None, start: Callable[[bool], None]) -> None:
    """Whether to encrypt.

    Args:
        dialogs: where it is shown.
        size: what a phone will fetch, a sentence.
        stale: why the stream is not up to date, or not known to be; "" if it is, None if it is of no take.
        start: called by "Serve" with the choice, after the dialog has closed.
    """
    dialogs.widgets = {}
    https = gui.Checkbox("https")
    https.checked = True

    def go() -> None:
        chosen = bool(https.checked)
        dialogs.close()
        start(chosen)

    parts: list[gui.Widget] = [
        dialogs.label(size, dim=False),
        dialogs.label(PHONES_SERVE),
        *stale_parts(dialogs, stale),
        https,
    ]
    answers: list[Answer] = [("save", "Serve", go), ("close", "Cancel", dialogs.close)]
    dialogs.show("serve", "Serve to phones", parts, answers, 80, go)
    dialogs.widgets["https"] = https


def show_serving(dialogs: Dialogs, serving: Serving, stop: Callable[[], None]) -> None:
    """The address and its QR code.

    Args:
        dialogs: where it is shown.
        serving: what is served, at a known address.
        stop: called by "Stop serving", after the dialog has closed.
    """
    dialogs.widgets = {}

    def end() -> None:
        dialogs.close()
        stop()

    picture = PictureWidget()
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
    answers: list[Answer] = [("close", "Hide", dialogs.close), ("stop", "Stop serving", end)]
    dialogs.show("serving", "Serving", parts, answers, 60, dialogs.close)
    dialogs.widgets["qr"] = picture.widget
