"""NewTake: from a folder of footage to a take that can be run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipelines.config import Config, dump_config, load_config
from pipelines.stages.camera_file import camera_file
from pipelines.takes.atomic_files import disk_errors, write_text
from pipelines.takes.take import Take
from studio.errors import StudioError


@dataclass
class NewTake:
    """What the operator has chosen so far, as typed.

    Attributes:
        footage: folder of the footage; may be empty where the settings name it.
        settings: YAML file with settings; empty for the defaults.
        take: folder of the take to make.
    """

    footage: str = ""
    settings: str = ""
    take: str = ""

    def config(self) -> Config:
        """The settings that the take begins with.

        Raises:
            StudioError: nothing chosen, or something that cannot be read.
        """
        if not self.footage.strip() and not self.settings.strip():
            raise StudioError("Choose the folder of the footage.")
        overrides = []
        if self.footage.strip():
            folder = Path(self.footage.strip()).expanduser().absolute()
            if not folder.is_dir():
                raise StudioError(f"{folder}: there is no such folder; choose the folder of the footage.")
            overrides.append(("capture.root", str(folder)))
        path = Path(self.settings.strip()).expanduser() if self.settings.strip() else None
        return load_config(path, overrides)

    def found(self) -> str:
        """What the footage is taken for, a sentence a line; or what is wrong."""
        from studio.capture import open_footage

        try:
            config = self.config()
            footage = open_footage(config.capture, None, strict=False)
            rig = camera_file(config.capture)
        except StudioError as error:
            return str(error)
        cameras = (
            f"Cameras from {rig.relative_to(config.capture.root)}." if rig else "Cameras are found from the footage."
        )
        problems = "" if not footage.problems else f"\n{len(footage.problems)} problems: {footage.problems[0]}"
        return f"{footage.description}\n{cameras}{problems}"

    def proposed_take(self) -> str:
        """A folder beside the footage that is not there yet."""
        try:
            root = self.config().capture.root
        except StudioError:
            return ""
        for number in range(1, 1000):
            path = root.parent / f"{root.name}-take{'' if number == 1 else f'-{number}'}"
            if not path.exists():
                return str(path)
        return ""

    def create(self) -> Path:
        """Make the take's folder with its settings; returns it.

        Raises:
            StudioError: footage or settings that cannot be read, or a folder that holds something else.
        """
        from studio.capture import open_footage

        config = self.config()
        open_footage(config.capture, None, strict=False)
        where = self.take.strip() or self.proposed_take()
        if not where:
            raise StudioError("Choose a folder for the take.")
        root = Path(where).expanduser().absolute()
        if (root / "take.json").exists():
            raise StudioError(f"{root} is a take already; open it, or choose another folder.")
        with disk_errors(root):
            take = Take.create(root)
            write_text(take.config, dump_config(config))
        return take.root
