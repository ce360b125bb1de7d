"""Baking: a group of Gaussians, and the sound, to files that are named by their content."""

import math
import os
import shutil
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import ValidationError

from v3studio.studio.atomic_files import remove_leftovers, temporary_path
from v3studio.studio.audio import SAMPLE_RATE, Cut, encode_sound
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.json_types import JsonObject
from v3studio.studio.memory_cache import OnDemand
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.stream.encode.files import entry_of
from v3studio.studio.stream.encode.group import GroupBake
from v3studio.studio.stream.encode.quality import QP_BEST, QualityFn, highest_qp, psnr_of
from v3studio.studio.stream.manifest import (
    FILES,
    MAX_SPLATS,
    AudioEntry,
    GroupEntry,
    Pruning,
    Rendition,
    invalid,
)
from v3studio.studio.stream.settings import QP_MAX, BakeSettings, Rung
from v3studio.studio.stream.video import NOMINAL_FPS, PlaneDecoder

_COARSE_SHARE, _COARSE_LEAST = 4, 1000  # a quarter of a set of many splats comes first
_SET_QP = 8  # of the set, which is sent once: 9 bytes per splat, 43 dB or more to the trained one (measured)
_QPS_PER_HALF = 8  # about as many QPs more halve the bytes

ContributionFn = Callable[[], np.ndarray]
"""(N,) float, at least 0: what each splat of the group adds to the images that cameras see."""

FinetunedFn = Callable[[Rung], Sequence[Gaussians]]
"""Frames of the group with the splats that a rung keeps, trained further; called for rungs with `Rung.finetuned`."""


def bake_group(
    frames: Sequence[Gaussians] | Iterable[Gaussians],
    directory: Path | str,
    group: int,
    first_frame: int,
    settings: BakeSettings,
    progress: ProgressFn = no_progress,
    quality: QualityFn | None = None,
    threads: int = 0,
    fps: float | None = None,
    contribution: ContributionFn | None = None,
    finetuned: FinetunedFn | None = None,
    unsmoothed: Callable[[], object] = lambda: None,
) -> GroupEntry:
    """Bake one group into files in `directory/files` that are named by their content.

    The same input gives the same bytes. With a target in the settings, the group is baked a few times, to find its
    QP; with a ladder, once per rung.

    Args:
        frames: frames of the group in their order, with the same splats in each.
        directory: the stream's folder; created if missing.
        group: 0-based index of the group.
        first_frame: index *in the stream* of its first frame, 0-based (not the footage's frame number).
        settings: QPs, targets and so on.
        progress: called with (frames encoded, frames), over all rungs.
        threads: CPU threads; 0: one per core. Does not change the bytes.
        quality: error of a decoded frame against the trained one; required for a level or a target PSNR. The
            renditions' `psnr_to_trained` is measured with it.
        fps: frames per second of the stream, which the level of its videos is chosen for; None: 30.
        contribution: what each splat adds to the images; required for rungs that keep fewer splats as they are.
        finetuned: frames of rungs that keep fewer splats and are trained further; required for these.
        unsmoothed: called if a level is out of reach with smooth paths, so that they are left as they are.

    Returns:
        The group's entry for the manifest.

    Raises:
        StudioError: no frames, differing splat counts, values that are not finite, a target that no QP reaches, no
            `contribution`, `finetuned` or `quality` where it is needed, or the folder cannot be written.
    """
    directory = Path(directory)
    frames = frames if isinstance(frames, Sequence) else list(frames)
    if not frames:
        raise StudioError("bake.no_frames", f"group {group} has no frames", group=group)
    if len(frames[0]) > MAX_SPLATS:
        problem = f"group {group} has {len(frames[0])} splats; the format supports up to {MAX_SPLATS}"
        fix = "Lower train.max_splats, or import files with fewer splats."
        fields: JsonObject = {"group": group, "expected": MAX_SPLATS, "setting": "train.max_splats"}
        raise StudioError("bake.too_many_splats", problem, value=len(frames[0]), fix=fix, **fields)
    rungs = settings.rungs
    if finetuned is None and any(rung.finetuned for rung in rungs):
        problem = "a rung's splats are to be trained further after pruning, but there is no footage to train them on"
        fix = "Bake a take, pass finetuned, or set finetune_iterations of all rungs to 0."
        raise StudioError("bake.no_finetuning", problem, fix=fix, setting="bake.ladder", group=group)
    folder = directory / f"group_{group:03d}"
    place = temporary_path(folder)
    try:
        remove_leftovers(directory, folder)
        (directory / FILES).mkdir(parents=True, exist_ok=True)
        contributed = _contribution(rungs, len(frames[0]), contribution, group)
        made: dict[str, Rendition] = {}

        def steps(done: int, total: int, **figures: Any) -> None:  # of one rung, as a part of all
            progress(len(made) * total + done, len(rungs) * total, **figures)

        for kind in dict.fromkeys(rung.kind for rung in rungs):
            same = [rung for rung in rungs if rung.kind == kind]
            part = frames
            if finetuned is not None and same[0].finetuned:
                part = finetuned(same[0])
            elif kind != (1.0, None, 0):
                part = _reduced(frames, contributed, same[0].splats, same[0].sh_degree)
            prepared = GroupBake(part, progress)
            for rung in same:
                own = settings.replace(ladder=())
                if settings.ladder:
                    own = own.replace(quality=rung.qp)
                values = _identity(rung, group, first_frame, len(frames), single=not settings.ladder)
                write = partial(prepared.write, place, values, progress=steps, threads=threads, fps=fps or NOMINAL_FPS)
                encoded = _encoded(write, place, values, own, quality, unsmoothed)
                made[rung.id] = _stored(*encoded, place, directory)
            del prepared, write  # the group's values
        return GroupEntry(
            index=group,
            first_frame=first_frame,
            frame_count=len(frames),
            renditions=tuple(made[rung.id] for rung in rungs),
        )
    except ValidationError as error:
        problem = f"group {group} cannot be represented in the format ({invalid(error, '', '').problem})"
        raise StudioError("bake.group_invalid", problem, fix="Train the group again.", group=group) from None
    except OSError as error:
        problem = f"the group cannot be written ({error.strerror or error})"
        raise StudioError("bake.write_failed", problem, file=folder, group=group) from None
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _identity(rung: Rung, group: int, first_frame: int, frame_count: int, single: bool) -> JsonObject:
    """The fields of a rendition that its encoder does not set."""
    pruning: Pruning = "fine-tuned" if rung.finetuned else "importance" if rung.pruned else "none"
    return {
        "index": group,
        "first_frame": first_frame,
        "frame_count": frame_count,
        "id": "main" if single else rung.id,
        "qp": 0,
        "pruning": pruning,
        "psnr_to_trained": None,
    }


def _encoded(
    write: Callable[[BakeSettings], Rendition],
    folder: Path,
    identity: Mapping[str, Any],
    settings: BakeSettings,
    quality: QualityFn | None,
    unsmoothed: Callable[[], object],
) -> tuple[Rendition, float | None]:
    """Encode a rendition of a group at a QP, or at the QP that reaches a target: the rendition, without checks and
    figures, and its PSNR if there is `quality`.

    Args:
        write: encodes into `folder`, whose files are replaced by each encoding.
        identity: values of the rendition that the encoder does not know.
        settings, quality, unsmoothed: as for `bake_group`.
    """

    @lru_cache(maxsize=1)  # of several QPs, only the files of the last are on the disk
    def at(qp: int) -> Rendition:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return write(settings.at_qp(qp))

    @cache
    def psnr(qp: int) -> float:
        if quality is None:
            problem = f"quality {settings.quality} requires a function that renders decoded frames (quality)"
            fix = "Pass quality, or set a QP instead."
            raise StudioError("bake.no_renderer", problem, fix=fix, setting="bake.quality")
        draft = at(qp)
        return psnr_of(draft, _contents(draft, folder), quality)

    def missed(target: float, value: float, unit: str, qp: int, fix: str) -> StudioError:
        group = identity["index"]
        problem = f"group {group} has {value:.4g} {unit} at QP {qp}, which misses the target of {target:.4g}"
        fields = {"setting": "bake.quality", "qp": qp, "expected": target, "group": group}
        return StudioError("bake.target_missed", problem, value=value, fix=fix, **fields)

    def kb(qp: int) -> float:
        return at(qp).bytes / identity["frame_count"] / 1000

    qp, most, least = settings.qp, settings.target_kb_per_frame, settings.target_psnr
    if most is not None:
        qp = 1 + highest_qp(lambda qp: _QPS_PER_HALF * math.log2(kb(qp) / most), qp)
        if qp > QP_MAX:
            raise missed(most, kb(QP_MAX), "KB per frame", QP_MAX, "Raise it, or train fewer splats.")
    if least is not None:
        qp = highest_qp(lambda qp: psnr(qp) - least, settings.qp)
        if qp < QP_BEST and settings.smooth_paths is None:
            unsmoothed()
            settings = settings.replace(smooth_paths=False)
            at.cache_clear()
            psnr.cache_clear()
            qp = highest_qp(lambda qp: psnr(qp) - least, settings.qp)
        if qp < QP_BEST:
            raise missed(least, psnr(QP_BEST), "dB", QP_BEST, "Set a lower level.")
    return at(qp), None if quality is None else psnr(qp)


def _contents(draft: Rendition, folder: Path) -> dict[str, bytes]:
    """Content by path of the files of a rendition, which are in `folder`."""
    return {file.path: (folder / Path(file.path).name).read_bytes() for file in draft.files}


def _stored(draft: Rendition, psnr: float | None, folder: Path, directory: Path) -> Rendition:
    """The complete rendition, with its files moved from `folder` to their place."""
    files, values = _contents(draft, folder), draft.model_dump()
    values |= {"psnr_to_trained": None if psnr is None else round(psnr, 3), "qp": draft.video.qp}
    values["video"]["checks"] = luma_checks(files[draft.video.path], draft.size, draft.frame_count)
    rendition = Rendition.model_validate(values)
    for path in files:
        os.replace(folder / Path(path).name, directory / path)
    return rendition


def luma_checks(data: bytes, size: tuple[int, int], frame_count: int) -> tuple[dict[str, int], ...]:
    """CRC-32 of the decoded luma of the first and of the middle image of a video, as in the manifest."""
    wanted = sorted({0, frame_count // 2})
    checks = []
    picture = np.empty(size[::-1], dtype=np.uint8)
    with closing(PlaneDecoder(data, "baking", size, frame_count)) as decoder:
        for index in range(wanted[-1] + 1):
            decoder.read(picture)
            if index in wanted:
                checks.append({"picture": index, "crc32": zlib.crc32(picture.data)})
    return tuple(checks)


def _reduced(
    frames: Sequence[Gaussians], contributed: np.ndarray | None, share: float, sh_degree: int | None
) -> Sequence[Gaussians]:
    """Frames with fewer splats or a lower SH degree."""
    kept = None if contributed is None or share == 1 else torch.from_numpy(most_visible(contributed, share))

    def reduced(index: int) -> Gaussians:
        frame = frames[index] if kept is None else frames[index][kept]
        return frame if sh_degree is None or sh_degree >= frame.sh_degree else frame.with_sh_degree(sh_degree)

    return OnDemand(range(len(frames)), reduced)


def most_visible(contribution: np.ndarray, share: float) -> np.ndarray:
    """Indices of this share of the splats, at least one, ascending: those that contribute most; of equal ones, the
    first."""
    order = np.argsort(-contribution, kind="stable")
    kept: np.ndarray = np.sort(order[: max(1, round(share * len(order)))])
    return kept


def _contribution(
    rungs: Sequence[Rung], splats: int, contribution: ContributionFn | None, group: int
) -> np.ndarray | None:
    """(N,) what each splat contributes; None if no rung is only cut."""
    if not any(rung.pruned and not rung.finetuned for rung in rungs):
        return None
    if contribution is None:
        problem = "a rung keeps only a share of the splats, but the contribution of each splat is not known"
        fix = "Bake a take, pass contribution, or set splats of all rungs to 1."
        raise StudioError("bake.no_contribution", problem, fix=fix, setting="bake.ladder", group=group)
    values = contribution()
    if values.shape != (splats,) or not np.isfinite(values).all():
        problem = f"contribution gives {values.shape} values for {splats} splats, or some that are not finite"
        raise StudioError("bake.invalid_contribution", problem, value=values.shape, group=group, expected=(splats,))
    return values


def bake_set(splats: Gaussians, directory: Path | str, settings: BakeSettings) -> tuple[Rendition, ...]:
    """Bake the splats behind the performer into files in `directory/files`: parts of one frame for the manifest, the
    coarsest first. Their color is the same from all sides: higher SH degrees are cut. Raises StudioError as
    `bake_group`."""
    areas = splats.opacities * splats.log_scales.sort(dim=1).values[:, 1:].sum(dim=1).exp()
    order = areas.detach().cpu().argsort(descending=True, stable=True)
    first = len(order) // _COARSE_SHARE if len(order) >= _COARSE_LEAST else len(order)
    kept = BakeSettings(quality=min(settings.qp, _SET_QP), preset=settings.preset)
    parts = [splats.with_sh_degree(0)[part] for part in (order[:first], order[first:]) if len(part)]
    return tuple(bake_group([part], directory, number, 0, kept).best for number, part in enumerate(parts))


def bake_sound(cut: Cut, directory: Path) -> AudioEntry:
    """Encode a sound, as long as the stream's frames, into `directory/files`, under the name of its content; the same
    sound gives the same bytes. `cut` then knows how much of it is silence (`missing_before`, `missing_after`).
    StudioError if the sound cannot be read, or the file cannot be written."""
    folder = directory / FILES
    temporary = temporary_path(folder / "sound")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        samples = encode_sound(cut.blocks(), str(temporary), SAMPLE_RATE, cut.channels)
        entry = entry_of(temporary.read_bytes(), ".m4a")
        os.replace(temporary, directory / entry.path)
    except OSError as error:
        problem = f"the sound cannot be written ({error.strerror or error})"
        raise StudioError("bake.write_failed", problem, file=temporary) from None
    finally:
        temporary.unlink(missing_ok=True)
    return AudioEntry(
        **dict(entry), codec="aac", sample_rate=SAMPLE_RATE, channels=cut.channels, samples=samples, start=0.0
    )
