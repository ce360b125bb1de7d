"""Measures takes by one protocol and renders them side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.comparison.measuring import FrameMeasurer, side_by_side
from v3studio.pipelines.comparison.opened_takes import OpenedTake, open_takes
from v3studio.pipelines.comparison.results import (
    RESULTS,
    ComparedFrame,
    ComparedTake,
    Comparison,
    ComparisonProtocol,
    FinishedFrames,
    FrameOfTake,
    Measures,
)
from v3studio.pipelines.takes.files.digests import digest_of, digest_of_file
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.version import program_version
from v3studio.studio.atomic_files import atomic_path, remove
from v3studio.studio.comparison import METRICS, EvaluationProtocol
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonData
from v3studio.studio.progress import ProgressFn, no_progress

if TYPE_CHECKING:
    from v3studio.studio.perceptual import Lpips


def compare(
    folders: Sequence[Path],
    out: Path,
    protocol: EvaluationProtocol,
    *,
    cameras: Sequence[str] = (),
    footage: Path | None = None,
    part: tuple[int | None, int | None, int] = (None, None, 1),
    images: int = 2,
    lpips: Lpips | None = None,
    device: str = "cpu",
    progress: ProgressFn = no_progress,
) -> Comparison:
    """Measure the decoded streams of takes on the frames that all of them have.

    Writes `out/comparison.json` and one image per camera and shown frame, `out/CAMERA_FRAME.png`: the footage, each
    take, and below each take its difference from the footage. Finished frames are kept in `out/.comparing` until then:
    a comparison that was interrupted is resumed if it is the same one (takes, footage and choices).

    Args:
        out: folder of the results; created. Images of an earlier comparison in it are replaced, other files stay.
        footage: folder of the take whose footage settings (images, masks) are compared with; None: the first.
        part: which of the frames that all takes have to measure: the first number in the footage, the number to stop
            before (None: all), and a step. Flicker needs a step of 1.
        images: frames to show, spread over the measured ones.

    Raises:
        StudioError: see `open_takes`; `compare.no_common_frame`; `compare.nothing_visible`; `take.not_writable` or
            `take.disk_full`, before anything is measured if that is known then.
        Cancelled: raised by `progress`; finished frames are kept for the next call.
    """
    footage = footage or folders[0]
    with ExitStack() as closing:
        takes, names = open_takes(folders, protocol, cameras, closing, footage)
        start, stop, step = part
        common = [frame for frame in takes[0].footage.frames if all(frame in one.frames for one in takes)]
        frames = [one for one in common if (start or 0) <= one and (stop is None or one < stop)][::step]
        steady = step == 1
        if not frames:
            others = f"only {common[0]} to {common[-1]}" if common else "nor others"
            problem = f"the takes have no such frames in common, {others}"
            fix = "Compare takes of the same footage, and frames that they have."
            raise StudioError("compare.no_common_frame", problem, value=str(folders[0]), fix=fix)
        closing.enter_context(_writable(out))
        shown = {frames[at] for at in np.linspace(0, len(frames) - 1, min(images, len(frames))).round().astype(int)}
        described = _protocol(protocol, takes, names, frames, footage, lpips)
        key = _key(described, takes, images=sorted(map(int, shown)), flicker=steady, device=device)
        finished = FinishedFrames(out, key)
        measurer = FrameMeasurer(takes, names, protocol, lpips, device, flicker=steady)
        compared: list[ComparedFrame] = []
        total = len(frames) * len(takes) * len(names)
        done = 0

        def tick(counts: bool) -> None:
            nonlocal done
            progress(done, total)
            done += counts

        for before, frame in zip((None, *frames), frames, strict=False):
            if frame in finished.found:
                compared.append(finished.found[frame])
                done += len(takes) * len(names)
                continue
            figures, views = measurer.measure(frame, before, frame in shown, tick)
            shown_images = {_image_name(camera, frame): side_by_side(pairs) for camera, pairs in views.items()}
            compared.append(finished.write(frame, figures, shown_images))
        progress(total, total)
        rows = [[each.takes[number] for each in compared] for number in range(len(takes))]
        if not all(any(one.cameras for one in found) for found in rows):
            finished.remove()
            problem = f"the mask is empty in all frames of {', '.join(names)}: nothing to measure"
            fix = "Name other cameras with --cameras A,B."
            raise StudioError("compare.nothing_visible", problem, fix=fix, option="--cameras")
        result = Comparison(
            protocol=described,
            takes=tuple(_result(take, found, names) for take, found in zip(takes, rows, strict=True)),
        )
    with disk_errors(out):
        earlier, named = _earlier_images(out), {name for each in compared for name in each.images}
        with atomic_path(out / RESULTS) as temporary:
            write_model(temporary, result)
            finished.publish(named)
        for path in earlier:
            if path.name not in named:
                remove(path)
        finished.remove()
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


def _key(described: ComparisonProtocol, takes: Sequence[OpenedTake], **choices: JsonData) -> str:
    """Digest of everything that the figures and images are made from."""
    footage = takes[0].footage
    settings = footage.spec.model_dump(mode="json", exclude={"root"})
    sources = [
        [take.name, take.reader.manifest.manifest_sha256, digest_of_file(take.take.rig), sorted(take.group_starts)]
        for take in takes
    ]
    metrics = [metric.name for metric in METRICS]
    return digest_of([program_version(), metrics, described.to_json(), settings, footage.digest(), sources, choices])


def _image_name(camera: str, frame: int) -> str:
    return f"{camera}_{frame:06d}.png".replace("/", "_")


def _earlier_images(out: Path) -> list[Path]:
    """The images of the comparison that is in the folder; nothing that somebody else put there."""
    try:
        earlier = read_model(out / RESULTS, Comparison).protocol
    except StudioError:
        return []
    names = (_image_name(camera, frame) for camera in earlier.cameras for frame in earlier.frames)
    return [out / name for name in names]


def _result(take: OpenedTake, frames: Sequence[FrameOfTake], names: Sequence[str]) -> ComparedTake:
    rows = [frame.cameras for frame in frames if frame.cameras]
    by_camera = {name: [row[name] for row in rows if name in row] for name in names}
    by_frame = [frame.flicker for frame in frames if frame.flicker is not None]
    flickers = [frame.flicker for frame in by_frame]
    borders = [frame.flicker for frame in by_frame if frame.group_border]
    return ComparedTake(
        name=take.name,
        folder=str(take.take.root),
        measures=_means([_means(list(row.values())) for row in rows]),
        cameras={name: _means(seen) for name, seen in by_camera.items() if seen},
        trained_on=tuple(name for name in names if name in take.trained_on),
        flicker=round(_mean(flickers), 4) if flickers else None,
        flicker_at_group_borders=round(_mean(borders), 4) if borders else None,
        flicker_by_frame=tuple(by_frame),
        total_bytes=take.reader.played_bytes,
        stream_frames=take.reader.frame_count,
    )


def _protocol(
    protocol: EvaluationProtocol,
    takes: Sequence[OpenedTake],
    names: Sequence[str],
    frames: Sequence[int],
    compared_with: Path,
    lpips: Lpips | None,
) -> ComparisonProtocol:
    footage = takes[0].footage
    crop = "none" if protocol.padding is None else f"bounding box of the mask, padded by {protocol.padding} px"
    return ComparisonProtocol(
        name=protocol.name,
        title=protocol.title,
        cameras=tuple(names),
        resolution={name: (footage.rig[name].width, footage.rig[name].height) for name in names},
        background=protocol.background,
        crop=crop,
        footage=str(compared_with.absolute()),
        exact_masks=footage.has_evaluation_masks,
        frames=tuple(int(frame) for frame in frames),
        **({} if lpips is None else {"lpips": lpips.protocol}),
    )


def _means(rows: Sequence[Measures]) -> Measures:
    figures = {metric.name: [row[metric.name] for row in rows if metric.name in row] for metric in METRICS}
    return {name: round(_mean(column), 5) for name, column in figures.items() if column}


def _mean(figures: Sequence[float]) -> float:
    return sum(figures) / len(figures)
