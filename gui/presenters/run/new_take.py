"""NewTake: creates a take from a folder of footage."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from pipelines.config import Config, dump_config, load_config
from pipelines.stages.camera_file import camera_file
from pipelines.takes.atomic_files import disk_errors, write_text
from pipelines.takes.take import Take
from studio.errors import StudioError
from studio.storage import is_address


@dataclass
class NewTake:
    """A new take as specified in the dialog; text as typed.

    Attributes:
        footage: footage folder or its address in object storage; may be empty if the settings name it.
        settings: YAML file with settings; empty for the defaults.
        take: folder of the new take; empty for `proposed_take`.
    """

    footage: str = ""
    settings: str = ""
    take: str = ""

    def config(self) -> Config:
        """The initial settings of the take.

        Raises:
            StudioError: `take.no_footage`, `footage.no_folder`, or settings that cannot be read.
        """
        if not self.footage.strip() and not self.settings.strip():
            raise StudioError("take.no_footage", "no footage selected", fix="Choose the footage folder.")
        overrides = []
        if self.footage.strip():
            overrides.append(("capture.root", _footage_folder(self.footage.strip())))
        path = Path(self.settings.strip()).expanduser() if self.settings.strip() else None
        return load_config(path, overrides)

    def found(self) -> str:
        """Description of the footage, one sentence per line; or the error message."""
        from studio.capture import open_footage

        try:
            config = self.config()
            footage = open_footage(config.capture, None, strict=False)
            rig = camera_file(footage.spec)  # of a capture in object storage, this has the folder on this machine
        except StudioError as error:
            return str(error)
        cameras = (
            f"Camera file: {os.path.relpath(rig, footage.spec.root)}."  # it may be beside the footage's folder
            if rig
            else "No camera file: Calibrate estimates the cameras."
        )
        problems = "" if not footage.problems else f"\n{len(footage.problems)} problems: {footage.problems[0]}"
        return f"{footage.description}\n{cameras}{problems}"

    def proposed_take(self) -> str:
        """Path of a new folder next to the footage; in the working directory if the footage is in object storage."""
        try:
            root = self.config().capture.root
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
