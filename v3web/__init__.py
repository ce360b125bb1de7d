"""The built browser player as package data: what `make web` makes of `web/`, so that nobody who installs needs Node."""

from __future__ import annotations

from pathlib import Path


def player_folder() -> Path:
    """Folder of the built player: index.html, v3-player.js and THIRD_PARTY_LICENSES.txt.

    Raises:
        FileNotFoundError: the player was not built (a source checkout before `make web`).
    """
    folder = Path(__file__).parent / "player"
    if not (folder / "index.html").is_file():
        raise FileNotFoundError(f"The browser player is not built ({folder} is missing); run `make web`.")
    return folder
