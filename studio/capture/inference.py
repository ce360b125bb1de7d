"""Infers which part of the files' paths is the camera and which the frame, for layouts that no table lists.

Each folder's and file's name may be the same in all paths, a camera, a frame number with words around it, or both. Any
combination is a candidate; it must give each file a camera and a frame of its own. Of several, the one that fills the
grid of cameras and frames and whose names look like cameras and frames is the best.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import PurePosixPath

_FRAME_WORD = "(?:frames?|frm|fr|timesteps?|time|img|images?|im|f|t)"
_CAMERA_WORD = "(?:cameras?|cam|views?|viewpoint|device|dev|sensor|gopro|kinect|node|pod|cn|c|v|k)"
_JOIN = "[-_. ]"
_BETWEEN = rf"{_JOIN}+(?:[a-z]+{_JOIN}?)?|(?<![a-z]){_FRAME_WORD}{_JOIN}?"
_CAMERA_FIRST = re.compile(rf"(.+?)({_BETWEEN})(\d+)(\D*)", re.I)
_FRAME_FIRST = re.compile(rf"(\D*)(\d+)({_JOIN}+)(.+)", re.I)
_LIKE_CAMERA = re.compile(rf"{_CAMERA_WORD}{_JOIN}?[a-z]?\d+.*", re.I)
_LIKE_FRAME = re.compile(rf"{_FRAME_WORD}{_JOIN}?\d+", re.I)
_AFTER_FRAME_WORD = re.compile(rf"(?:.*{_JOIN})?{_FRAME_WORD}{_JOIN}?", re.I)
_AFTER_CAMERA_WORD = re.compile(rf"(?:.*{_JOIN})?{_CAMERA_WORD}{_JOIN}?", re.I)
_LEAST_COVERAGE = 0.5


@dataclass(frozen=True)
class Layout:
    """A pattern as in `CaptureSettings`, the numbers of cameras and frames that it gives, and how likely it is."""

    pattern: str
    cameras: frozenset[str]
    frames: int
    score: float

    @property
    def is_grid(self) -> bool:
        """Tell whether there are several cameras with several frames each."""
        return len(self.cameras) > 1 and self.frames > 1


@dataclass(frozen=True)
class _Form:
    """A reading of names: camera ("" if none) and frame (None if none) of each, as a part of a pattern."""

    fragment: str
    fields: dict[str, tuple[str, int | None]]
    score: float = 0.0


def infer_layouts(paths: Sequence[str], cameras: Collection[str] = ()) -> list[Layout]:
    """The likely layouts, the best one first, of files of one kind and the same number of folders, as relative paths
    with '/'. A layout must have some of the known `cameras`, if there are any."""
    split = [(*path.split("/")[:-1], PurePosixPath(path).stem) for path in paths]
    extensions = {PurePosixPath(path).suffix for path in paths}
    extension = extensions.pop() if len(extensions) == 1 else ".*"
    columns = [list(_forms(sorted(set(column)))) for column in zip(*split, strict=True)]
    layouts = []
    for forms in product(*columns):
        layout = _layout(split, forms, extension)
        if layout is not None and (not cameras or layout.cameras & set(cameras)):
            layouts.append(layout)
    return sorted(layouts, key=lambda layout: -layout.score)


def looks_like_camera(name: str) -> bool:
    """Return whether a name is like cam01, view_2 or device3."""
    return _LIKE_CAMERA.fullmatch(name) is not None


def groups_of(paths: Sequence[str]) -> Iterator[list[str]]:
    """The paths with the same number of folders; then those that also share the first folder, the second, ..."""
    for depth in sorted({path.count("/") for path in paths}):
        same = [path for path in paths if path.count("/") == depth]
        for shared in range(depth + 1):
            folders = {tuple(path.split("/")[:shared]) for path in same}
            for folder in sorted(folders) if shared == 0 or len(folders) > 1 else ():
                yield [path for path in same if tuple(path.split("/")[:shared]) == folder]


def _layout(split: Sequence[tuple[str, ...]], forms: Sequence[_Form], extension: str) -> Layout | None:
    grid = set()
    for names in split:
        fields = [form.fields[name] for name, form in zip(names, forms, strict=True)]
        cameras = {camera for camera, _ in fields if camera}
        frames = {frame for _, frame in fields if frame is not None}
        if len(cameras) != 1 or len(frames) > 1:
            return None
        grid.add((*cameras, *frames))
    known = frozenset(str(place[0]) for place in grid)
    count = len({place[1:] for place in grid})
    own = sum(form.score for form in forms)
    if count == len(grid) and len(known) > 1 and len(grid) == len(split):  # no number is in two cameras
        each = {len([place for place in grid if place[0] == camera]) for camera in known}
        if len(each) == 1 and each != {1}:
            count, own = each.pop(), own - 1
    coverage = len(grid) / (len(known) * count)
    if len(grid) < len(split) or coverage < _LEAST_COVERAGE:
        return None
    score = 2 * coverage + 4 * (len(known) > 1) + 4 * (count > 1) + own
    return Layout("/".join(form.fragment for form in forms) + extension, known, count, score)


def _forms(names: Sequence[str]) -> Iterator[_Form]:
    like_camera = sum(looks_like_camera(name) for name in names) / len(names)
    fields: dict[str, tuple[str, int | None]]
    like_frame = sum(bool(_LIKE_FRAME.fullmatch(name)) for name in names) / len(names)
    yield _Form("{camera}", {name: (name, None) for name in names}, 3 * like_camera - 3 * like_frame)
    word = re.search(rf"{_JOIN}[a-z]+$", shared_start([name[::-1] for name in names])[::-1], re.I)
    if word is not None and len(names) > 1:  # as in cam0_mask; less likely than that the word is part of the name
        fields = {name: (name.removesuffix(word.group()), None) for name in names}
        yield _Form(f"{{camera}}{word.group()}", fields, 3 * like_camera - 0.5)
    if len(names) == 1:
        yield _Form(names[0], {names[0]: ("", None)}, 1)
        if names[0].isdecimal():
            yield _Form("{frame}", {names[0]: ("", int(names[0]))}, 1.5)
        return
    head, tail = shared_start(names), shared_start([name[::-1] for name in names])[::-1]
    middles = [name[len(head) : len(name) - len(tail)] for name in names]
    if all(middle.isdecimal() for middle in middles) and not _AFTER_CAMERA_WORD.fullmatch(head):
        fields = {name: ("", int(middle)) for name, middle in zip(names, middles, strict=True)}
        yield _Form(f"{head}{{frame}}{tail}", fields, _frame_score(head, middles))
    yield from _both(names, _CAMERA_FIRST, 0)
    yield from _both(names, _FRAME_FIRST, 3)
    yield from _with_other_parts(names)


def _with_other_parts(names: Sequence[str]) -> Iterator[_Form]:
    """Names with a time in seconds, or with a number before or behind a part that differs from camera to camera."""
    times = [re.fullmatch(r"(.*?)(\d+\.\d{2,}|\d{9,}_(?:\d{6}|\d{9}))(\D*)", name) for name in names]
    if all(times) and len({(match[1], match[3], len(re.split("[._]", match[2])[1])) for match in times if match}) == 1:
        first = times[0]
        assert first is not None
        fields = {match[0]: ("", round(1e6 * float(match[2].replace("_", ".")))) for match in times if match}
        yield _Form(f"{first[1]}{{seconds}}{first[3]}", dict(fields), 4)
    for expression, frame, form in (
        (rf"(\d+)({_JOIN})(.+)", 1, "{{frame}}{join}*"),
        (rf"(.+)({_JOIN})(\d+)", 3, "{head}*{join}{{frame}}"),
    ):
        parts = [re.fullmatch(expression, name) for name in names]
        joins, others = {match[2] for match in parts if match}, {match[4 - frame] for match in parts if match}
        if all(parts) and len(joins) == 1 and len(others) > 1:
            numbers = [match[frame] for match in parts if match]
            fragment = form.format(head=shared_start(sorted(others)), join=joins.pop())
            own = {name: ("", int(number)) for name, number in zip(names, numbers, strict=True)}
            yield _Form(fragment, dict(own), _frame_score("", numbers) - 1)


def _both(names: Sequence[str], expression: re.Pattern[str], camera: int) -> Iterator[_Form]:
    """Names with a camera, the group `camera` of the expression, and a frame, two groups before or behind it."""
    frame = 1 if camera == 3 else 2
    matched = {name: match.groups() for name in names if (match := expression.fullmatch(name)) is not None}
    others = [index for index in range(4) if index not in (camera, frame)]
    if len(matched) < len(names) or any(len({parts[index] for parts in matched.values()}) > 1 for index in others):
        return
    parts = list(next(iter(matched.values())))
    if _AFTER_CAMERA_WORD.fullmatch(parts[frame - 1]):
        return
    cameras = {name: groups[camera] for name, groups in matched.items()}
    before = ""
    if camera == 0:  # a word that all of them end with describes the images
        shared = shared_start([name[::-1] for name in cameras.values()])[::-1]
        word = re.search(rf"{_JOIN}[a-z]+$", shared, re.I)
        if word is not None:
            cameras = {name: text.removesuffix(word.group()) for name, text in cameras.items()}
            parts[1] = word.group() + parts[1]
        take = re.match(rf".*{_JOIN}", shared_start(list(cameras.values())))
        if take is not None and all(looks_like_camera(text[take.end() :]) for text in cameras.values()):
            cameras = {name: text[take.end() :] for name, text in cameras.items()}
            before = take.group()
    numbers = [groups[frame] for groups in matched.values()]
    parts[camera], parts[frame] = f"{before}{{camera}}", "{frame}"
    like = sum(looks_like_camera(text) for text in cameras.values()) / len(cameras)
    score = _frame_score(parts[frame - 1], numbers) + 3 * like
    fields = {name: (cameras[name], int(groups[frame])) for name, groups in matched.items()}
    yield _Form("".join(parts), dict(fields), score + (0.25 if camera == 0 else 0))


def _frame_score(before: str, numbers: Sequence[str]) -> float:
    """Score, higher for digits that look like frame numbers: by the text before them, their width and gaps."""
    frames = {int(number) for number in numbers}
    score = 0.0
    if before and _AFTER_FRAME_WORD.fullmatch(before):
        score += 3
    counts = max(frames) - min(frames) + 1 == len(frames)
    score += min(len(number) for number in numbers) >= 3 and (counts or any(number[0] == "0" for number in numbers))
    return score + 0.5 * counts + (counts and min(frames) in (0, 1))


def shared_start(names: Sequence[str]) -> str:
    """The text with which all names begin, without digits at its end."""
    first, last = min(names), max(names)
    length = next((index for index, char in enumerate(first) if index >= len(last) or last[index] != char), len(first))
    return re.sub(r"\d+$", "", first[:length])
