"""Start timecodes of videos (SMPTE ST 12-1), and the offsets between cameras that follow from them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from pathlib import Path

import av
from av.container import InputContainer

from v3studio.studio.capture.media import open_media, video_stream
from v3studio.studio.errors import StudioError, naming

_LABEL = re.compile(r"(\d\d):(\d\d):(\d\d)([:;.,])(\d\d\d?)", re.ASCII)
_NTSC = Fraction(1000, 1001)

_LONGEST = 32  # characters of a wrong label that a message shows
_FIRST_PACKETS = 8  # the number of a tmcd track is in its first packet


@dataclass(frozen=True)
class Timecode:
    """The time of day at which a video starts, counted in frames, and its label; ";" says that labels are dropped, so
    that 29.97 or 59.94 frames per second keep up with the clock."""

    text: str
    rate: Fraction
    frames: int
    day: int


def parse_timecode(text: str, rate: Fraction) -> Timecode:
    """The frame that a label `HH:MM:SS:FF`, or `HH:MM:SS;FF` for drop-frame, names; StudioError
    (`sync.timecode_invalid`) if there is no such label at this rate. Drop-frame labels leave out the first two of each
    minute (four at 59.94 fps), except in each tenth."""
    label, fps, dropped = _LABEL.fullmatch(text.strip()), round(rate), 0
    hours, minutes, seconds, frames = (int(label[number]) for number in (1, 2, 3, 5)) if label else (24, 0, 0, 0)
    valid = hours < 24 and minutes < 60 and seconds < 60 and frames < fps
    if label is not None and label[4] != ":":
        dropped = fps // 15
        skipped = minutes % 10 > 0 and seconds == 0 and frames < dropped
        valid = valid and fps % 30 == 0 and abs(rate / (fps * _NTSC) - 1) <= 1e-4 and not skipped
    if not valid:
        text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
        problem = f"'{text}' is not a timecode at {float(rate):.5g} fps"
        fix = "Write the timecode again, or synchronize by sound or motion."
        raise StudioError("sync.timecode_invalid", problem, value=text, fix=fix)
    minute = 60 * hours + minutes
    number = fps * (60 * minute + seconds) + frames - dropped * (minute - minute // 10)
    return Timecode(text.strip(), rate, number, fps * 86400 - dropped * (1440 - 144))


def read_timecode(file: Path) -> Timecode | None:
    """The start timecode in a video's stream (with MOV and MP4, in its tmcd track), else in the file; None if there is
    none. StudioError: `footage.video_unreadable`, `sync.timecode_invalid`; or `sync.timecode_rate`: the
    track counts at another rate than the video's, as cameras do that count to 25 while they film 50 frames."""
    try:
        with open_media(file) as container:
            video = video_stream(container)
            rate = video.average_rate if video is not None else None
            places = (*([] if video is None else [video]), container, *container.streams)
            text = next((tag for place in places if (tag := _tag(place.metadata))), None)
            first = _first_of_track(container)
    except (av.error.FFmpegError, OSError, IndexError) as error:
        raise StudioError("footage.video_unreadable", f"cannot read the timecode ({error})", file=file) from None
    if text is None or not rate:
        return None
    with naming(file):
        timecode = parse_timecode(text, Fraction(rate))
    if first is not None and first != timecode.frames:
        problem = f"the timecode {timecode.text} does not count the frames of the video ({float(rate):.5g} fps)"
        fix = "Synchronize by sound or motion."
        raise StudioError("sync.timecode_rate", problem, file=file, value=timecode.text, fix=fix)
    return timecode


def _first_of_track(container: InputContainer) -> int | None:
    """The number of the first frame in a tmcd track, counted at the rate of the track; None without such a track."""
    for track in container.streams.data:
        if _tag(track.metadata):
            for packet in islice(container.demux(track), _FIRST_PACKETS):
                if packet.size == 4:
                    return int.from_bytes(bytes(packet), "big")
    return None


def _tag(metadata: Mapping[str, str]) -> str | None:
    return next((value for name, value in metadata.items() if name.lower() == "timecode" and value), None)


def timecode_offsets(timecodes: Mapping[str, Timecode]) -> dict[str, int]:
    """Offsets in frames by camera, as `CaptureSettings.offsets`, from the starts of their videos: a camera that started
    earlier has a larger one. That of the camera in the middle is 0. Midnight may lie between the starts: the longest
    stretch of the day without a start is taken to be the time when nothing was filmed."""
    names = sorted(timecodes, key=lambda name: timecodes[name].rate)
    slowest, fastest = timecodes[names[0]], timecodes[names[-1]]
    if fastest.rate > slowest.rate * Fraction(100_02, 100_00):  # 29.97 and 30 differ by 0.1%
        raise StudioError(
            "sync.rates_differ",
            f"Camera '{names[0]}' has {float(slowest.rate):.5g} fps and camera '{names[-1]}' "
            f"{float(fastest.rate):.5g} fps, so the frames that their timecodes count do not correspond",
            value=(float(slowest.rate), float(fastest.rate)),
            fix="Convert the footage to one frame rate.",
            cameras=(names[0], names[-1]),
        )
    kinds = {timecodes[name].text[8] != ":": name for name in reversed(list(timecodes))}
    if len(kinds) > 1:
        problem = (
            f"Camera '{kinds[True]}' has drop-frame timecode ({timecodes[kinds[True]].text}) and camera "
            f"'{kinds[False]}' has not ({timecodes[kinds[False]].text}), so their labels count differently"
        )
        fix = "Synchronize by sound or motion."
        raise StudioError("sync.timecode_mixed", problem, fix=fix, cameras=(kinds[True], kinds[False]))
    starts = _unwrapped({name: timecode.frames for name, timecode in timecodes.items()}, slowest.day)
    middle = sorted(starts.values())[(len(starts) - 1) // 2]
    return {name: middle - start for name, start in starts.items()}


def _unwrapped(starts: Mapping[str, int], day: int) -> dict[str, int]:
    """Frame numbers around a clock, cut open at its longest stretch without a start."""
    order = sorted(starts.values())
    gaps = [later - earlier for earlier, later in zip(order, [*order[1:], order[0] + day], strict=True)]
    first = order[(gaps.index(max(gaps)) + 1) % len(order)]
    return {name: (start - first) % day for name, start in starts.items()}
