"""Shared folders that are mounted under different paths on different machines."""

from collections.abc import Mapping, Sequence
from pathlib import Path


def path_here(path: Path, paths: Mapping[str, Sequence[str]]) -> Path:
    """The path of a file or folder on this machine: the first of `places_to_look` that is there; `path` if none is."""
    return next((place for place in places_to_look(path, paths) if is_there(place)), path)


def is_there(place: Path) -> bool:
    """Return whether this file or folder exists and is not an empty folder, as that of a share that is not mounted
    is."""
    try:
        return place.is_file() or next(place.iterdir(), None) is not None
    except PermissionError:  # it exists; anyone who reads it says what is wrong
        return True
    except OSError:
        return False


def places_to_look(path: Path, paths: Mapping[str, Sequence[str]]) -> list[Path]:
    """The path itself, and the paths that it may have on other machines, the longest match first."""
    places = [path]
    for folder in sorted(paths, key=len, reverse=True):
        if path.is_relative_to(folder):
            places += [Path(other) / path.relative_to(folder) for other in paths[folder]]
    return places
