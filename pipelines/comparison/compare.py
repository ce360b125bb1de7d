"""Measures takes by one protocol and draws them side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

import numpy as np

from pipelines.comparison.opened_takes import OpenedTake, open_takes
from pipelines.comparison.results import (
    MEASURES,
    ComparedTake,
    Comparison,
    ComparisonProtocol,
    FlickerOfFrame,
    Measures,
)
from pipelines.comparison.side_by_side import side_by_side
from pipelines.reports.pictures import write_picture
from pipelines.takes.atomic_files import disk_errors, read_model, remove, write_model
from studio.comparison import EvaluationProtocol, ViewPair, flicker, measure_view, padded_box
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress

if TYPE_CHECKING:
    from studio.perceptual import Lpips


class _Figures:
    """What was measured of one take."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Measures]] = []
        self.flicker: list[FlickerOfFrame] = []
        self.before: dict[str, _Residual] = {}


@dataclass(frozen=True, eq=False)
class _Residual:
    """What is kept of a view for the flicker of the next frame."""

    values: np.ndarray
    matte: np.ndarray


def compare(
    folders: Sequence[Path],
    out: Path,
    protocol: EvaluationProtocol,
    *,
    cameras: Sequence[str] = (),
    truth: Path | None = None,
    every: int = 1,
    pictures: int = 2,
    lpips: Lpips | None = None,
    device: str = "cpu",
    progress: ProgressFn = no_progress,
) -> Comparison:
    """Measure the decoded streams of takes on the frames that all of them have.

    Writes `out/comparison.json` and one picture per camera and shown frame, `out/CAMERA_FRAME.png`: the footage, each
    take, and below each take its difference from the footage.

    Args:
        folders: of the takes.
        out: folder of the results; created. Pictures of an earlier comparison in it are replaced, other files stay.
        protocol: which cameras, pixels and size.
        cameras: names instead of the protocol's.
        truth: folder of the take whose footage settings (images, mattes) are the truth; None: the first.
        every: measure every n-th frame; flicker needs 1.
        pictures: frames to draw, spread over the measured ones.
        lpips: the metric; None: not measured.
        device: torch device to draw on.
        progress: called with drawn and all views.

    Raises:
        StudioError: see `open_takes`; `compare.no_common_frame`; `compare.nothing_visible`; `take.not_writable` or
            `take.disk_full`, before anything is measured if that is known then.
        Cancelled: raised by `progress`; nothing is written then.
    """
    with ExitStack() as closing:
        takes, names = open_takes(folders, protocol, cameras, closing, truth)
        frames = [frame for frame in takes[0].footage.frames if all(frame in one.frames for one in takes)][::every]
        if not frames:
            raise StudioError(
                "compare.no_common_frame",
                "the takes have no frame in common",
                value=str(folders[0]),
                fix="Compare takes of the same footage.",
            )
        closing.enter_context(_writable(out))
        shown = {frames[at] for at in np.linspace(0, len(frames) - 1, min(pictures, len(frames))).round().astype(int)}
        figures = [_Figures() for _ in takes]
        drawn: dict[str, np.ndarray] = {}
        total = len(frames) * len(takes) * len(names)
        done = 0
        for frame in frames:
            views: dict[str, list[ViewPair]] = {name: [] for name in names}
            for take, found in zip(takes, figures, strict=True):
                gaussians = take.reader.gaussians(take.frames[frame])
                row: dict[str, Measures] = {}
                changes: list[float] = []
                for camera in names:
                    progress(done, total)
                    done += 1
                    footage = take.footage
                    pair = ViewPair.of(
                        gaussians,
                        take.place.camera(footage.rig[camera]),
                        footage.image(camera, frame),
                        footage.evaluation_matte(camera, frame),
                        protocol.background,
                        device,
                    )
                    quality = measure_view(pair, protocol.padding, lpips)
                    if quality is not None:
                        row[camera] = Measures(**{k: v for k, v in asdict(quality).items() if v is not None})
                    if every == 1:
                        now = _Residual(pair.residual, pair.matte)
                        if camera in found.before:
                            changes += _flicker(found.before[camera], now, protocol.padding)
                        found.before[camera] = now
                    if frame in shown:
                        views[camera].append(pair)
                if row:
                    found.rows.append(row)
                if changes:
                    border = frame in take.group_starts
                    found.flicker.append(
                        FlickerOfFrame(frame=frame, flicker=round(_mean(changes), 4), group_border=border)
                    )
            for camera, pairs in views.items():
                if pairs:
                    picture = side_by_side([take.name for take in takes], pairs, protocol.padding)
                    drawn[_picture_name(camera, frame)] = picture
        progress(total, total)
        if not all(found.rows for found in figures):
            raise StudioError(
                "compare.nothing_visible",
                f"the matte is empty in all frames of {', '.join(names)}: nothing to measure",
                fix="Name other cameras with --cameras A,B.",
                option="--cameras",
            )
        result = Comparison(
            protocol=_protocol(protocol, takes, names, frames, truth or folders[0], lpips),
            takes=tuple(_result(take, found, names) for take, found in zip(takes, figures, strict=True)),
        )
    with disk_errors(out):
        for path in _earlier_pictures(out):
            remove(path)
        for name, picture in drawn.items():
            write_picture(out / name, picture)
        write_model(out / "comparison.json", result)
    return result


@contextmanager
def _writable(out: Path) -> Iterator[None]:
    """Create the folder and try to write there, which must not fail after hours; gone again if the block fails."""
    new = not out.exists()
    with disk_errors(out):
        out.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=out):
            pass
    try:
        yield
    except BaseException:
        if new:
            with suppress(OSError):
                out.rmdir()
        raise


def _picture_name(camera: str, frame: int) -> str:
    return f"{camera}_{frame:06d}.png".replace("/", "_")


def _earlier_pictures(out: Path) -> list[Path]:
    """Where the comparison that is in the folder has its pictures; nothing that somebody else put there."""
    try:
        earlier = read_model(out / "comparison.json", Comparison).protocol
    except StudioError:
        return []
    names = (_picture_name(camera, frame) for camera in earlier.cameras for frame in earlier.frames)
    return [out / name for name in names]


def _flicker(before: _Residual, now: _Residual, padding: int | None) -> list[float]:
    """Flicker in the box around the performer of both frames; none if one of the mattes is empty."""
    if before.values.shape != now.values.shape:
        return []
    box: tuple[slice, ...] | None = (slice(None), slice(None))
    if padding is not None:
        if not ((before.matte > 127).any() and (now.matte > 127).any()):
            return []
        box = padded_box(np.maximum(before.matte, now.matte), padding)
    return [] if box is None else [flicker(before.values[box], now.values[box])]


def _result(take: OpenedTake, found: _Figures, names: Sequence[str]) -> ComparedTake:
    by_camera = {
        name: _means([row[name] for row in found.rows if name in row])
        for name in names
        if any(name in row for row in found.rows)
    }
    values = [one.flicker for one in found.flicker]
    borders = [one.flicker for one in found.flicker if one.group_border]
    return ComparedTake(
        **_means([_means(list(row.values())) for row in found.rows]).to_json(),
        name=take.name,
        folder=str(take.take.root),
        cameras=by_camera,
        trained_on=tuple(name for name in names if name in take.trained_on),
        flicker=round(_mean(values), 4) if values else None,
        flicker_at_group_borders=round(_mean(borders), 4) if borders else None,
        flicker_by_frame=tuple(found.flicker),
        total_bytes=take.reader.manifest.played_bytes,
        stream_frames=take.reader.frame_count,
    )


def _protocol(
    protocol: EvaluationProtocol,
    takes: Sequence[OpenedTake],
    names: Sequence[str],
    frames: Sequence[int],
    truth: Path,
    lpips: Lpips | None,
) -> ComparisonProtocol:
    footage = takes[0].footage
    crop = "none" if protocol.padding is None else f"bounding box of the matte, padded by {protocol.padding} px"
    return ComparisonProtocol(
        name=protocol.name,
        title=protocol.title,
        cameras=tuple(names),
        resolution={name: (footage.rig[name].width, footage.rig[name].height) for name in names},
        background=protocol.background,
        crop=crop,
        truth=str(truth.absolute()),
        exact_mattes=footage.has_evaluation_mattes,
        frames=tuple(int(frame) for frame in frames),
        **({} if lpips is None else {"lpips": lpips.protocol}),
    )


def _means(rows: Sequence[Measures]) -> Measures:
    figures = {}
    for name in MEASURES:
        values = [value for row in rows if (value := getattr(row, name)) is not None]
        if values:
            figures[name] = round(_mean(values), 5)
    return Measures(**figures)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
