"""Path patterns with `{camera}` and `{frame}`: which file belongs to which camera and frame.

`{chapter}` stands for what distinguishes the files into which a camera splits one recording, in their order, `{object}`
for what distinguishes the masks of several objects, and `{seconds}` for a time that says which frame it is.
"""

import itertools
import os
import re
import statistics
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError

IMAGE_EXTENSIONS = frozenset({".png", ".jpg", ".jpeg", ".webp", ".avif", ".tif", ".tiff", ".bmp", ".exr", ".dpx"})
_OTHER_IMAGES = frozenset({
    ".heic", ".heif", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf", ".jp2", ".jxl", ".tga", ".ppm",
    ".pgm", ".gif", ".psd", ".hdr",
})  # fmt: skip
_OTHER_VIDEOS = frozenset({".r3d", ".braw", ".insv", ".360", ".flv", ".f4v", ".y4m", ".yuv", ".rm", ".dav"})
OTHER_EXTENSIONS = _OTHER_IMAGES | _OTHER_VIDEOS
"""Those of images and videos that are not read."""
VIDEO_EXTENSIONS = frozenset({
    ".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v", ".mxf", ".ts", ".mpg", ".mpeg", ".wmv", ".mts", ".m2ts", ".m2t",
    ".3gp", ".vob",
})  # fmt: skip

_TOKEN = re.compile(r"\{camera\}|\{chapter\}|\{object\}|\{seconds\}|\{frame(?::0?(\d*)d)?\}|\*\*/|\*|\?|\{[^}]*\}")
_BODIES = {"camera": "[^/]+?", "chapter": "[^/]+?", "object": "[^/]+?", "seconds": r"\d+[._]\d+"}


@dataclass(frozen=True)
class Match:
    """A file that matches a pattern. Without `{frame}` in it, `frame` is None; without `{chapter}` and `{object}`,
    `chapter` is ""."""

    path: Path
    camera: str
    frame: int | None
    chapter: str = ""
    seconds: float | None = None


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sort key that puts cam2 before cam10."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", name) if part]


def without_extension(path: str) -> str:
    """A path with forward slashes, without the extension of an image or video: `cam.0` stays as it is."""
    path = path.replace("\\", "/")
    head, dot, extension = path.rpartition(".")
    known = f".{extension.lower()}" in IMAGE_EXTENSIONS | VIDEO_EXTENSIONS | _OTHER_IMAGES
    return head if dot and known else path


_TRAILING = re.compile(r"[_.\- ]*(frame|f|t)?[_.\- ]*\d+$", re.IGNORECASE)
_LEADING = re.compile(r"^(frame|f|t)?[_.\- ]*\d+[_.\- ]+", re.IGNORECASE)


def camera_in(path: str) -> tuple[str, ...]:
    """Return what may be the camera's name in the path of an image, likeliest first: the file's name, without a number
    at its end or beginning, and the names of its folders, of which those that it lacks are ""."""
    *folders, name = PurePosixPath(without_extension(path)).parts
    return name, _TRAILING.sub("", name), _LEADING.sub("", name), *[*folders[::-1], "", "", ""][:3]


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
        elif text[1:-1] in _BODIES or text.startswith("{frame"):
            name = "frame" if text.startswith("{frame") else text[1:-1]
            width = token.group(1)
            body = _BODIES[name] if name != "frame" else rf"\d{{{width},}}" if width else r"\d+"
            parts.append(f"(?P={name})" if name in seen else f"(?P<{name}>{body})")
            seen.add(name)
        else:
            problem = f"Pattern '{whole}': unknown placeholder {text}"
            fix = "Use {camera}, {frame}, {frame:06d}, {seconds}, {chapter} or {object}."
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
        seconds = float(groups["seconds"].replace("_", ".")) if "seconds" in groups else None
        if seconds is not None:
            frame = round(1e6 * seconds)  # until all are known
        key = (groups["camera"], frame, groups.get("chapter") or groups.get("object") or "")
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
        matches[key] = Match(path, *key, seconds)
    return sorted(
        _numbered(list(matches.values())),
        key=lambda match: (natural_key(match.camera), match.frame or 0, natural_key(match.chapter)),
    )


def _numbered(matches: list[Match]) -> list[Match]:
    """The matches, numbered by their times if they have them: from 0 seconds on, at the rate of most of them."""
    if not matches or any(match.seconds is None for match in matches):
        return matches
    times: dict[str, list[float]] = {}
    for match in matches:
        times.setdefault(match.camera, []).append(match.seconds or 0.0)
    intervals = [interval for interval in map(interval_of, times.values()) if interval is not None]
    interval = statistics.median(intervals or [1.0])
    first = min(min(own) for own in times.values())
    before = int(first % 86400 / interval + 1e-3)  # within the day, as times may be those since 1970
    return [replace(match, frame=before + round(((match.seconds or 0.0) - first) / interval)) for match in matches]


_STEADY, _UNSTEADY = 0.1, 0.5  # of the median: by how much usual intervals differ, and if few do not differ more


def interval_of(times: Sequence[float], step: float = 0.0) -> float | None:
    """The mean of the usual intervals of times in any order, in their unit; None if there are fewer than two times.
    `step`: that of a clock to which they are rounded."""
    gaps = [later - earlier for earlier, later in itertools.pairwise(sorted(times))]
    usual = statistics.median(gaps) if gaps else 0.0
    if usual <= 0:
        return None
    rounding = step if usual >= 4 * step else 0.0
    steady = [gap for gap in gaps if abs(gap - usual) <= max(_STEADY * usual, rounding)]
    if 2 * len(steady) < len(gaps):
        steady = [gap for gap in gaps if abs(gap - usual) <= _UNSTEADY * usual]
    return statistics.fmean(steady) if steady else usual


def refuse_other_kinds(root: Path, paths: Iterable[str]) -> None:
    """Raise StudioError (footage.unsupported_kind) if some are images or videos of kinds that are not read."""
    kinds = [suffix for path in paths if (suffix := Path(path).suffix.lower()) in OTHER_EXTENSIONS]
    if kinds:
        kind = max(set(kinds), key=kinds.count)
        problem = f"{counted(kinds.count(kind), 'file')} of the kind {kind}, which is not read"
        better = "PNG or TIFF images" if kind in _OTHER_IMAGES else "MP4 or MOV videos"
        fix = f"Convert them to {better} with the same names."
        raise StudioError("footage.unsupported_kind", problem, file=root, value=kind, fix=fix)


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
