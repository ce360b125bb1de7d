"""Which `MatteSource` a `CaptureSpec` asks for, and finding its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from studio.capture.checks import number_ranges
from studio.capture.detect import MASK_FOLDERS, PLATE_FOLDERS, detect_beside
from studio.capture.digest import digest_files
from studio.capture.frame_sources import DecoderPool, FrameSource, make_sources
from studio.capture.mattes.chroma_key import ChromaMatteSource, DespillingMatteSource
from studio.capture.mattes.clean_plate import DifferenceSettings
from studio.capture.mattes.garbage_mattes import garbage_mattes
from studio.capture.mattes.matte_cache import MatteCache
from studio.capture.mattes.matte_source import (
    AlphaMatteSource,
    FileMatteSource,
    FullMatteSource,
    MatteSource,
    PlateMatteSource,
    plates_from_files,
)
from studio.capture.mattes.matting_function import FunctionMatteSource
from studio.capture.mattes.median_background import Background, cached_background, estimate_background
from studio.capture.mattes.onnx_model import OnnxModel, OnnxSettings
from studio.capture.mattes.plain_background import PlainMatteSource, plain_color
from studio.capture.patterns import Match, find_files, natural_key
from studio.capture.spec import CaptureSpec
from studio.errors import StudioError

_FEW_FRAMES = 10  # below this too little of the set is seen behind the performer


def mask_source(
    spec: CaptureSpec,
    sources: Mapping[str, FrameSource],
    frames: tuple[int, ...],
    pool: DecoderPool,
    cache_folder: Path | None,
) -> tuple[MatteSource, str]:
    """The source of mattes that `spec.masks` asks for, and a sentence on it.

    Raises:
        StudioError: it is not there, or lacks a camera or frame.
    """
    kind = spec.masks
    names = tuple(sources)
    if kind in ("alpha", "auto") and all(source.has_alpha for source in sources.values()):
        return AlphaMatteSource(), "Masks: the images' alpha channel."
    if kind == "alpha":
        bare = next(name for name, source in sources.items() if not source.has_alpha)
        raise StudioError(f"Masks are to come from the alpha channel, but the images of camera '{bare}' have none.")
    if kind in ("files", "auto"):
        found = _mask_files(spec, names, required=kind == "files")
        if found is not None:
            pattern, matches = found
            return _file_matte_source(matches, names, frames, pool, "mask", spec.offsets), f"Masks: files '{pattern}'."
    if kind in ("clean_plate", "auto"):
        found = _plates(spec, names, required=kind == "clean_plate")
        if found is not None:
            pattern, matches = found
            without = sorted(set(names) - {match.camera for match in matches}, key=natural_key)
            if without:
                raise StudioError(
                    f"Camera '{without[0]}' has no clean plate ('{pattern}'); add it, or leave the camera out."
                )
            load = plates_from_files(matches, spec.color_matrix)
            paths = [match.path for match in matches]
            matte_source = PlateMatteSource(load, paths, _difference(spec))
            return matte_source, f"Masks: difference to the clean plates '{pattern}'."
    if kind == "chroma_key":
        return _chroma(spec, sources, pool), "Masks: what has not the color of the screen."
    if kind == "model":
        return _model(spec, names, pool, cache_folder), f"Masks: by the model {spec.mask_model}."
    if kind == "plain" or (kind == "auto" and _before_plain(sources)):
        return PlainMatteSource(
            lambda camera: _first(sources[camera])
        ), "Masks: what has not the plain color behind it."
    count = min(len(source.frames) for source in sources.values())
    if kind == "median_background" and count < 3:
        raise StudioError(
            f"A median background needs at least 3 frames, but the footage has {count}; give masks or clean plates."
        )
    if kind == "median_background" or (kind == "auto" and count >= _FEW_FRAMES):

        def behind(camera: str) -> Background:
            source = sources[camera]

            def read(frame: int) -> np.ndarray:
                return source.read(frame)[:, :, :3]

            key = f"{digest_files(spec.root, source.files())[:24]}_{spec.color_matrix}" if cache_folder else ""
            return cached_background(cache_folder, key, lambda: estimate_background(read, source.frames))

        paths = [path for source in sources.values() for path in source.files()]
        matte_source = PlateMatteSource(behind, paths, _difference(spec))
        return matte_source, "Masks: difference to the set as recovered from the footage."
    return FullMatteSource(), "Masks: none, everything is foreground."


def _first(source: FrameSource) -> np.ndarray:
    return source.read(source.frames[0])[:, :, :3]


def _before_plain(sources: Mapping[str, FrameSource]) -> bool:
    """Whether the performer was cut out and put before one color: three cameras are asked."""
    some = list(sources.values())
    try:
        return all(plain_color(_first(source)) is not None for source in {some[0], some[len(some) // 2], some[-1]})
    except StudioError:  # a broken file is told of where it is needed
        return False


def _chroma(spec: CaptureSpec, sources: Mapping[str, FrameSource], pool: DecoderPool) -> ChromaMatteSource:
    def read(camera: str, frame: int) -> np.ndarray:
        return sources[camera].read(frame)[:, :, :3]

    key = None if isinstance(spec.key_color, str) else spec.key_color
    kind = DespillingMatteSource if spec.despill else ChromaMatteSource
    garbage = garbage_mattes(spec, tuple(sources), pool)
    return kind(read, lambda camera: sources[camera].frames, key, _difference(spec), garbage)


def _model(
    spec: CaptureSpec, names: tuple[str, ...], pool: DecoderPool, cache_folder: Path | None
) -> FunctionMatteSource:
    if not spec.mask_model:
        raise StudioError("Masks are to come from a model, but none is given; set mask_model to its ONNX file.")
    path = spec.root / Path(spec.mask_model).expanduser()
    settings = OnnxSettings(
        spec.mask_model_size,
        spec.mask_model_mean,
        spec.mask_model_std,
        spec.mask_model_sigmoid,
        spec.mask_device,
        spec.mask_threads,
    )
    model = OnnxModel(path, settings)
    kept = None
    if cache_folder is not None:
        recipe = replace(settings, device="", threads=0)  # where it runs does not decide the mattes
        kept = MatteCache(cache_folder / "mattes", f"{digest_files(path.parent, model.files())} {recipe}")
    return FunctionMatteSource(
        model,
        f"The matting model {path}",
        files=model.files(),
        kept=kept,
        components=spec.mask_components,
        garbage=garbage_mattes(spec, names, pool),
    )


def _difference(spec: CaptureSpec) -> DifferenceSettings:
    return DifferenceSettings(spec.mask_sensitivity, spec.mask_components, spec.mask_shadows)


def _mask_files(spec: CaptureSpec, names: tuple[str, ...], required: bool) -> tuple[str, list[Match]] | None:
    if spec.mask_files != "auto":
        matches = [match for match in find_files(spec.root, spec.mask_files) if match.camera in names]
        if not matches:
            raise StudioError(f"{spec.root}: no mask of the footage's cameras fits the pattern '{spec.mask_files}'.")
        return spec.mask_files, matches
    found = detect_beside(spec.root, MASK_FOLDERS, names)
    if found is None and required:
        raise StudioError(
            f"{spec.root}: no mask files were found; say where they are, mask_files: 'masks/{{camera}}.png'."
        )
    return found


def _plates(spec: CaptureSpec, names: tuple[str, ...], required: bool) -> tuple[str, list[Match]] | None:
    if spec.clean_plates != "auto":
        matches = [match for match in find_files(spec.root, spec.clean_plates) if match.camera in names]
        if not matches:
            raise StudioError(f"{spec.root}: no clean plate of the footage's cameras fits '{spec.clean_plates}'.")
        return spec.clean_plates, matches
    found = detect_beside(spec.root, PLATE_FOLDERS, names)
    if found is None and required:
        raise StudioError(
            f"{spec.root}: no clean plates were found; say where they are, clean_plates: 'clean_plates/{{camera}}.png'."
        )
    return found


def _file_matte_source(
    matches: list[Match],
    names: tuple[str, ...],
    frames: tuple[int, ...],
    pool: DecoderPool,
    what: str,
    offsets: Mapping[str, int],
) -> FileMatteSource:
    matte_source = FileMatteSource(make_sources(matches, pool, offsets=offsets))
    for name in names:
        missing = matte_source.missing(name, frames)
        if missing:
            frames_in_words = f"frame{'s' if len(missing) > 1 else ''} {number_ranges(missing)}"
            raise StudioError(
                f"Camera '{name}' has no {what} for {frames_in_words}; add the missing files or leave the "
                "camera or the frames out."
            )
    return matte_source


def exact_mattes(spec: CaptureSpec, names: tuple[str, ...], frames: tuple[int, ...]) -> tuple[MatteSource | None, str]:
    """`spec.evaluation_mattes` of the named cameras, and a sentence on them; None where there are none.

    Raises:
        StudioError: the pattern fits nothing, or a camera or frame lacks its matte.
    """
    pattern = spec.evaluation_mattes
    if not pattern:
        return None, ""
    matches = [match for match in find_files(spec.root, pattern) if match.camera in names]
    if not matches:
        raise StudioError(f"{spec.root}: no evaluation matte fits the pattern '{pattern}'.")
    matte_source = _file_matte_source(matches, names, frames, DecoderPool(len(names)), "evaluation matte", spec.offsets)
    return matte_source, f"Measured within the exact mattes '{pattern}'."
