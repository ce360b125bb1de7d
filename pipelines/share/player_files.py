"""The built browser player: its page and its scripts."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from v3studio.studio.errors import StudioError

SCRIPT_NAME, FIRST_NAME, REVIEW_NAME = "v3-player.js", "v3-first.js", "v3-review.js"
CAST_SCRIPT = "v3-cast.js"
REST_PREFIX = "v3-rest-"
"""The beginning of the name of the part that the first one fetches once there is an image."""


@dataclass(frozen=True)
class PlayerFiles:
    """The player's files. `script`: all of it, for pages of one file. `review`: what only `v3studio serve --review`
    adds to the page, a JavaScript module. `cast`: the script of a cast's page. `parts`: the script in two parts, by
    their names; pages on servers load the first, which loads the other."""

    page: str
    script: bytes
    review: bytes
    cast: bytes
    parts: Mapping[str, bytes]

    def hashed(self, review: bool = False) -> dict[str, bytes]:
        """The scripts that a page loads, by hashed names: caches may keep them for good, as new ones have new names."""
        scripts = dict(self.parts) | ({REVIEW_NAME: self.review} if review else {})
        # The first part has the name of the other, which already has its hash.
        named = lambda name, data: name if name.startswith(REST_PREFIX) else hashed_name(name, data)  # noqa: E731
        return {named(name, data): data for name, data in scripts.items()}

    @property
    def size(self) -> int:
        """Bytes of page and script, which every share has."""
        return len(self.page.encode()) + len(self.script)


def player_folder() -> Path:
    """Folder of the built player: package data of `v3studio`, which is located, but not imported, from here.
    FileNotFoundError if it is not installed."""
    spec = find_spec("v3studio")
    if spec is None or spec.origin is None:
        raise FileNotFoundError("the package v3studio is not installed")
    return Path(spec.origin).parent / "player"


def read_player() -> PlayerFiles:
    """The player that is part of this installation."""
    try:
        folder = player_folder()
        return PlayerFiles(
            (folder / "index.html").read_text(encoding="utf-8"),
            (folder / SCRIPT_NAME).read_bytes(),
            (folder / REVIEW_NAME).read_bytes(),
            (folder / CAST_SCRIPT).read_bytes(),
            {path.name: path.read_bytes() for path in (folder / FIRST_NAME, *folder.glob(f"{REST_PREFIX}*.js"))},
        )
    except OSError as error:
        raise StudioError("share.no_player", "the browser player is not built", fix="Run `make web`.") from error


def hashed_name(name: str, data: bytes) -> str:
    """`name` with 10 hex digits of the content's SHA-256 before the extension."""
    stem, dot, ending = name.rpartition(".")
    return f"{stem}.{hashlib.sha256(data).hexdigest()[:10]}{dot}{ending}"
