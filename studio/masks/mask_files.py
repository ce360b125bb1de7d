"""Masks that were made elsewhere: images or videos."""

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from v3studio.studio.capture.detect import MASK_FOLDERS, all_beside
from v3studio.studio.capture.frame_sources import DecoderPool, FrameSource, make_sources
from v3studio.studio.capture.patterns import VIDEO_EXTENSIONS, Match, find_files, number_ranges
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.counts import cameras_listed, counted, plural
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.masks.mask_source import MaskInputs, MaskSource, evenly_spaced
from v3studio.studio.masks.mask_values import INVERTED, LOSSY, MaskValues, mask_channel, read_mask_values, values_in
from v3studio.studio.yaml_text import inline_yaml

_SAMPLED_FRAMES, _SAMPLED_CAMERAS = 3, 8


class FileMaskSource:
    """A `MaskSource` that reads mask images, one per camera and frame, or mask videos; see `read_mask_values` and
    `MaskValues` for what their values mean. `labels`: those that are foreground, if the values are labels; empty: all
    but 0. Masks that differ in size from the images are resized if the aspect ratio is the same.
    """

    def __init__(self, sources: Mapping[str, FrameSource], labels: tuple[int, ...] = (), note: str = "") -> None:
        self._sources = dict(sources)
        self.note = note  # the end of a sentence on how the files are numbered
        self._labels = labels
        self._values: dict[str, MaskValues] = {}

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras that have masks."""
        return tuple(self._sources)

    def values(self, camera: str) -> MaskValues:
        """The meaning of a camera's masks, from three of them. Raises StudioError: `mask.missing`, `mask.no_label`."""
        if camera not in self._values:
            source = self._source(camera, 0)
            count = len(source.frames)
            chosen = sorted({source.frames[index] for index in np.linspace(0, count - 1, _SAMPLED_FRAMES).astype(int)})
            meaning = values_in([_read(source, frame) for frame in chosen], _is_exact(source), self._labels)
            if self._labels not in ((), INVERTED) and meaning.highest and not meaning.labels:
                raise StudioError(
                    "mask.no_label",
                    f"the masks of camera '{camera}' are not labels, but have {meaning}",
                    file=source.files([chosen[0]])[0],
                    fix="Remove capture.mask_labels.",
                    camera=camera,
                    setting="capture.mask_labels",
                )
            self._values[camera] = meaning
        return self._values[camera]

    @property
    def sampled(self) -> dict[str, MaskValues]:
        """The values of some of the cameras."""
        return {name: self.values(name) for name in evenly_spaced(self.cameras, _SAMPLED_CAMERAS)}

    @property
    def warnings(self) -> list[Message]:
        """Warnings about unusual masks: they are nearly black (`mask.weak`), or inverted (`mask.inverted`)."""
        sampled = self.sampled
        weak = {name: own for name, own in sampled.items() if not own.labels and 0 < own.highest < own.full / 2}
        # in most images, a performer is in the middle
        inverted = [name for name, own in sampled.items() if own.border > 0.5]
        warnings = []
        for name, own in list(weak.items())[:1]:
            warnings.append(
                Message(
                    "mask.weak",
                    f"the masks of {cameras_listed(weak)} never reach half of full scale, so they show no performer: "
                    f"the highest value is {own.highest:g} of {own.full:g}",
                    file=self._sources[name].files()[0],
                    value=own.highest,
                    fix=f"Write them again, with {own.full:g} for the performer.",
                    fields={"cameras": tuple(weak)},
                )
            )
        if 2 * len(inverted) > len(sampled):
            problem = f"most of the border of the image is performer in the masks of {cameras_listed(inverted)}"
            fix = _instead_of_inverted(sampled[inverted[0]], self._labels)
            fields = {"cameras": tuple(inverted), "setting": "capture.mask_labels"}
            warnings.append(
                Message("mask.inverted", problem, file=self._sources[inverted[0]].files()[0], fix=fix, fields=fields)
            )
        return warnings

    def _source(self, camera: str, frame: int) -> FrameSource:
        source = self._sources.get(camera)
        if source is None:
            problem = f"Camera '{camera}' has no mask files"
            raise StudioError("mask.missing", problem, camera=camera, frames=(frame,), kind="mask")
        return source

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError: `mask.missing`, `mask.aspect_ratio`, or the
        file cannot be read."""
        import cv2

        source = self._source(camera, frame)
        values, meaning = _read(source, frame), self.values(camera)
        if not meaning.highest:  # the sampled frames are empty, so that they tell nothing
            meaning = values_in([values], _is_exact(source), self._labels)
        mask = meaning.mask(values, self._labels)
        height, width = image.shape[:2]
        if mask.shape != (height, width):
            if abs(mask.shape[1] * height - mask.shape[0] * width) > max(height, width):
                files = source.files([frame])
                raise StudioError(
                    "mask.aspect_ratio",
                    f"the mask of frame {frame} is {mask.shape[1]}x{mask.shape[0]}, its image {width}x{height}",
                    file=files[0] if files else None,
                    value=(mask.shape[1], mask.shape[0]),
                    fix="Masks must have the aspect ratio of the images.",
                    camera=camera,
                    frame=frame,
                    expected=(width, height),
                )
            shrink = mask.shape[1] > width
            how = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
            mask = cv2.resize(np.ascontiguousarray(mask), (width, height), interpolation=how)
        return np.ascontiguousarray(mask)

    def files(self) -> list[Path]:
        return [path for source in self._sources.values() for path in source.files()]


def _instead_of_inverted(meaning: MaskValues, chosen: tuple[int, ...]) -> str:
    """The fix for masks whose border is foreground."""
    others = [label for label in meaning.labels if label != meaning.around]
    if chosen == INVERTED:
        return "If that is not so, remove capture.mask_labels."
    if others:
        return f"If {meaning.around:g} is the background, set capture.mask_labels to {inline_yaml(others)}."
    if not meaning.lowest:
        return f"If they are inverted, set capture.mask_labels to {inline_yaml(list(INVERTED))}."
    return "Write them again, with 0 for the background."


class _Objects(FrameSource):
    """The masks of a camera's objects, whose values are joined by `_read`."""

    def __init__(self, parts: Sequence[FrameSource]) -> None:
        self.parts, first = tuple(parts), parts[0]
        self.camera, self.width, self.height = first.camera, first.width, first.height
        self.has_alpha, self.fps, self.note = first.has_alpha, first.fps, first.note
        self.frames = tuple(sorted({frame for part in parts for frame in part.frames}))

    def read(self, frame: int) -> np.ndarray:
        return _read(self, frame)

    def files(self, frames: Iterable[int] | None = None) -> list[Path]:
        wanted = self.frames if frames is None else tuple(frames)
        return [path for part in self.parts for path in part.files([f for f in wanted if f in part.frames])]


def _read(source: FrameSource, frame: int) -> np.ndarray:
    """The values of a mask, (H, W)."""
    if isinstance(source, _Objects):
        masks = [_read(part, frame) for part in source.parts if frame in part.frames]
        if len({mask.shape for mask in masks}) > 1:
            problem = f"the masks of the objects differ in size in frame {frame}"
            fix = "Write them again with one size."
            raise StudioError("mask.object_sizes", problem, file=source.files([frame])[0], fix=fix, frame=frame)
        joined: np.ndarray = np.maximum.reduce(masks)
        return joined
    files = source.files([frame])
    if not files or files[0].suffix.lower() in VIDEO_EXTENSIONS:
        return mask_channel(source.read(frame))
    return read_mask_values(files[0])


def _is_exact(source: FrameSource) -> bool:
    return source.files()[0].suffix.lower() not in VIDEO_EXTENSIONS | LOSSY


def open_files(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str] | None:
    """Open masks from files, for `SOURCES`. Raises StudioError `mask.not_found` or `mask.missing`."""
    files = find_files_of(
        inputs, "mask_files", MASK_FOLDERS, required,
        code="mask.not_found", what="mask", example="masks/{camera}/{frame}.png",
    )  # fmt: skip
    if files is None:
        return None
    pattern, matches = files
    needed = [name for name in inputs.names if name not in inputs.held_out]
    source = _file_mask_source(
        matches, inputs.spec, needed, inputs.frames, inputs.pool, "mask", inputs.spec.mask_labels, not required,
        inputs.sources,
    )  # fmt: skip
    meanings = source.sampled
    wanted = inputs.spec.mask_labels
    known = sorted({label for meaning in meanings.values() for label in meaning.labels})
    if wanted not in ((), INVERTED) and known and not set(wanted) & set(known):
        problem = f"capture.mask_labels is {inline_yaml(list(wanted))}, but the masks have {', '.join(map(str, known))}"
        fix = "Choose from these."
        raise StudioError(
            "mask.no_label", problem, file=inputs.spec.root, value=wanted, fix=fix, setting="capture.mask_labels"
        )
    objects = sorted({match.chapter for match in matches if match.chapter})
    joined = f", of {counted(len(objects), 'object')} that are joined: {', '.join(objects)}" if objects else ""
    return source, f"files '{pattern}'{_described(meanings)}{joined}{source.note}"


def _described(meanings: Mapping[str, MaskValues]) -> str:
    """A description of the masks of some cameras, in parentheses."""
    kinds = {str(meaning): name for name, meaning in meanings.items() if meaning.highest}
    words = f" ({'; '.join(f'camera {name}: {kind}' if len(kinds) > 1 else kind for kind, name in kinds.items())})"
    return words if kinds else " (all that were looked at are empty)"


def find_files_of(
    inputs: MaskInputs, setting: str, folders: re.Pattern[str], required: bool, *, code: str, what: str, example: str
) -> tuple[str, list[Match]] | None:
    """Pattern and files of a setting, or of usual `folders` if it is auto; or None. Raises StudioError: `code`."""
    root, wanted = inputs.spec.root, getattr(inputs.spec, setting)
    if wanted != "auto":
        problem = f"no {what} of the footage's cameras matches the pattern '{wanted}'"
        fix = f"Check capture.{setting}."
        none = StudioError(code, problem, file=root, value=wanted, fix=fix, setting=f"capture.{setting}")
        return wanted, matching(root, wanted, inputs.sources, none)
    files = find_beside(root, folders, inputs.sources)
    if files is None and required:
        problem = f"no {what}s found" if what != "mask" else "no mask files found"
        fix = f"Set capture.{setting}, for example '{example}'."
        raise StudioError(code, problem, file=root, fix=fix, setting=f"capture.{setting}")
    return files


def matching(root: Path, pattern: str, cameras: Container[str], none: StudioError) -> list[Match]:
    """The files of some cameras that match a setting's pattern. Raises `none` if there are none."""
    matches = [match for match in find_files(root, pattern) if match.camera in cameras]
    if not matches:
        raise none
    return matches


def find_beside(
    root: Path, folders: re.Pattern[str], sources: Mapping[str, FrameSource]
) -> tuple[str, list[Match]] | None:
    """Masks or clean plates below `root`, or else in the folder of `root` that has all the footage."""
    beside = next(all_beside(root, folders, tuple(sources)), None)
    if beside is not None:
        return beside
    files = [path for source in sources.values() for path in source.files()]
    within = [path.relative_to(root).parts for path in files if path.is_relative_to(root)]
    first = {parts[0] for parts in within if len(parts) > 1}
    if len(within) < len(files) or len(first) != 1:
        return None
    folder = first.pop()
    beside = next(all_beside(root / folder, folders, tuple(sources)), None)
    return (f"{folder}/{beside[0]}", beside[1]) if beside is not None else None


def _file_mask_source(
    matches: list[Match],
    spec: CaptureSettings,
    names: Sequence[str],
    frames: tuple[int, ...],
    pool: DecoderPool,
    what: str,
    labels: tuple[int, ...] = (),
    lenient: bool = False,
    footage: Mapping[str, FrameSource] | None = None,
) -> FileMaskSource:
    """Masks of the cameras `names`, one for each of `frames`; if `lenient`, half of the cameras may have none. Those of
    all frames of the `footage` may count from another number."""
    sources = _sources(matches, pool, spec.offsets)
    shift = _shift(sources, footage or {})
    note = ""
    if shift:
        sources = _sources(matches, pool, {name: spec.offsets.get(name, 0) - own for name, own in shift.items()})
        name, own = next(iter(shift.items()))
        note = f"; they count from another number: that of frame {sources[name].frames[0]} is numbered "
        note += f"{sources[name].frames[0] - own}"
    without = [name for name in names if name not in sources] if frames else []
    if without and not (lenient and 2 * len(without) <= len(names)):
        others = [name for name in names if name not in without]
        leave_out = f", or leave out these cameras: set capture.cameras to {inline_yaml(others)}" if others else ""
        raise StudioError(
            "mask.missing",
            f"{plural('Camera', len(without))} {', '.join(map(repr, without))} without {what}s",
            fix=f"Add the missing files{leave_out}.",
            cameras=tuple(without),
            camera=without[0],
            frames=frames,
            kind=what,
            setting="capture.cameras",
        )
    for name, source in sources.items():
        have = set(source.frames)
        missing = [frame for frame in frames if frame not in have] if name in names else []
        if missing:
            problem = (
                f"Camera '{name}' has no {what} for {plural('frame', len(missing))} {number_ranges(missing)}, but for "
                f"{number_ranges(list(source.frames))}"
            )
            fix = "Add the missing files, or rename them to the numbers of the images."
            raise StudioError("mask.missing", problem, fix=fix, camera=name, frames=tuple(missing), kind=what)
    return FileMaskSource(sources, labels, note)


def _sources(matches: list[Match], pool: DecoderPool, offsets: Mapping[str, int]) -> dict[str, FrameSource]:
    """The masks by camera; those of several objects joined."""
    by_object: dict[str, list[Match]] = {}
    for match in matches:
        by_object.setdefault(match.chapter, []).append(replace(match, chapter=""))
    parts = [make_sources(own, pool, offsets, "srgb", "auto") for own in by_object.values()]
    if len(parts) == 1:
        return parts[0]
    cameras = dict.fromkeys(name for part in parts for name in part)
    return {name: _Objects([part[name] for part in parts if name in part]) for name in cameras}


def _shift(masks: Mapping[str, FrameSource], footage: Mapping[str, FrameSource]) -> dict[str, int]:
    """By how much the masks' numbers are less than those of their images, by camera; empty if they are the same. Raises
    StudioError (mask.other_numbers) if they are not, but it is not clear which mask belongs to which image."""
    shift: dict[str, int] = {}
    for name, source in masks.items():
        mine, theirs = source.frames, footage[name].frames if name in footage else source.frames
        if set(mine) <= set(theirs) or set(theirs) <= set(mine) or not theirs:
            continue
        steps = {their - own for their, own in zip(theirs, mine, strict=False)}
        if len(mine) == len(theirs) and len(steps) == 1:
            shift[name] = steps.pop()
        elif mine[0] in (0, 1) and theirs[0] != mine[0]:
            problem = (
                f"the masks of camera '{name}' are numbered {number_ranges(list(mine))}, its images "
                f"{number_ranges(list(theirs))}, so that it is not clear which belong together"
            )
            fix = "Give each mask the number of its image."
            raise StudioError("mask.other_numbers", problem, file=source.files()[0], fix=fix, camera=name)
    return shift


def exact_masks(
    spec: CaptureSettings, pattern: str | None, names: tuple[str, ...], frames: tuple[int, ...]
) -> tuple[MaskSource | None, str]:
    """The source of the exact masks for evaluation and a sentence that describes it; None and "" if there are none.
    `pattern`: of their files, relative to the capture; `frames`: numbers of those that must have a mask. StudioError:
    `mask.not_found`, or `mask.missing` for a camera or frame."""
    if pattern is None:
        return None, ""
    problem = f"no evaluation mask matches the pattern '{pattern}'"
    fix, setting = "Check evaluate.exact_masks.", "evaluate.exact_masks"
    none = StudioError("mask.not_found", problem, file=spec.root, value=pattern, fix=fix, setting=setting)
    matches = matching(spec.root, pattern, names, none)
    mask_source = _file_mask_source(matches, spec, names, frames, DecoderPool(len(names)), "evaluation mask")
    return mask_source, f"Evaluation within the exact masks '{pattern}'."
