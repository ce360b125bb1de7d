"""Shares as chosen in a dialog, and what they take."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from v3studio.gui.drawing.palette import State
from v3studio.gui.models.take.page_words import why_not_done
from v3studio.pipelines.runs.staleness import StageStatus
from v3studio.pipelines.share.sharing import MAX_SINGLE_FILE_BYTES, SINGLE_FILE_ENDINGS, ShareSize
from v3studio.studio.counts import counted, size_words

FORMS: dict[str, tuple[str, str]] = {  # label, and what the name of the file or folder ends in
    "folder": ("Folder for a web server", "-share"),
    "single-file": ("Single HTML file", ".html"),
}

PHONES = {  # what viewers need
    "folder": "Upload the folder to any web server, under any path.\n"
    "Phones decode fastest, and check what they receive, from https:// addresses.",
    "single-file": "Opens in a desktop browser from the disk. Phones seldom open HTML files\n"
    "that were sent to them: share a folder for phones, or serve it.",
}

PHONES_SERVE = (  # the same, where this machine serves
    "The phone must be on the same network, and this machine's firewall must let it in.\n"
    "With https, the phone warns about the certificate, which is new each time: compare its\n"
    "fingerprint. Without https, it decodes more slowly and does not check what it receives."
)


class NamedTarget(ABC):
    """Base of the requests of dialogs with a field for the target. `done`: what it is called afterwards; `stays`:
    whether the notice that it is done stays until it is dismissed."""

    does: ClassVar[str] = "Export"
    done: ClassVar[str] = "Written"
    stays: ClassVar[bool] = False
    folder: Path
    _target: str

    @property
    @abstractmethod
    def usual_name(self) -> str:
        """File or folder name until another one is typed."""

    @property
    def target(self) -> str:
        """File or folder to write; named by `usual_name` until another name is typed."""
        return self._target or str(self.folder / self.usual_name)

    @property
    def ending(self) -> str | None:
        """Return what the name of a file must end in; "" for a folder; None: anything."""
        return None

    @property
    def path(self) -> Path:
        """`target`, absolute, with `ending`: by its name, the command tells a file from a folder."""
        path, ending = Path(self.target.strip()).expanduser().absolute(), self.ending
        if ending:
            return path if path.suffix.lower() == ending else path.with_name(path.name + ending)
        return path.with_suffix("") if ending == "" and path.suffix.lower() in SINGLE_FILE_ENDINGS else path

    def set_target(self, text: str) -> None:
        self._target = "" if text.strip() == self.target else text

    def move_to(self, folder: Path) -> None:
        """Write to another folder under the same name."""
        if self._target:
            self._target = str(folder / Path(self._target.strip()).name)
        self.folder = folder


@dataclass
class ShareRequest(NamedTarget):
    """A share as chosen in the dialog, text as typed; empty texts are the stream's own (see `PageText`)."""

    does: ClassVar[str] = "Share"
    done: ClassVar[str] = "Shared"
    stays: ClassVar[bool] = True
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

    @property
    def ending(self) -> str | None:
        return ".html" if self.form == "single-file" else ""

    def arguments(self) -> list[str]:
        """Arguments of `v3studio share`."""
        arguments = [self.source, "--out", str(self.path), "--overwrite", "--json"]
        for name in ("title", "credits", "license", "address"):
            text = getattr(self, name)
            if text.strip():
                arguments.append(f"--{name}={text.strip()}")
        return arguments


def share_words(size: ShareSize, form: str) -> str:
    """The size of a share, as a sentence; `form` is of `FORMS`, or "serve"."""
    parts = f"{counted(size.frames, 'frame')}, {size.seconds:.1f} s: stream {size_words(size.stream_bytes)}"
    if form == "single-file":
        if not size.single_file_possible:
            most = size_words(MAX_SINGLE_FILE_BYTES)
            return f"{parts}. A single file holds {most} at most; share a folder instead."
        return f"{parts}, the file about {size_words(size.single_file_bytes)}."
    player = f"{parts}, player {size_words(size.player_bytes)}"
    return f"{player}." if form == "serve" else f"{player}, and a poster."


def stale_words(bake: StageStatus | None, checked: bool, unreadable: bool) -> str:
    """A warning about a take's stream that is shared; "" if it is up to date."""
    if unreadable:
        return "Whether the stream is up to date is not known: the take's settings or its status cannot be read."
    if not checked:
        return "Checking whether the stream is up to date ..."
    if bake is None or bake.state == State.DONE:
        return ""
    why = "" if bake.needs else f": {why_not_done(bake)}".rstrip(" :.")  # Bake runs what it needs
    return f"The stream is out of date{why}.\nTo share the take as it is set now, cancel and run Bake first."
