"""Path patterns with `{camera}` and `{frame}`: which file belongs to which camera and frame.

`{chapter}` stands for what distinguishes the files into which a camera splits one recording, in their order.
"""

import os
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from v3studio.studio.errors import StudioError

IMAGE_EXTENSIONS = frozenset({".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".exr", ".dpx"})
_OTHER_IMAGES = frozenset({".heic", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".jp2", ".tga", ".ppm", ".gif"})
VIDEO_EXTENSIONS = frozenset({".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v", ".mxf", ".ts", ".mpg", ".mpeg", ".wmv"})

_TOKEN = re.compile(r"\{camera\}|\{chapter\}|\{frame(?::0?(\d*)d)?\}|\*\*/|\*|\?|\{[^}]*\}")


@dataclass(frozen=True)
class Match:
    """A file that matches a pattern. Without `{frame}` in it, `frame` is None; without `{chapter}`, `chapter` is ""."""

    path: Path
    camera: str
    frame: int | None
    chapter: str = ""


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sort key that puts cam2 before cam10."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", name) if part]


def without_extension(path: str) -> str:
    """A path with forward slashes, without the extension of an image or video: `cam.0` stays as it is."""
    path = path.replace("\\", "/")
    head, dot, extension = path.rpartition(".")
    known = f".{extension.lower()}" in IMAGE_EXTENSIONS | VIDEO_EXTENSIONS | _OTHER_IMAGES
    return head if dot and known else path


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
        elif text in ("{camera}", "{chapter}") or text.startswith("{frame"):
            name = "frame" if text.startswith("{frame") else text[1:-1]
            width = token.group(1)
            body = "[^/]+?" if name != "frame" else rf"\d{{{width},}}" if width else r"\d+"
            parts.append(f"(?P={name})" if name in seen else f"(?P<{name}>{body})")
            seen.add(name)
        else:
            problem = f"Pattern '{whole}': unknown placeholder {text}"
            fix = "Use {camera}, {frame}, {frame:06d} or {chapter}."
            raise StudioError("footage.bad_pattern", problem, value=whole, fix=fix, placeholder=text)
    parts.append(re.escape(pattern[position:]))
    return re.compile("".join(parts))


def walk(folder: Path, depth: int) -> Iterator[str]:
    """Relative paths, with '/', of files up to `depth` folders below `folder`, sorted within each folder."""
    stack = [("", 0)]
    while stack:
        relative, level = stack.pop()
        try:
            entries = sorted(os.scandir(folder / relative if relative else folder), key=lambda entry: entry.name)
        except OSError as error:
            problem = f"cannot read the folder ({error.strerror})"
            raise StudioError("footage.folder_unreadable", problem, file=folder / relative) from None
        for entry in entries:
            path = f"{relative}/{entry.name}" if relative else entry.name
            if entry.is_dir():
                if level < depth and not entry.name.startswith("."):
                    stack.append((path, level + 1))
            elif not entry.name.startswith("."):
                yield path


def find_files(
    root: Path,
    pattern: str,
    extensions: Collection[str] = IMAGE_EXTENSIONS | VIDEO_EXTENSIONS,
    listing: Callable[[], Sequence[str]] | None = None,
) -> list[Match]:
    """All files below `root` that match `pattern`, sorted by camera and frame.

    Extensions are in lower case. `listing` returns the paths below `root`, at least as deep as the pattern, when
    several patterns are tried on the same folder; used if the pattern begins with a placeholder. StudioError:
    `footage.bad_pattern`: no `{camera}`, or an unknown placeholder; `footage.duplicate_file`: two files match the same
    camera and frame; `footage.folder_unreadable`.
    """
    if "{camera}" not in pattern:
        problem = f"Pattern '{pattern}' has no {{camera}}"
        fix = "Put {camera} where the path contains the camera's name, for example videos/{camera}.mp4."
        raise StudioError("footage.bad_pattern", problem, value=pattern, fix=fix, placeholder="{camera}")
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
    matches: dict[tuple[str, int | None, str], Match] = {}
    for relative in listing() if listing is not None and fixed == 0 and "**/" not in rest else walk(base, depth):
        match = expression.fullmatch(relative)
        if match is None or Path(relative).suffix.lower() not in extensions:
            continue
        groups = match.groupdict()
        frame = int(groups["frame"]) if groups.get("frame") is not None else None
        key = (groups["camera"], frame, groups.get("chapter") or "")
        path = base / relative
        if key in matches:
            what = f"camera '{key[0]}'" if frame is None else f"frame {frame} of camera '{key[0]}'"
            raise StudioError(
                "footage.duplicate_file",
                f"both this file and {matches[key].path} match {what}",
                file=path,
                value=pattern,
                fix=f"Remove or rename one of them, or narrow the pattern '{pattern}'.",
                camera=key[0],
                frame=frame,
                other=matches[key].path,
            )
        matches[key] = Match(path, *key)
    return sorted(
        matches.values(), key=lambda match: (natural_key(match.camera), match.frame or 0, natural_key(match.chapter))
    )


def number_ranges(numbers: list[int]) -> str:
    """Frame numbers as "3, 7-9, 12", cut after six ranges."""
    runs: list[tuple[int, int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1] = (runs[-1][0], number)
        else:
            runs.append((number, number))
    texts = [str(first) if first == last else f"{first}-{last}" for first, last in runs]
    if len(texts) > 6:
        return f"{', '.join(texts[:6])} and more ({len(numbers)} in total)"
    return ", ".join(texts)
