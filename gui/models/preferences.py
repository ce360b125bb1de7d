"""Preferences and recent takes, saved in the user's configuration folder."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from v3studio.studio.atomic_files import write_text
from v3studio.studio.bounded_files import parse_json

RECENT = 10  # most opened takes that are kept

PICTURE_SIZES = {"640 x 360": 640 * 360, "960 x 540": 960 * 540, "1280 x 720": 1280 * 720, "viewport size": 1 << 30}
BACKGROUND_NAMES = ("dark", "black", "white")


def preferences_path() -> Path:
    """Following the XDG base directory rules."""
    base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(base) / "v3studio" / "window.json"


@dataclass
class Preferences:
    """The memory of the window for its user."""

    picture_size: str = "960 x 540"  # maximum resolution at which splats are rendered, a key of `PICTURE_SIZES`
    background: str = "dark"
    play_on_opening: bool = True
    panel_width: float = 18.0
    recent: list[str] = field(default_factory=list)  # folders, files and URLs, newest first
    folder: str = ""  # where a file or a folder was chosen last; "" if none was

    @classmethod
    def read(cls, path: Path | None = None) -> Preferences:
        """Read saved preferences; defaults for anything missing or invalid."""
        preferences = cls()
        with contextlib.suppress(OSError, ValueError, TypeError):
            saved = parse_json((path or preferences_path()).read_bytes())
            for attribute in fields(cls):
                if isinstance(saved.get(attribute.name), type(getattr(preferences, attribute.name))):
                    setattr(preferences, attribute.name, saved[attribute.name])
        if preferences.picture_size not in PICTURE_SIZES:
            preferences.picture_size = cls.picture_size
        if preferences.background not in BACKGROUND_NAMES:
            preferences.background = cls.background
        preferences.recent = [str(name) for name in preferences.recent][:RECENT]
        return preferences

    def save(self, path: Path | None = None) -> bool:
        """Save the preferences; False if the folder is not writable."""
        try:
            write_text(path or preferences_path(), json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n")
        except OSError:
            return False
        return True

    def keep(self, **values: Any) -> bool:
        """Set attributes, and save the preferences as `save`."""
        vars(self).update(values)
        return self.save()

    def opened(self, name: str) -> None:
        """Move a folder or URL to the front of the recent list."""
        self.recent = [name, *(other for other in self.recent if other != name)][:RECENT]
