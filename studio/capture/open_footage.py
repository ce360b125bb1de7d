"""From a `CaptureSpec` to `Footage`: find the files, match them with the rig, choose frames and masks."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from studio.cameras import Camera, Rig
from studio.capture.checks import number_ranges
from studio.capture.detect import detect_images
from studio.capture.footage import Footage
from studio.capture.frame_sources import DecoderPool, FrameSource, decoder_limit, make_sources
from studio.capture.lru_cache import ByteCache
from studio.capture.mattes.choose import exact_mattes, mask_source
from studio.capture.patterns import Match, find_files, natural_key
from studio.capture.spec import CaptureSpec
from studio.capture.warp import Warp, fit_size
from studio.errors import StudioError


def open_footage(
    spec: CaptureSpec, rig: Rig | None = None, *, strict: bool = True, cache_folder: Path | None = None
) -> Footage:
    """Open a capture. Finds and opens its files, reads one frame a camera, and decodes the rest when asked.

    Args:
        spec: where it lies and how to read it.
        rig: its cameras, with lens distortion, at the size they were calibrated at; None before calibration
            (`Footage.image` is then scaled only, and `Footage.rig` raises). Names must be those of the footage; a file
            extension in a rig's name (COLMAP has them) is passed over.
        strict: raise where cameras lack frames that others have. Otherwise such problems stand in
            `Footage.problems`, and `Footage.frames` are those that all cameras have.
        cache_folder: where backgrounds recovered from the footage (masks "median_background") and mattes made by a
            model are kept, so that another process need not make them again; None keeps them in memory only.

    Raises:
        StudioError: nothing found, a file cannot be opened, two files for one camera and frame, cameras of rig and
            footage differ, sizes that do not fit the calibration, an unknown camera name in the settings, frames or
            masks missing.
    """
    if not spec.root.is_dir():
        raise StudioError(f"The capture folder {spec.root} is not there; give its folder in capture.root.")
    pattern, matches = _find_images(spec)
    matches = _chosen(spec, matches)
    pool = DecoderPool(4)
    try:
        sources = make_sources(matches, pool, spec.color_matrix, spec.offsets)
    except BaseException:
        pool.close()
        raise
    pool.limit = min(decoder_limit(source.width, source.height) for source in sources.values())
    refuse_unknown_cameras(tuple(spec.offsets), tuple(sources), "The setting offsets")
    frames, problems = _frames(spec, sources)
    if strict and problems:
        raise StudioError(problems[0] if len(problems) == 1 else f"{problems[0]} ({len(problems) - 1} more like it.)")
    fps, fps_note = _fps(spec, sources)
    notes = [_found(spec, pattern, sources, frames), fps_note]
    cache = ByteCache(spec.cache_bytes if spec.cache_bytes is not None else _cache_bytes())
    warps = _warps(spec, rig, sources, frames, notes) if rig is not None else None
    held_out = _held_out(spec, tuple(sources))
    masked = frames if strict else ()  # frames that must have their mask
    matte_source, mask_note = mask_source(spec, sources, masked, pool, cache_folder)
    exact, exact_note = exact_mattes(spec, tuple(sources), masked)
    notes += [mask_note, exact_note]
    if held_out:
        notes.append(f"Held out: {', '.join(held_out)}.")
    description = "\n".join(note for note in notes if note)
    return Footage(
        spec, sources, frames, held_out, fps, matte_source, exact, warps, pool, cache, description, tuple(problems)
    )


def _cache_bytes() -> int:
    import psutil

    return int(min(2 << 30, psutil.virtual_memory().total // 8))


def _find_images(spec: CaptureSpec) -> tuple[str, list[Match]]:
    if spec.images == "auto":
        return detect_images(spec.root)
    matches = find_files(spec.root, spec.images)
    if not matches:
        raise StudioError(f"{spec.root}: no image or video fits the pattern '{spec.images}'.")
    return spec.images, matches


def refuse_unknown_cameras(names: Sequence[str], known: Sequence[str], where: str) -> None:
    """See to it that settings name cameras that there are.

    Args:
        names: what they name.
        known: the footage's cameras.
        where: begins the sentence, as in "The setting held_out".

    Raises:
        StudioError: one is not there.
    """
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"did you mean '{near[0]}'? There" if near else "there"
            raise StudioError(
                f"{where} names camera '{name}', which the footage has not; {hint} is {', '.join(known)}."
            )


def _chosen(spec: CaptureSpec, matches: list[Match]) -> list[Match]:
    if not spec.cameras:
        return matches
    known = list(dict.fromkeys(match.camera for match in matches))
    refuse_unknown_cameras(spec.cameras, known, "The setting cameras")
    return [match for match in matches if match.camera in spec.cameras]


def _frames(spec: CaptureSpec, sources: Mapping[str, FrameSource]) -> tuple[tuple[int, ...], list[str]]:
    """The frames that all cameras have within start, stop and step, and sentences on those that some lack."""

    def inside(frame: int, first: int) -> bool:
        low = spec.start if spec.start is not None else first
        return frame >= low and (spec.stop is None or frame < spec.stop) and (frame - low) % spec.step == 0

    everything = sorted(set().union(*(source.frames for source in sources.values())))
    if spec.offsets:  # what late cameras lack at the ends is no fault of the footage
        shared = set(everything).intersection(*(source.frames for source in sources.values()))
        everything = [frame for frame in everything if shared and min(shared) <= frame <= max(shared)] or everything
    wanted = [frame for frame in everything if inside(frame, everything[0])]
    if not wanted:
        raise StudioError(
            f"{spec.root}: the footage has frames {everything[0]} to {everything[-1]}, none of which lies in the range "
            f"asked for (start {spec.start}, stop {spec.stop}, step {spec.step})."
        )
    common = set(wanted).intersection(*(source.frames for source in sources.values()))
    problems = []
    for camera, source in sources.items():
        have = set(source.frames)
        missing = [frame for frame in wanted if frame not in have]
        if not missing:
            continue
        if missing == wanted[-len(missing) :] and len(missing) < len(wanted):
            problems.append(
                f"Camera '{camera}' ends after frame {source.frames[-1]}, but others go on to frame {wanted[-1]}; mend "
                f"the footage, or set stop to {source.frames[-1] + 1} to use what all cameras have."
            )
        else:
            problems.append(
                f"Camera '{camera}' has no frame {number_ranges(missing)}, which other cameras have; add the missing "
                "files, or leave the camera or the frames out."
            )
    frames = tuple(frame for frame in wanted if frame in common)
    if not frames and not problems:
        raise StudioError(f"{spec.root}: there is no frame that all cameras have.")
    return frames, problems


def _fps(spec: CaptureSpec, sources: Mapping[str, FrameSource]) -> tuple[float, str]:
    if spec.fps is not None:
        return spec.fps, ""
    rates = {camera: source.fps for camera, source in sources.items() if source.fps}
    if not rates:
        several = max(len(source.frames) for source in sources.values()) > 1
        return 30.0, "The files do not say how many frames a second; 30 are taken (set fps)." if several else ""
    slowest, fastest = min(rates, key=lambda name: rates[name]), max(rates, key=lambda name: rates[name])
    if rates[fastest] > 1.005 * rates[slowest]:
        raise StudioError(
            f"Camera '{slowest}' runs at {rates[slowest]:g} frames a second and '{fastest}' at {rates[fastest]:g}; "
            "synchronized footage has one rate: convert it, or set fps to say that the frames do correspond."
        )
    return float(rates[fastest]), ""


def _found(spec: CaptureSpec, pattern: str, sources: Mapping[str, FrameSource], frames: tuple[int, ...]) -> str:
    sizes = sorted({(source.width, source.height) for source in sources.values()})
    size = " and ".join(f"{width}x{height}" for width, height in sizes)
    span = "no common frame"
    if frames:
        span = f"frame {frames[0]}" if len(frames) == 1 else f"{len(frames)} frames ({frames[0]} to {frames[-1]})"
    return f"Footage '{pattern}' below {spec.root}: {len(sources)} cameras, {span}, {size}."


def _stem(name: str) -> str:
    return Path(name.replace("\\", "/")).stem if "." in name else name


def match_rig(rig: Rig, names: Sequence[str]) -> dict[str, Camera]:
    """The rig's camera of each name, renamed to it: by equal names, else by names without extension and folder.

    Raises:
        StudioError: a camera of the footage is not in the rig, or the other way round.
    """
    cameras = {camera.name: camera for camera in rig}
    if not set(names) <= set(cameras):
        stems: dict[str, Camera] = {}
        for camera in rig:
            if _stem(camera.name) in stems:
                stems = cameras
                break
            stems[_stem(camera.name)] = camera
        if len(set(names) & set(stems)) > len(set(names) & set(cameras)):
            cameras = stems
    without = [name for name in names if name not in cameras]
    if without:
        raise StudioError(
            f"The footage has camera '{without[0]}'"
            + (f" and {len(without) - 1} more" if len(without) > 1 else "")
            + f" that the calibration does not know (it has {', '.join(sorted(cameras, key=natural_key))}); rename the "
            "files, calibrate again, or list the cameras to use in the setting cameras."
        )
    extra = [name for name in cameras if name not in names]
    if extra:
        raise StudioError(
            f"The calibration has camera '{extra[0]}'"
            + (f" and {len(extra) - 1} more" if len(extra) > 1 else "")
            + " of which there is no footage; add the missing files, or list the cameras to use in the setting cameras."
        )
    return {name: replace(cameras[name], name=name) for name in names}


def _warps(
    spec: CaptureSpec, rig: Rig, sources: Mapping[str, FrameSource], frames: tuple[int, ...], notes: list[str]
) -> dict[str, Warp]:
    names = tuple(sources)
    if spec.cameras:
        kept = [camera for camera in rig if camera.name in names or _stem(camera.name) in names]
        rig = Rig(tuple(kept))
    warps = {}
    for name, camera in match_rig(rig, names).items():
        source = sources[name]
        same = source.width * camera.height == source.height * camera.width
        image = None if same else source.read(source.frames[0])[:, :, :3]
        fit = fit_size(camera, source.width, source.height, spec.size_rule, image)
        if fit.note:
            notes.append(fit.note[0].upper() + fit.note[1:] + ".")
        warps[name] = Warp(camera, source.width, source.height, spec.scale, fit)
    return warps


def _held_out(spec: CaptureSpec, names: tuple[str, ...]) -> tuple[str, ...]:
    refuse_unknown_cameras(spec.held_out, names, "The setting held_out")
    nth = set(names[spec.held_out_every - 1 :: spec.held_out_every]) if spec.held_out_every else set()
    chosen = tuple(name for name in names if name in nth or name in spec.held_out)
    if len(chosen) == len(names):
        raise StudioError(f"All {len(names)} cameras are held out; leave at least one to train on.")
    return chosen
