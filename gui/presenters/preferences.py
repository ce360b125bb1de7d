"""What the window remembers between sessions: recent takes and a few preferences, in the user's settings folder."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

from pipelines.takes.atomic_files import write_text

RECENT = 10

PICTURE_SIZES = {
    "640 x 360": 640 * 360,
    "960 x 540": 960 * 540,
    "1280 x 720": 1280 * 720,
    "as large as the view": 1 << 30,
}
BACKGROUND_NAMES = ("dark", "black", "white")


def preferences_path() -> Path:
    """Following the XDG base directory rules."""
    base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(base) / "v3studio" / "window.json"


@dataclass
class Preferences:
    """See the module.

    Attributes:
        picture_size: of `PICTURE_SIZES`: pictures of splats are drawn with at most so many pixels.
        background: of `BACKGROUND_NAMES`, on opening.
        play_on_opening: begin to play at once.
        recent: folders and addresses, newest first.
    """

    picture_size: str = "960 x 540"
    background: str = "dark"
    play_on_opening: bool = True
    recent: list[str] = field(default_factory=list)

    @classmethod
    def read(cls, path: Path | None = None) -> Preferences:
        """What was saved; the defaults for what was not, or cannot be read."""
        found = cls()
        with contextlib.suppress(OSError, ValueError, TypeError):
            values = json.loads((path or preferences_path()).read_text(encoding="utf-8"))
            for one in fields(cls):
                if isinstance(values.get(one.name), type(getattr(found, one.name))):
                    setattr(found, one.name, values[one.name])
        if found.picture_size not in PICTURE_SIZES:
            found.picture_size = cls.picture_size
        if found.background not in BACKGROUND_NAMES:
            found.background = cls.background
        found.recent = [str(name) for name in found.recent][:RECENT]
        return found

    def save(self, path: Path | None = None) -> bool:
        """Write them; False where the folder may not be written to, which is no reason to stop."""
        try:
            write_text(path or preferences_path(), json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n")
        except OSError:
            return False
        return True

    def opened(self, name: str) -> None:
        """Put a folder or an address first among the recent ones."""
        self.recent = [name, *(other for other in self.recent if other != name)][:RECENT]

    def recent_there(self) -> list[str]:
        """Of the recent ones those whose folder is still there, and all addresses."""
        return [name for name in self.recent if "://" in name or Path(name).is_dir()]
