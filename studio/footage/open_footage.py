"""Opens `Footage`: finds the files, matches cameras with the rig, selects frames and the mask source."""

import difflib
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from functools import partial
from pathlib import Path

from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.capture.detect import chapters_of_one, detect_images, parts_pattern
from v3studio.studio.capture.frame_sources import DecoderPool, FrameSource, ImageSource, decoder_limit, make_sources
from v3studio.studio.capture.patterns import (
    OTHER_EXTENSIONS,
    Match,
    find_files,
    number_ranges,
    refuse_other_kinds,
)
from v3studio.studio.capture.settings import EVERY, CaptureSettings
from v3studio.studio.counts import cameras_listed, counted, listed, plural
from v3studio.studio.errors import Message, StudioError, shown
from v3studio.studio.footage.footage import Footage
from v3studio.studio.footage.matching import refuse_missing, rig_of_footage
from v3studio.studio.footage.sound import find_sound
from v3studio.studio.footage.warp import Warp, fit_size
from v3studio.studio.masks.corrections import MaskClick
from v3studio.studio.masks.garbage_masks import garbage_masks
from v3studio.studio.masks.mask_files import exact_masks
from v3studio.studio.masks.mask_source import MaskInputs, masked_cameras
from v3studio.studio.masks.sources import given_plates, open_mask_source
from v3studio.studio.memory import memory_limit
from v3studio.studio.memory_cache import image_cache
from v3studio.studio.storage import is_address, mirrored
from v3studio.studio.yaml_text import inline_yaml

_MOST_APART = 0.5  # frames
_SUGGESTED_STEP = 8  # of so many cameras, one is suggested to be held out


def open_footage(
    spec: CaptureSettings,
    rig: Rig | None = None,
    *,
    strict: bool = True,
    cache_folder: Path | str | None = None,
    device: str = "auto",
    threads: int = 0,
    most_cached: int | None = None,
    every_camera: bool = False,
    evaluation_masks: str | None = None,
    without_masks: Sequence[str] = (),
    mask_clicks: Sequence[MaskClick] = (),
    votes: bool = True,
) -> Footage:
    """Open a capture: find and open its files and read one frame per camera. Other frames are decoded on demand.

    Example:
        >>> footage = v3.open_footage(v3.CaptureSettings(root="footage"), v3.read_rig("footage"))
        >>> view = footage.view("cam0", footage.frames[0])
        >>> len(footage.frames), footage.camera_names[:2], view.image.shape, view.mask.shape
        (5, ('cam0', 'cam1'), (48, 64, 3), (48, 64))

    Args:
        spec: where the capture is and how to read it. Of a capture in object storage, the files are listed here, and
            read when their frames are.
        rig: the cameras, with lens distortion, at the size they were calibrated at; None before calibration
            (`Footage.image` is then only scaled, and `Footage.rig` raises). Names must match the footage; a file
            extension in a rig's camera name, as COLMAP writes it, is ignored.
        strict: raise if cameras lack frames that others have. Otherwise, `Footage.problems` lists such problems, and
            `Footage.frames` contains only the frames that all cameras have.
        cache_folder: where to cache backgrounds estimated from the footage, and masks that are agreed or from a matting
            model, for other processes; None caches them in memory only.
        device, threads: device and CPU threads of a matting model, as in `MattingModel`.
        most_cached: bytes that decoded images may take, if that is less than what the settings allow; None: no such
            limit.
        every_camera: raise if the footage lacks a camera of the rig, as files that are not mounted do. Otherwise, those
            cameras are left out. With `spec.cameras`, they always are.
        evaluation_masks: pattern of exact masks for `Footage.evaluation_mask`, relative to `spec.root`; None: there are
            none.
        without_masks: cameras that are known to have no masks, `Footage.without_masks` before calibration. They are not
            expected in `rig`.
        mask_clicks: corrections of masks by hand, see `studio.masks.corrections`.
        votes: whether cameras agree on masks that are found in the images. Each camera's own are quicker to make, and
            say more about the cameras.

    Raises:
        StudioError: `footage.*`: no files found, a file cannot be opened, two files for the same camera and frame, an
            unknown camera in the settings, missing frames, or an aspect ratio that differs from the calibration's;
            `calibration.camera_missing`, `footage.camera_missing`; `mask.*`: masks are missing; `storage.*`.
    """
    cache_folder = None if cache_folder is None else Path(cache_folder)
    spec = on_this_machine(spec)
    pattern, matches = _find_images(spec)
    matches, counter_note = _own_counters(matches)
    names = known = tuple(dict.fromkeys(match.camera for match in matches))
    if spec.cameras:
        refuse_unknown_cameras(spec.cameras, names, "capture.cameras")
        matches = [match for match in matches if match.camera in spec.cameras]
        names = tuple(name for name in names if name in spec.cameras)
    if every_camera and rig is not None and not spec.cameras:
        refuse_missing(rig, names)
    held_out = held_out_cameras(spec, names)
    if rig is not None:
        rig = rig_of_footage(rig, spec, [name for name in names if name not in without_masks], without_masks, known)
        matches = [match for match in matches if match.camera in rig]
        held_out = tuple(name for name in held_out if name in rig)
    pool = DecoderPool(4)
    try:
        sources = make_sources(matches, pool, spec.offsets, spec.transfer, spec.color_matrix)
    except BaseException:
        pool.close()
        raise
    pool.limit = min(decoder_limit(source.width, source.height) for source in sources.values())
    refuse_unknown_cameras(tuple(spec.offsets), names, "capture.offsets")
    frames, problems = _frames(spec, sources)
    if strict and problems:
        raise _all_of(problems)
    rate, fps_note = _fps(spec, sources, max(frames, default=0))
    sound = find_sound(spec, sources, rate)
    notes = [_found(spec, pattern, sources, frames), counter_note, _video_notes(sources)]
    choices = [fps_note]
    if sound is not None:
        notes.append(f"Sound: {sound.path.name}, {sound.file.description}.")
    limit = min(2 << 30, memory_limit() // 8)
    cache = image_cache(limit if most_cached is None else min(limit, most_cached))
    masked = frames if strict else ()  # frames that must have a mask
    garbage = garbage_masks(spec, tuple(sources), pool)
    cameras = partial(_raw_cameras, spec, rig, sources) if rig is not None and votes else None
    inputs = MaskInputs(spec, sources, masked, held_out, pool, cache_folder, device, threads, garbage, cameras)
    mask_source, mask_note = open_mask_source(inputs)
    notes.append(mask_note)
    masked_names = masked_cameras(mask_source, tuple(sources))
    unmasked = [name for name in sources if name not in masked_names]
    sources = _with_masks(spec, sources, unmasked, held_out)
    left_out = tuple(name for name in names if name not in sources and name in (*without_masks, *unmasked))
    if left_out:
        choices.append(f"Without masks, so not used: {cameras_listed(left_out)}. To use them, add masks.")
    unmeasured = [name for name in unmasked if name in held_out]
    if unmeasured:
        notes.append(f"Held out without masks, so no quality is measured there: {cameras_listed(unmeasured)}.")
    warps = _warps(spec, rig, sources, notes) if rig is not None else None
    exact, exact_note = exact_masks(spec, evaluation_masks, held_out or tuple(sources), masked)
    notes.append(exact_note)
    choices.append(_held_out_note(held_out, tuple(sources)))
    return Footage(
        spec, sources, frames, held_out, rate / spec.frame_range[2], mask_source, exact, warps, pool, cache,
        tuple(filter(None, notes)), tuple(filter(None, choices)), tuple(problems), sound, garbage, left_out,
        tuple(name for name in known if name not in names), tuple(mask_clicks), given_plates(inputs, mask_source),
    )  # fmt: skip


def _held_out_note(held_out: Sequence[str], names: Sequence[str]) -> str:
    if held_out:
        return f"Held out: {', '.join(held_out)}."
    if len(names) < 2:
        return ""
    return (
        "No camera is held out, so quality is measured on training cameras. To measure new views: "
        f"capture.held_out: {inline_yaml(list(suggested_held_out(names)))}."
    )


def suggested_held_out(names: Sequence[str]) -> tuple[str, ...]:
    """The cameras to hold out for evaluation if nothing else is known of them: every eighth of several."""
    if len(names) < 2:
        return ()
    return tuple(names[_SUGGESTED_STEP - 1 :: _SUGGESTED_STEP] or names[-1:])


def _with_masks(
    spec: CaptureSettings, sources: Mapping[str, FrameSource], unmasked: Sequence[str], held_out: Sequence[str]
) -> dict[str, FrameSource]:
    """The sources, without cameras that need masks but have none, as a source of one's own or mask files may lack."""
    left_out = [name for name in unmasked if name not in held_out]
    if not (isinstance(spec.masks, str) and ":" in spec.masks) and (
        spec.masks != "auto" or 2 * len(left_out) > len(sources)
    ):
        left_out = []
    if left_out and len(left_out) + len(held_out) == len(sources):
        problem = f"{spec.masks} has no masks of the training cameras"
        fix = f"Name some of them in the source's attribute `cameras`: {', '.join(left_out)}."
        raise StudioError("mask.no_camera", problem, value=spec.masks, fix=fix, setting="capture.masks")
    return {name: source for name, source in sources.items() if name not in left_out}


def on_this_machine(spec: CaptureSettings) -> CaptureSettings:
    """The settings; `root` is the local mirror if the capture is in object storage."""
    return spec.replace(root=mirrored(spec.root)) if is_address(spec.root) else spec


def _find_images(spec: CaptureSettings) -> tuple[str, list[Match]]:
    if not spec.root.is_dir():
        problem = "the folder of the footage was not found"
        fix = "Set capture.root to where it is."
        raise StudioError("footage.folder_missing", problem, file=spec.root, fix=fix, setting="capture.root")
    if spec.images == "auto":
        return detect_images(spec.root)
    matches = find_files(spec.root, spec.images)
    if not matches:
        others = find_files(spec.root, spec.images, OTHER_EXTENSIONS)
        refuse_other_kinds(spec.root, [match.path.name for match in others])
        problem = f"no image or video matches the pattern '{spec.images}'"
        fix = f"Check capture.images.{_instead(spec.root)}"
        raise StudioError(
            "footage.not_found", problem, file=spec.root, value=spec.images, fix=fix, setting="capture.images"
        )
    return spec.images, matches


def _own_counters(matches: list[Match]) -> tuple[list[Match], str]:
    """The matches, numbered from 0 if each camera counts its images without gaps from a number of its own; and a note
    on that, or ""."""
    numbers: dict[str, list[int]] = {}
    for match in matches:
        if match.frame is not None and not match.chapter:
            numbers.setdefault(match.camera, []).append(match.frame)
    counts = {len(own) for own in numbers.values()}
    every = [number for own in numbers.values() for number in own]
    if len(numbers) < 2 or len(counts) > 1 or len(set(every)) < len(every) or len(every) < 2 * len(numbers):
        return matches, ""
    if any(max(own) - min(own) + 1 > len(own) for own in numbers.values()):
        return matches, ""
    first = {camera: min(own) for camera, own in numbers.items()}
    note = "Each camera counts its images from a number of its own: the first ones are taken as of the same time."
    return [replace(match, frame=(match.frame or 0) - first[match.camera]) for match in matches], note


def _instead(root: Path) -> str:
    """The layout that `auto` would find, as a sentence with a space before it."""
    try:
        pattern, matches = detect_images(root)
    except (StudioError, OSError):  # nothing there, or no folder
        return ""
    return f" '{pattern}' matches {counted(len(matches), 'file')}."


def refuse_unknown_cameras(names: Sequence[str], known: Sequence[str], setting: str) -> None:
    """Check that a setting, such as "capture.held_out", names existing cameras; StudioError `footage.unknown_camera`,
    with the fields `setting`, `known` and `suggestion` (may be None)."""
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"Did you mean '{near[0]}'? " if near else ""
            raise StudioError(
                "footage.unknown_camera",
                f"{setting}: no camera '{name}' in the footage",
                value=name,
                fix=f"{hint}Cameras: {', '.join(known)}.",
                setting=setting,
                known=tuple(known),
                suggestion=near[0] if near else None,
            )


def _all_of(problems: Sequence[Message]) -> StudioError:
    """The first problem as an error; its text includes the number of the others."""
    first = problems[0]
    more = f" ({len(problems) - 1} more like this)" if len(problems) > 1 else ""
    return StudioError.of(replace(first, problem=first.problem + more))


def _frames(spec: CaptureSettings, sources: Mapping[str, FrameSource]) -> tuple[tuple[int, ...], list[Message]]:
    """The frames of `spec.frames` that all cameras have, and one problem per camera that lacks some."""
    start, stop, step = spec.frame_range

    def inside(frame: int, first: int) -> bool:
        low = first if start is None else start
        return frame >= low and (stop is None or frame < stop) and (frame - low) % step == 0

    every_frame = sorted(set().union(*(source.frames for source in sources.values())))
    if spec.offsets:  # frames missing at the ends of shifted cameras are not an error
        shared = set(every_frame).intersection(*(source.frames for source in sources.values()))
        every_frame = [frame for frame in every_frame if shared and min(shared) <= frame <= max(shared)] or every_frame
    wanted = [frame for frame in every_frame if inside(frame, every_frame[0])]
    if not wanted:
        raise StudioError(
            "footage.no_frames",
            f"no frames in capture.frames = {spec.frames}; the footage has {every_frame[0]} to {every_frame[-1]}",
            file=spec.root,
            fix="Change capture.frames.",
            setting="capture.frames",
            available=(every_frame[0], every_frame[-1]),
        )
    common = set(wanted).intersection(*(source.frames for source in sources.values()))
    problems = []
    trimmed = _common_span(spec, wanted, common)
    for camera, source in sources.items():
        have = set(source.frames)
        missing = [frame for frame in wanted if frame not in have]
        if not missing:
            continue
        if missing == wanted[-len(missing) :] and len(missing) < len(wanted):
            last = source.frames[-1]
            problem = f"Camera '{camera}' ends after frame {last}, but others continue to frame {wanted[-1]}"
            fix = f"Replace its footage{trimmed or ', or exclude the camera'}."
            fields = {"camera": camera, "expected": wanted[-1], "setting": "capture.frames"}
            problems.append(Message("footage.camera_ends_early", problem, value=last, fix=fix, fields=fields))
        else:
            frames_lacking = f"{plural('frame', len(missing))} {number_ranges(missing)}"
            problem = f"Camera '{camera}' lacks {frames_lacking}, which other cameras have"
            fix = f"Add the missing files{trimmed or ', or exclude the camera or the frames'}."
            problems.append(
                Message("footage.frames_missing", problem, fix=fix, fields={"camera": camera, "frames": tuple(missing)})
            )
    frames = tuple(frame for frame in wanted if frame in common)
    if not frames and not problems:
        raise StudioError("footage.no_common_frame", "no frame is available from all cameras", file=spec.root)
    return frames, problems


def _common_span(spec: CaptureSettings, wanted: Sequence[int], common: Set[int]) -> str:
    """Advice to use only the frames that all cameras have, as the end of a sentence; "" if a range cannot say that."""
    span = [frame for frame in wanted if common and min(common) <= frame <= max(common)]
    if not span or len(span) > len(common & set(wanted)):
        return ""
    start, stop, step = spec.frame_range
    first = span[0] if span[0] > wanted[0] or start is not None or step > 1 else ""
    last = span[-1] + 1 if span[-1] < wanted[-1] or stop is not None else ""
    every = f":{step}" if step > 1 else ""
    return f", or set capture.frames to {first}:{last}{every} to use only common frames"


def _fps(spec: CaptureSettings, sources: Mapping[str, FrameSource], last: int) -> tuple[float, str]:
    """The frame rate, and a note on it. Rates of videos must keep frames of one number, up to `last`, together."""
    if spec.fps is not None:
        return spec.fps, ""
    rates = {camera: source.fps for camera, source in sources.items() if source.fps}
    if not rates:
        several = max(len(source.frames) for source in sources.values()) > 1
        return 30.0, "The files do not specify a frame rate: using 30 fps (set capture.fps)." if several else ""
    slowest, fastest = min(rates, key=lambda name: rates[name]), max(rates, key=lambda name: rates[name])
    apart = (rates[fastest] / rates[slowest] - 1) * last  # frames
    if rates[fastest] > 1.005 * rates[slowest] or apart > _MOST_APART:
        problem = f"Camera '{slowest}' has {rates[slowest]:g} fps and camera '{fastest}' {rates[fastest]:g} fps"
        problem += f", so that their frames {last} are {apart:.1f} frames apart"
        value = (rates[slowest], rates[fastest])
        fix = (
            f"Convert all videos to one frame rate (ffmpeg -i IN -fps_mode cfr -r {rates[fastest]:g} OUT), or set "
            "capture.fps if frames of the same number do correspond."
        )
        raise StudioError(
            "footage.fps_mismatch", problem, value=value, fix=fix, cameras=(slowest, fastest), setting="capture.fps"
        )
    return float(rates[fastest]), ""


def _video_notes(sources: Mapping[str, FrameSource]) -> str:
    """Notes on unusual videos, one line for all cameras with the same note."""
    cameras: dict[str, list[str]] = {}
    for camera, source in sources.items():
        if source.note:
            cameras.setdefault(source.note, []).append(camera)
    lines = []
    for note, names in cameras.items():
        every = len(names) == len(sources) and len(names) > 1
        lines.append(f"{f'All {len(names)} cameras' if every else cameras_listed(names, 'Camera')}: {note}.")
    return "\n".join(lines)


def _found(spec: CaptureSettings, pattern: str, sources: Mapping[str, FrameSource], frames: tuple[int, ...]) -> str:
    sizes = sorted({(source.width, source.height) for source in sources.values()})
    size = " and ".join(f"{width}x{height}" for width, height in sizes)
    span = "no common frames"
    if frames:
        span = f"frame {frames[0]}" if len(frames) == 1 else f"{len(frames)} frames ({frames[0]} to {frames[-1]})"
    sentence = f"Footage '{pattern}' in {shown(str(spec.root))}: {counted(len(sources), 'camera')}, {span}, {size}."
    stills = spec.images == "auto" and all(isinstance(source, ImageSource) for source in sources.values())
    counts = {len(source.frames) for source in sources.values()}
    if stills and len(sources) > 1 and counts == {1}:
        sentence += " Each image is a camera of its own; if they are frames, set capture.images."
    elif stills and len(sources) == 1 and max(counts) > 1:
        sentence += " All images are frames of one camera; if they are of several, set capture.images."
    elif spec.images == "auto" and len(sources) > 1 and not stills:
        files = [source.files()[0].relative_to(spec.root).as_posix() for source in sources.values()]
        parts = parts_pattern(files)
        chapters = chapters_of_one(files)
        if chapters:
            sentence += (
                f" {listed(list(map(repr, chapters)))} are named as parts of one recording, but each is a camera here: "
                "put the files of each camera into a folder of its own."
            )
        elif parts is not None:
            sentence += f" Each video is a camera; if they are parts of recordings, set capture.images to '{parts}'."
    return sentence


def _warps(spec: CaptureSettings, rig: Rig, sources: Mapping[str, FrameSource], notes: list[str]) -> dict[str, Warp]:
    notes.extend(rig.notes)
    warps = {}
    for name, source in sources.items():
        camera = rig[name]
        first = partial(source.read, source.frames[0])
        try:
            fit = fit_size(camera, source.width, source.height, spec.size_rule, first)
        except StudioError as error:
            problem = error.problem + (f" ({source.note})" if source.note else "")
            raise StudioError.of(replace(error.message, problem=problem)) from None
        if fit.note:
            notes.append(fit.note[0].upper() + fit.note[1:] + ".")
        warps[name] = Warp(camera, source.width, source.height, spec.scale, fit)
    return warps


def _raw_cameras(spec: CaptureSettings, rig: Rig, sources: Mapping[str, FrameSource]) -> dict[str, Camera]:
    return {name: warp.source for name, warp in _warps(spec, rig, sources, []).items()}


def find_cameras(spec: CaptureSettings) -> tuple[str, ...]:
    """Names of all cameras of the footage in order, also of those that `spec.cameras` leaves out. Reads no images.
    StudioError if there is no footage, or its store cannot be listed."""
    return tuple(dict.fromkeys(match.camera for match in _find_images(on_this_machine(spec))[1]))


def held_out_cameras(spec: CaptureSettings, names: tuple[str, ...]) -> tuple[str, ...]:
    """The cameras that are held out, in order, of all that are used; StudioError if one is unknown, or all are."""
    wanted: set[str] = set()
    for entry in spec.held_out:
        every = EVERY.fullmatch(entry)
        if every is not None and entry not in names:
            step = int(every[1])
            wanted.update(names[step - 1 :: step])
        else:
            refuse_unknown_cameras((entry,), names, "capture.held_out")
            wanted.add(entry)
    chosen = tuple(name for name in names if name in wanted)
    if len(chosen) == len(names):
        problem = f"All {len(names)} cameras are held out"
        fix = "Leave at least one camera to train on: change capture.held_out."
        raise StudioError("footage.all_held_out", problem, fix=fix, setting="capture.held_out")
    return chosen
