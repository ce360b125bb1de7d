"""The sample capture: where it is, and a take of it."""

from __future__ import annotations

from pathlib import Path

from gui.models.take.new_take import NewTake
from studio.errors import StudioError


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
