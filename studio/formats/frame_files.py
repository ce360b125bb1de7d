"""Finds the files of a folder that are the frames of a sequence, and their order."""

import itertools
import re
from pathlib import Path

from v3studio.studio.errors import StudioError
from v3studio.studio.formats import FRAME_FILES, META, READ_SUFFIXES, suffix_of
from v3studio.studio.formats.sog import is_sog_meta

CHECKPOINT = "point_cloud.ply"  # what 3DGS and its descendants call the result of an iteration

_ITERATIONS = ("point_cloud/iteration_*", "iteration_*")
_NOT_FRAMES = {
    "iter", "iters", "iteration", "iterations", "it", "step", "steps", "epoch", "ckpt", "sh", "degree", "lod",
}  # fmt: skip
_FRAMES = {"f", "frame", "frames", "fr", "frm", "t", "time", "timestep", "timestamp"}


def formats_in(folder: Path) -> dict[str, list[Path]]:
    """Files of each splat format in a folder, one per frame; hidden files do not count.

    Keys are extensions, `meta.json` for a SOG data set that lies open in the folder, `*/meta.json` for folders with one
    each, and `*/point_cloud.ply` for folders of checkpoints. Formats that are only written count, too, so that a folder
    with one of them besides another is noticed.
    """
    formats: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        kind = path.suffix.lower()
        if path.is_dir():
            checkpoint = last_checkpoint(path)
            if checkpoint is not None:
                formats.setdefault(f"*/{CHECKPOINT}", []).append(checkpoint)
                continue
            kind, path = f"*/{META}", path / META
        elif path.name.lower() == META:
            kind = META
        if (path.name.lower() == META and path.is_file() and is_sog_meta(path)) or kind in FRAME_FILES:
            formats.setdefault(kind, []).append(path)
    return formats


def last_checkpoint(folder: Path) -> Path | None:
    """The `point_cloud.ply` of the last iteration of one model, as 3DGS lays them out; None: it is no such folder."""
    numbered = [
        (int(place.name.rpartition("_")[2]), place / CHECKPOINT)
        for pattern in _ITERATIONS
        for place in folder.glob(pattern)
        if place.name.rpartition("_")[2].isdecimal() and (place / CHECKPOINT).is_file()
    ]
    return max(numbered)[1] if numbered else None


def check_one_format(folder: Path, formats: dict[str, list[Path]]) -> None:
    """Refuse a folder that mixes formats, rather than read a part of it. `formats`: as `formats_in` returns."""
    if len(formats) > 1:
        examples = [str(paths[0].relative_to(folder)) for paths in formats.values()]
        problem = f"the folder mixes formats ({', '.join(formats)}), among them {' and '.join(examples)}"
        fix = "Keep one sequence of one format per folder."
        raise StudioError("import.mixed_formats", problem, file=folder, value=list(formats), fix=fix, files=examples)


def find_frames(place: Path) -> list[tuple[int, Path]]:
    """Number and file of each frame of a sequence, in order; or `place` itself if it is a file.

    A SOG data set that is not bundled is one frame, and so are the checkpoints of one model; both are named by their
    folder. The order is that of the number in the names; see `frame_numbers`.
    """
    if place.is_file():
        if place.suffix.lower() == ".v3s":
            problem = "is a stream already, not splats of another program"
            fix = "Play it with `v3studio play`, or write its splats with `v3studio export --format ply`."
            raise StudioError("import.is_a_stream", problem, file=place, fix=fix)
        return [(0, place)]
    if not place.is_dir():
        raise StudioError("import.not_found", "no such file or folder", file=place)
    checkpoint = last_checkpoint(place)
    if checkpoint is not None:
        return [(0, checkpoint)]
    formats = formats_in(place)
    check_one_format(place, formats)
    paths = [path for files in formats.values() for path in files if suffix_of(path) in READ_SUFFIXES]
    if not paths:
        only = f"{', '.join(formats)} files are only written; there are " if formats else ""
        problem = f"{only}no {', '.join(READ_SUFFIXES)} files in this folder"
        fix = "Specify a folder with one file per frame, or a USD file."
        raise StudioError("import.no_files", problem, file=place, fix=fix)
    if list(formats) == [META]:
        return [(0, paths[0])]
    names = [path.relative_to(place).parts[0] for path in paths]
    numbered = sorted(zip(frame_numbers(place, names), names, paths, strict=True))
    for (number, name, _), (following, other, _) in itertools.pairwise(numbered):
        if number == following:
            what = "the same frame number" if number >= 0 else "no number that says their order"
            problem = f"{name} and {other} have {what}"
            fix = "Keep one sequence per folder, with names such as frame0001."
            raise StudioError("import.duplicate_frame", problem, file=place, value=number, fix=fix, files=[name, other])
    return [(number, path) for number, _, path in numbered]


def frame_numbers(folder: Path, names: list[str]) -> list[int]:
    """The frame number in each name; -1: it has no number.

    Of several numbers, it is the one that changes from name to name. Iterations of a training (`iter_30000`) are never
    frames. If several change, it is the one after a word such as `frame`, otherwise the last one, provided that the
    others say the same order.
    """
    stems = [_stem(name).lower() for name in names]
    times = [re.findall(r"(\d+)\.(\d+)", stem) for stem in stems]
    one_time = all(len(own) == 1 for own in times) and len({len(own[0][1]) for own in times}) == 1
    if one_time and len({own[0][0] for own in times}) > 1:  # seconds; a version is the same in all names
        stems = [re.sub(r"(\d+)\.(\d+)", r"\1\2", stem) for stem in stems]
    parsed = [re.findall(r"([a-z]*)[^a-z\d]*(\d+)", stem) for stem in stems]
    if len({tuple(word for word, _ in numbers) for numbers in parsed}) > 1:  # named differently: their last numbers
        frames = [[int(number) for word, number in numbers if word not in _NOT_FRAMES] for numbers in parsed]
        return [numbers[-1] if numbers else -1 for numbers in frames]
    words = [word for word, _ in parsed[0]]
    columns = [[int(numbers[index][1]) for numbers in parsed] for index in range(len(words))]
    changing = [index for index, column in enumerate(columns) if len(set(column)) > 1]
    chosen = [index for index in changing if words[index] not in _NOT_FRAMES]
    if changing and not chosen:
        problem = f"{names[0]} and {names[-1]} are iterations of one training, not frames"
        fix = f"Import one of them: {folder / names[max(range(len(names)), key=columns[changing[-1]].__getitem__)]}"
        raise StudioError("import.iterations", problem, file=folder, value=[names[0], names[-1]], fix=fix)
    chosen = [index for index in chosen if words[index] in _FRAMES] or chosen
    if not chosen:
        return columns[-1] if columns else [-1] * len(names)
    orders = [sorted(range(len(names)), key=columns[index].__getitem__) for index in chosen]
    for order in orders[:-1]:
        if order != orders[-1]:
            first = next(position for position, index in enumerate(order) if index != orders[-1][position])
            either = [names[order[first]], names[orders[-1][first]]]
            problem = f"the names have several numbers, which say different orders: {' or '.join(either)} comes first"
            fix = "Write 'frame' before the number of the frame, as in frame0001."
            raise StudioError("import.ambiguous_order", problem, file=folder, value=either, fix=fix)
    return columns[chosen[-1]]


def _stem(name: str) -> str:
    """A name without the extensions of its format."""
    path = Path(name)
    stem = path.stem if path.suffix.lower() in FRAME_FILES else name
    return stem.removesuffix(".compressed")
