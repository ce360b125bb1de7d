"""Shares as chosen in a dialog, and what they take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gui.presenters.run.target import NamedTarget
from pipelines.share import MAX_SINGLE_FILE_BYTES, ShareSize

FORMS: dict[str, tuple[str, str]] = {
    "folder": ("Folder for a web server", "-share"),
    "single-file": ("Single HTML file", ".html"),
}
"""Forms of a share: label, and what its name ends in."""

PHONES = {
    "folder": "Upload the folder to any web server; it works below any path.\n"
    "Phones decode fastest, and check what they receive, from https:// addresses.",
    "single-file": "Opens in a desktop browser from the disk. Phones seldom open HTML files\n"
    "that were sent to them: share a folder for phones, or serve it.",
}
"""What whoever watches needs."""

PHONES_SERVE = (
    "The phone must be in the same network, and this machine's firewall must let it in.\n"
    "With https, the phone warns of the certificate, which is made for this time only:\n"
    "compare the fingerprint. Without, it decodes slower and does not check what it receives."
)
"""The same, where this machine serves."""


@dataclass
class ShareRequest(NamedTarget):
    """A share as chosen in the dialog, text as typed.

    Attributes:
        form: of `FORMS`.
        source: folder of a take or a stream.
        name: its name; that of what is written begins with it.
        folder: where to write to at first.
        title, credits, license, address: as in `pipelines.share.PageText`; empty ones are the stream's own.
    """

    form: str
    source: str
    name: str
    folder: Path
    title: str = ""
    credits: str = ""
    license: str = ""
    address: str = ""
    _target: str = ""

    @property
    def usual_name(self) -> str:
        """Named after what is shared."""
        return f"{self.name}{FORMS[self.form][1]}"

    def arguments(self) -> list[str]:
        """For `v3studio share`."""
        found = [self.source, "--out", str(self.path), "--json"]
        if self.form == "single-file":
            found.append("--single-file")
        texts = {"title": self.title, "credits": self.credits, "license": self.license, "address": self.address}
        for name, text in texts.items():
            if text.strip():
                found.append(f"--{name}={text.strip()}")
        return found


def size_words(size: ShareSize, form: str) -> str:
    """What a share takes, as a sentence; `form` is of `FORMS`, or "serve"."""
    parts = f"{size.frames} frames, {size.seconds:.1f} s: stream {megabytes(size.stream_bytes)}"
    if form == "single-file":
        if not size.single_file_possible:
            most = megabytes(MAX_SINGLE_FILE_BYTES)
            return f"{parts}. A single file holds {most} at most; share a folder instead."
        return f"{parts}, the file about {megabytes(size.single_file_bytes)}."
    player = f"{parts}, player {megabytes(size.player_bytes)}"
    return f"{player}." if form == "serve" else f"{player}, and a poster."


def megabytes(count: int) -> str:
    """Bytes in words, in megabytes of 10^6 bytes."""
    return f"{count / 1e6:.1f} MB" if count >= 100_000 else f"{count / 1e3:.1f} kB"
