"""NewTake: creates a take from a folder of footage."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gui.models.stages import camera_file_text
from pipelines.config import Config, dump_config, load_config
from pipelines.config.presets import PRESETS, preset_here, with_values
from pipelines.takes.atomic_files import disk_errors, write_text
from pipelines.takes.drawn_masks import for_another_take
from pipelines.takes.take import Take
from studio.counts import counted
from studio.errors import StudioError
from studio.storage import is_address

MOST_FPS = 10_000
"""Limit of `capture.fps`."""


@dataclass(frozen=True)
class Found:
    """What is known about the footage.

    Attributes:
        words: a description, one sentence per line; or the error message.
        fps: frames per second that the files or the settings give; None if neither does, so that it may be typed.
    """

    words: str
    fps: float | None = None


@dataclass
class NewTake:
    """A new take as specified in the dialog; text as typed.

    Attributes:
        footage: footage folder or its address in object storage; may be empty if the settings name it.
        settings: YAML file with settings; empty for the preset for this machine.
        take: folder of the new take; empty for `proposed_take`.
        fps: frames per second, where the footage gives none; empty for that of the settings.
    """

    footage: str = ""
    settings: str = ""
    take: str = ""
    fps: str = ""

    def config(self) -> Config:
        """The initial settings of the take.

        Raises:
            StudioError: `take.no_footage`, `take.bad_rate`, `footage.no_folder`, or settings that cannot be read.
        """
        rate = self._rate()
        config = self._chosen()
        return config if rate is None else with_values(config, {"capture.fps": rate})

    def _rate(self) -> float | None:
        """Frames per second, as typed."""
        typed = self.fps.strip()
        if not typed:
            return None
        try:
            rate = float(typed)
        except ValueError:
            rate = 0.0
        if not 0 < rate < MOST_FPS:
            raise StudioError(
                "take.bad_rate",
                f"'{typed}' is not a frame rate",
                value=typed,
                fix=f"Type frames per second above 0 and below {MOST_FPS}, such as 25.",
            )
        return rate

    def _chosen(self) -> Config:
        """The settings without the frame rate that was typed."""
        if not self.footage.strip() and not self.settings.strip():
            raise StudioError("take.no_footage", "no footage selected", fix="Choose the footage folder.")
        overrides = []
        if self.footage.strip():
            overrides.append(("capture.root", _footage_folder(self.footage.strip())))
        if self.settings.strip():
            path = Path(self.settings.strip()).expanduser()
            return for_another_take(load_config(path, overrides), path)
        return with_values(load_config(None, overrides), PRESETS[preset_here()])

    def found(self) -> Found:
        """What is known about the footage, or why it cannot be read."""
        from studio.capture import open_footage

        try:
            config = self.config()
            footage = open_footage(config.capture, None, strict=False)
            cameras = camera_file_text(footage)
        except StudioError as error:
            return Found(str(error))
        if not self.settings.strip():
            cameras += f" The preset is {preset_here()}."
        found = [*footage.problems, *footage.warnings]
        problems = f"\n{counted(len(found), 'problem')}: {found[0]}" if found else ""
        given = (None if self.fps.strip() else config.capture.fps) or footage.filmed_fps  # as `open_footage`
        return Found(f"{footage.description}\n{cameras}{problems}", given)

    def proposed_take(self) -> str:
        """Path of a new folder next to the footage; in the working directory if the footage is in object storage."""
        try:
            root = self._chosen().capture.root
        except StudioError:
            return ""
        parent = Path.cwd() if is_address(root) else root.parent
        for number in range(1, 1000):
            path = parent / f"{root.name}-take{'' if number == 1 else f'-{number}'}"
            if not path.exists():
                return str(path)
        return ""

    def create(self) -> Path:
        """Create the take's folder and its settings; return the folder.

        Raises:
            StudioError: `take.exists`, `take.no_folder`, or footage or settings that cannot be read.
        """
        from studio.capture import open_footage

        config = self.config()
        open_footage(config.capture, None, strict=False)
        where = self.take.strip() or self.proposed_take()
        if not where:
            raise StudioError("take.no_folder", "no take folder selected", fix="Choose a folder for the take.")
        if is_address(where):
            raise StudioError(
                "take.no_folder",
                "a new take needs a folder on this machine",
                fix="Choose one; `v3studio run CONFIG --take ADDRESS` makes takes in object storage.",
            )
        root = Path(where).expanduser().absolute()
        if (root / "take.json").exists():
            raise StudioError("take.exists", "already a take", file=root, fix="Open it, or choose another folder.")
        with disk_errors(root):
            take = Take.create(root)
            write_text(take.config, dump_config(config))
        return take.root


def _footage_folder(typed: str) -> str:
    if is_address(typed):
        return typed
    folder = Path(typed).expanduser().absolute()
    if not folder.is_dir():
        raise StudioError("footage.no_folder", "no such folder", file=folder, fix="Choose the footage folder.")
    return str(folder)


def sample_settings() -> Path | None:
    """Settings of the sample capture, which comes with the source; None if it is neither where this program is nor in
    the working directory."""
    for folder in (Path(__file__).parents[3], Path.cwd()):
        settings = folder / "sample_configs" / "demo.yaml"
        if settings.is_file() and (folder / "sample_captures" / "walk16").is_dir():
            return settings
    return None


def sample_take() -> Path:
    """Folder of the take that the start page makes of it."""
    return Path.home() / "v3studio-takes" / "sample-take"


def make_sample_take() -> tuple[Path, bool]:
    """Create the take, unless it is there. Returns its folder, and whether it is new.

    Raises:
        StudioError: `take.no_sample`, or the folder cannot be written.
    """
    take = sample_take()
    if (take / "take.json").is_file():
        return take, False
    settings = sample_settings()
    if settings is None:
        raise StudioError(
            "take.no_sample",
            "the sample capture is not there: only the source of V3 Studio has it",
            fix="Start the window from a copy of the source, or use your own footage.",
        )
    return NewTake(settings=str(settings), take=str(take)).create(), True
