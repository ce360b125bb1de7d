"""Selects the `MaskSource` for a `CaptureSettings` and finds its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from studio.capture.detect import MASK_FOLDERS, PLATE_FOLDERS, detect_beside
from studio.capture.digest import digest_files
from studio.capture.frame_numbers import number_ranges
from studio.capture.frame_sources import DecoderPool, FrameSource, make_sources
from studio.capture.patterns import Match, find_files, natural_key
from studio.capture.settings import CaptureSettings, OnnxSettings
from studio.counts import plural
from studio.errors import StudioError
from studio.masks.chroma_key import ChromaMaskSource
from studio.masks.mask_cache import MaskCache
from studio.masks.mask_source import (
    AlphaMaskSource,
    FileMaskSource,
    FullMaskSource,
    GarbageMasks,
    MaskSource,
    MissingMaskSource,
    PlateMaskSource,
    plates_from_files,
)
from studio.masks.matting_function import FunctionMaskSource
from studio.masks.median_background import Background, cached_background, estimate_background
from studio.masks.onnx_model import OnnxModel
from studio.masks.plain_background import PlainMaskSource, plain_color, spread
from studio.storage import whole_files

_FEW_FRAMES = 10  # with fewer frames, the performer hides too much of the set


def choose_mask_source(
    spec: CaptureSettings,
    sources: Mapping[str, FrameSource],
    frames: tuple[int, ...],
    pool: DecoderPool,
    cache_folder: Path | None,
    device: str = "auto",
    threads: int = 0,
    garbage: GarbageMasks | None = None,
) -> tuple[MaskSource, str]:
    """The mask source selected by `spec.masks`: one kind for all cameras.

    "auto" that finds none gives a `MissingMaskSource`, so that cameras can be calibrated without masks.

    Args:
        spec: the capture's settings.
        sources: frames of each camera.
        frames: frame numbers that must have a mask file.
        pool: bounds the number of open decoders.
        cache_folder: for estimated backgrounds and masks of a model; None caches in memory only.
        device, threads: device and CPU threads of a matting model, as in `OnnxModel`.
        garbage: where the performer may be, for sources that profit from knowing it; `Footage` applies it in any case.

    Returns:
        the source, and a sentence that describes it.

    Raises:
        StudioError: `mask.*`: its files are not found, or files for a camera or frame are missing.
    """
    kind = spec.masks
    names = tuple(sources)
    if kind in ("alpha", "auto") and all(source.has_alpha for source in sources.values()):
        return AlphaMaskSource(), _chosen(spec, names, "alpha channel of the images")
    if kind == "alpha":
        bare = next(name for name, source in sources.items() if not source.has_alpha)
        raise StudioError(
            "mask.alpha_missing",
            f"capture.masks is alpha, but the images of camera '{bare}' have no alpha channel",
            fix="Choose another source of masks in capture.masks.",
            camera=bare,
            setting="capture.masks",
        )
    if kind in ("files", "auto"):
        found = _mask_files(spec, sources, required=kind == "files")
        if found is not None:
            pattern, matches = found
            files = _file_mask_source(matches, names, frames, pool, "mask", spec.offsets)
            return files, _chosen(spec, names, f"files '{pattern}'")
    if kind in ("clean_plate", "auto"):
        found = _plates(spec, sources, required=kind == "clean_plate")
        if found is not None:
            pattern, matches = found
            without = sorted(set(names) - {match.camera for match in matches}, key=natural_key)
            if without:
                raise StudioError(
                    "mask.plate_missing",
                    f"camera '{without[0]}' has no clean plate that matches '{pattern}'",
                    file=spec.root,
                    value=pattern,
                    fix="Add it, or exclude the camera.",
                    camera=without[0],
                    setting="capture.clean_plates",
                )
            load = plates_from_files(matches, spec.color_matrix, spec.transfer)
            paths = [match.path for match in matches]
            mask_source = PlateMaskSource(load, paths, spec, garbage)
            return mask_source, _chosen(spec, names, f"difference from the clean plates '{pattern}'")
    if kind == "chroma_key":
        return _chroma(spec, sources, garbage), "Masks: chroma key."
    if kind == "model":
        return _model(spec, garbage, cache_folder, device, threads), f"Masks: matting model {spec.mask_model}."
    if kind == "plain" or (kind == "auto" and _before_plain(sources)):
        return PlainMaskSource(lambda camera: _first(sources[camera]), names), _chosen(
            spec, names, "difference from the plain background"
        )
    count = min(len(source.frames) for source in sources.values())
    if kind == "median_background" and count < 3:
        raise StudioError(
            "mask.too_few_frames",
            f"A median background needs at least 3 frames, but the footage has {count}",
            value=count,
            fix="Provide masks or clean plates.",
            expected=3,
            setting="capture.masks",
        )
    if kind == "median_background" or (kind == "auto" and count >= _FEW_FRAMES):

        def background(camera: str) -> Background:
            source = sources[camera]

            def read(frame: int) -> np.ndarray:
                return source.read(frame)[:, :, :3]

            meaning = spec.color_matrix + ("" if spec.transfer == "auto" else f"_{spec.transfer}")
            key = f"{digest_files(spec.root, source.files())[:24]}_{meaning}" if cache_folder else ""
            return cached_background(cache_folder, key, lambda: estimate_background(read, source.frames))

        paths = [path for source in sources.values() for path in source.files()]
        mask_source = PlateMaskSource(background, paths, spec, garbage)
        return mask_source, _chosen(spec, names, "difference from the background estimated from the footage")
    if kind == "none":
        return FullMaskSource(), "Masks: none; everything is foreground."
    missing = MissingMaskSource(
        "no alpha channel, mask files, clean plates or plain background, and too few frames to estimate the background "
        f"({count}; {_FEW_FRAMES} are needed)"
    )
    return missing, f"Masks: not found. {missing.message}"


def _chosen(spec: CaptureSettings, names: tuple[str, ...], what: str) -> str:
    """What the masks of which cameras are, and whether somebody chose it."""
    cameras = f"all {len(names)} cameras" if len(names) > 1 else f"camera '{names[0]}'"
    return f"Masks: {what}{f' (chosen by auto for {cameras})' if spec.masks == 'auto' else ''}."


def _first(source: FrameSource) -> np.ndarray:
    return source.read(source.frames[0])[:, :, :3]


def _before_plain(sources: Mapping[str, FrameSource]) -> bool:
    """Whether the images show the performer cut out on a plain color, according to up to nine cameras.

    In at least half of them, the performer must not be cut off; in the others the color must be the same.
    """
    some = spread(tuple(sources))
    mask_source = PlainMaskSource(lambda camera: _first(sources[camera]), tuple(sources))
    try:
        whole = sum(plain_color(_first(sources[camera]), cut_off=False) is not None for camera in some)
        return 2 * whole >= len(some) and all(mask_source.has_color(camera) for camera in some)
    except StudioError:  # an unreadable file is reported when it is needed
        return False


def _chroma(
    spec: CaptureSettings, sources: Mapping[str, FrameSource], garbage: GarbageMasks | None
) -> ChromaMaskSource:
    def read(camera: str, frame: int) -> np.ndarray:
        return sources[camera].read(frame)[:, :, :3]

    key = None if isinstance(spec.key_color, str) else spec.key_color
    return ChromaMaskSource(read, lambda camera: sources[camera].frames, key, spec, garbage)


def _model(
    spec: CaptureSettings,
    garbage: GarbageMasks | None,
    cache_folder: Path | None,
    device: str,
    threads: int,
) -> FunctionMaskSource:
    if not spec.mask_model:
        raise StudioError(
            "mask.model_not_set",
            "capture.masks is model, but no model is set",
            fix="Set capture.mask_model to an ONNX file.",
            setting="capture.mask_model",
        )
    path = spec.root / Path(spec.mask_model).expanduser()
    given = [path.with_name(path.name + ending) for ending in ("", "_data", ".data")]  # see `OnnxModel.files`
    model = OnnxModel(whole_files(given)[0], spec, device=device, threads=threads)
    files = [one for one in given if one.is_file()]  # not the copies: of pointers, the store's version is digested
    cache = None
    if cache_folder is not None:
        # the device is not part of the recipe, because masks do not depend on it
        recipe = spec.model_dump_json(include=set(OnnxSettings.model_fields) - {"mask_model"})
        cache = MaskCache(cache_folder / "masks", f"{digest_files(path.parent, files)} {recipe}")
    return FunctionMaskSource(
        model,
        "matting model",
        files=files,
        cache=cache,
        components=spec.mask_components,
        garbage=garbage,
    )


def _beside(root: Path, folders: Sequence[str], sources: Mapping[str, FrameSource]) -> tuple[str, list[Match]] | None:
    """Masks or clean plates below `root`, or else in the folder of `root` that has all the footage."""
    found = detect_beside(root, folders, tuple(sources))
    if found is not None:
        return found
    files = [path for source in sources.values() for path in source.files()]
    within = [path.relative_to(root).parts for path in files if path.is_relative_to(root)]
    first = {parts[0] for parts in within if len(parts) > 1}
    if len(within) < len(files) or len(first) != 1:
        return None
    folder = first.pop()
    found = detect_beside(root / folder, folders, tuple(sources))
    return (f"{folder}/{found[0]}", found[1]) if found is not None else None


def _mask_files(
    spec: CaptureSettings, sources: Mapping[str, FrameSource], required: bool
) -> tuple[str, list[Match]] | None:
    if spec.mask_files != "auto":
        matches = [match for match in find_files(spec.root, spec.mask_files) if match.camera in sources]
        if not matches:
            raise StudioError(
                "mask.not_found",
                f"no mask of the footage's cameras matches the pattern '{spec.mask_files}'",
                file=spec.root,
                value=spec.mask_files,
                fix="Check capture.mask_files.",
                setting="capture.mask_files",
            )
        return spec.mask_files, matches
    found = _beside(spec.root, MASK_FOLDERS, sources)
    if found is None and required:
        raise StudioError(
            "mask.not_found",
            "no mask files found",
            file=spec.root,
            fix="Set capture.mask_files, for example 'masks/{camera}/{frame}.png'.",
            setting="capture.mask_files",
        )
    return found


def _plates(
    spec: CaptureSettings, sources: Mapping[str, FrameSource], required: bool
) -> tuple[str, list[Match]] | None:
    if spec.clean_plates != "auto":
        matches = [match for match in find_files(spec.root, spec.clean_plates) if match.camera in sources]
        if not matches:
            raise StudioError(
                "mask.plates_not_found",
                f"no clean plate of the footage's cameras matches the pattern '{spec.clean_plates}'",
                file=spec.root,
                value=spec.clean_plates,
                fix="Check capture.clean_plates.",
                setting="capture.clean_plates",
            )
        return spec.clean_plates, matches
    found = _beside(spec.root, PLATE_FOLDERS, sources)
    if found is None and required:
        raise StudioError(
            "mask.plates_not_found",
            "no clean plates found",
            file=spec.root,
            fix="Set capture.clean_plates, for example 'clean_plates/{camera}.png'.",
            setting="capture.clean_plates",
        )
    return found


def _file_mask_source(
    matches: list[Match],
    names: tuple[str, ...],
    frames: tuple[int, ...],
    pool: DecoderPool,
    what: str,
    offsets: Mapping[str, int],
) -> FileMaskSource:
    mask_source = FileMaskSource(make_sources(matches, pool, offsets=offsets, transfer="srgb"))
    for name in names:
        missing = mask_source.missing(name, frames)
        if missing:
            raise StudioError(
                "mask.missing",
                f"Camera '{name}' has no {what} for {plural('frame', len(missing))} {number_ranges(missing)}",
                fix="Add the missing files, or exclude the camera or the frames.",
                camera=name,
                frames=tuple(missing),
                kind=what,
            )
    return mask_source


def exact_masks(
    spec: CaptureSettings, names: tuple[str, ...], frames: tuple[int, ...]
) -> tuple[MaskSource | None, str]:
    """The exact masks for evaluation, `spec.evaluation_masks`.

    Args:
        spec: the capture's settings.
        names: cameras of the footage.
        frames: frame numbers that must have a mask.

    Returns:
        their source and a sentence that describes it; None and "" if the setting is empty.

    Raises:
        StudioError: `mask.not_found`, or `mask.missing` for a camera or frame.
    """
    pattern = spec.evaluation_masks
    if not pattern:
        return None, ""
    matches = [match for match in find_files(spec.root, pattern) if match.camera in names]
    if not matches:
        raise StudioError(
            "mask.not_found",
            f"no evaluation mask matches the pattern '{pattern}'",
            file=spec.root,
            value=pattern,
            fix="Check capture.evaluation_masks.",
            setting="capture.evaluation_masks",
        )
    mask_source = _file_mask_source(matches, names, frames, DecoderPool(len(names)), "evaluation mask", spec.offsets)
    return mask_source, f"Evaluation within the exact masks '{pattern}'."
