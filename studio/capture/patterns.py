"""Paths with `{camera}` and `{frame}` in them: which files of a capture belong to which camera and frame."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from studio.errors import StudioError

IMAGE_EXTENSIONS = frozenset({".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp"})
VIDEO_EXTENSIONS = frozenset({".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v", ".mxf", ".ts", ".mpg", ".mpeg", ".wmv"})

_TOKEN = re.compile(r"\{camera\}|\{frame(?::0?(\d*)d)?\}|\*\*/|\*|\?|\{[^}]*\}")


@dataclass(frozen=True)
class Match:
    """One file that a pattern found. `frame` is None where the pattern has no `{frame}`."""

    path: Path
    camera: str
    frame: int | None


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sorts cam2 before cam10."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", name) if part]


def _expression(pattern: str, whole: str) -> re.Pattern[str]:
    parts: list[str] = []
    position = 0
    seen: set[str] = set()
    for token in _TOKEN.finditer(pattern):
        parts.append(re.escape(pattern[position : token.start()]))
        position = token.end()
        text = token.group()
        if text in ("*", "?"):
            parts.append("[^/]*" if text == "*" else "[^/]")
        elif text == "**/":
            parts.append("(?:[^/]+/)*")
        elif text == "{camera}" or text.startswith("{frame"):
            name = "camera" if text == "{camera}" else "frame"
            width = token.group(1)
            body = "[^/]+?" if name == "camera" else rf"\d{{{width},}}" if width else r"\d+"
            parts.append(f"(?P={name})" if name in seen else f"(?P<{name}>{body})")
            seen.add(name)
        else:
            raise StudioError(f"Pattern '{whole}': {text} is not known; use {{camera}}, {{frame}} or {{frame:06d}}.")
    parts.append(re.escape(pattern[position:]))
    return re.compile("".join(parts))


def _walk(folder: Path, depth: int) -> Iterator[str]:
    """Relative '/'-paths of the files at most `depth` folders below `folder`, sorted within each folder."""
    stack = [("", 0)]
    while stack:
        relative, level = stack.pop()
        try:
            entries = sorted(os.scandir(folder / relative if relative else folder), key=lambda entry: entry.name)
        except OSError as error:
            raise StudioError(f"The folder {folder / relative} cannot be read ({error.strerror}).") from None
        for entry in entries:
            path = f"{relative}/{entry.name}" if relative else entry.name
            if entry.is_dir():
                if level < depth and not entry.name.startswith("."):
                    stack.append((path, level + 1))
            elif not entry.name.startswith("."):
                yield path


def find_files(root: Path, pattern: str) -> list[Match]:
    """All image and video files below `root` that fit `pattern`, sorted by camera and frame.

    Args:
        root: the capture's folder.
        pattern: see `CaptureSettings`; must contain `{camera}`.

    Raises:
        StudioError: the pattern has no `{camera}` or an unknown placeholder; two files belong to the same camera and
            frame; the folder cannot be read.
    """
    if "{camera}" not in pattern:
        raise StudioError(f"Pattern '{pattern}': it must contain {{camera}}, which stands for a camera's name.")
    components = pattern.split("/")
    fixed = 0
    while fixed < len(components) - 1 and not _TOKEN.search(components[fixed] + "/"):
        fixed += 1
    base = root.joinpath(*(["/"] if pattern.startswith("/") else []), *[part for part in components[:fixed] if part])
    rest = "/".join(components[fixed:])
    expression = _expression(rest, pattern)
    if not base.is_dir():
        return []
    depth = 8 if "**/" in rest else rest.count("/")
    found: dict[tuple[str, int | None], Match] = {}
    for relative in _walk(base, depth):
        match = expression.fullmatch(relative)
        if match is None or Path(relative).suffix.lower() not in IMAGE_EXTENSIONS | VIDEO_EXTENSIONS:
            continue
        groups = match.groupdict()
        frame = int(groups["frame"]) if groups.get("frame") is not None else None
        key = (groups["camera"], frame)
        path = base / relative
        if key in found:
            what = f"camera '{key[0]}'" if frame is None else f"frame {frame} of camera '{key[0]}'"
            raise StudioError(
                f"Two files are {what}: {found[key].path} and {path}; remove or rename one, or narrow the pattern "
                f"'{pattern}'."
            )
        found[key] = Match(path, groups["camera"], frame)
    return sorted(found.values(), key=lambda match: (natural_key(match.camera), match.frame or 0))
