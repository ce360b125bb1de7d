"""Bakes a group for version 3: each rung of the ladder to files named by their content."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import ValidationError

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.json_types import JsonObject
from studio.progress import ProgressFn
from studio.stream.encode_group import contents, encode_group, prepare
from studio.stream.frame_losses import FilmedErrorFn
from studio.stream.ladder_models import (
    FILES,
    GroupLadder,
    MotionLadder,
    PlanesLadder,
    Pruning,
    hashed_path,
)
from studio.stream.manifest_models import GroupEntry, MotionGroup, PlanesGroup, group_invalid
from studio.stream.search import QualityFn, measured_psnr
from studio.stream.settings import QP_MAX, BakeSettings, Rung
from studio.stream.video import AV1_QP_MAX, NOMINAL_FPS, PlaneDecoder

ContributionFn = Callable[[], np.ndarray]
"""(N,) float, at least 0: what each splat of the group adds to the pictures that cameras see."""

FinetunedFn = Callable[[Rung], Sequence[Gaussians]]
"""Frames of the group with the splats that a rung keeps, trained further; called for rungs with `Rung.finetuned`."""


def bake_ladder(
    frames: Sequence[Gaussians],
    directory: Path,
    partial: Path,
    group: int,
    first_frame: int,
    settings: BakeSettings,
    progress: ProgressFn,
    quality: QualityFn | None,
    threads: int,
    fps: float | None,
    contribution: ContributionFn | None,
    finetuned: FinetunedFn | None,
    error: FilmedErrorFn | None,
) -> GroupLadder:
    """Bake all rungs into `directory/files`. Arguments as for `bake.bake_group`; `partial` is a folder for work.

    Raises:
        StudioError: as `bake.bake_group`.
        OSError: a file cannot be written.
    """
    rungs, count = settings.rungs, len(frames)
    if finetuned is None and any(rung.finetuned for rung in rungs):
        raise StudioError(
            "bake.no_finetuning",
            "a rung's splats are to be trained further after pruning, but there is no footage to train them on",
            fix="Bake a take, pass finetuned, or set finetune_iterations of all rungs to 0.",
            setting="bake.ladder",
            group=group,
        )
    ranking = _ranking(rungs, len(frames[0]), contribution, group)
    made: dict[str, JsonObject] = {}
    for kind in dict.fromkeys(rung.kind for rung in rungs):
        same = [rung for rung in rungs if rung.kind == kind]
        part = frames
        if finetuned is not None and same[0].finetuned:
            part = finetuned(same[0])
        elif kind != (1.0, None, 0):
            part = _Reduced(frames, ranking, same[0].splats, same[0].sh_degree)
        prepared = prepare(part, settings, progress)
        for rung in same:
            own = settings.replace(ladder=(), qp=rung.qp)
            if rung != rungs[0] or rung.pruned:  # the others are for lower rates
                own = own.replace(max_loss=None)
            steps = _Steps(progress, len(made), len(rungs))
            entry = encode_group(
                prepared,
                partial,
                "work",
                group,
                first_frame,
                count,
                own,
                steps,
                quality,
                threads,
                fps or NOMINAL_FPS,
                error,
            )
            psnr = None
            if quality is not None:
                psnr = round(measured_psnr(entry, contents(entry, partial), quality, settings.codec), 3)
            made[rung.id] = _rendition(entry, partial, directory, rung, psnr, settings.codec)
        del prepared
    shutil.rmtree(partial, ignore_errors=True)
    single = not settings.ladder
    values = {
        "index": group,
        "first_frame": first_frame,
        "frame_count": count,
        "renditions": [{**made[rung.id], **({"id": "main"} if single else {})} for rung in rungs],
    }
    kind_of = PlanesLadder if settings.profile == "planes" else MotionLadder
    try:
        return kind_of.model_validate_json(json.dumps(values))
    except ValidationError as error:
        raise group_invalid(group, error) from None


class _Steps:
    """Progress of one rung as a part of all; counts frames of all rungs."""

    def __init__(self, progress: ProgressFn, rung: int, rungs: int) -> None:
        self._progress, self._rung, self._rungs = progress, rung, rungs

    def __call__(self, done: int, total: int, **figures: Any) -> None:
        self._progress(self._rung * total + done, self._rungs * total, **figures)


class _Reduced(Sequence[Gaussians]):
    """Frames with fewer splats or a lower SH degree, made on access."""

    def __init__(
        self, frames: Sequence[Gaussians], ranking: np.ndarray | None, share: float, sh_degree: int | None
    ) -> None:
        self._frames, self._degree = frames, sh_degree
        self._kept: torch.Tensor | None = None
        if share < 1:
            assert ranking is not None
            self._kept = torch.from_numpy(most_visible(ranking, share))

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: Any) -> Any:
        frame = self._frames[index]
        if self._kept is not None:
            frame = frame[self._kept]
        if self._degree is not None and self._degree < frame.sh_degree:
            frame = frame.with_sh_degree(self._degree)
        return frame


def most_visible(ranking: np.ndarray, share: float) -> np.ndarray:
    """Indices of the first `share` of a ranking, at least one, ascending."""
    kept: np.ndarray = np.sort(ranking[: max(1, round(share * len(ranking)))])
    return kept


def ranking_of(contribution: np.ndarray) -> np.ndarray:
    """(N,) indices of splats, the one that contributes most first; equal ones in their order."""
    order: np.ndarray = np.argsort(-contribution, kind="stable")
    return order


def _ranking(rungs: Sequence[Rung], splats: int, contribution: ContributionFn | None, group: int) -> np.ndarray | None:
    """(N,) splats, the most visible first; None if no rung is only cut."""
    if not any(rung.pruned and not rung.finetuned for rung in rungs):
        return None
    if contribution is None:
        raise StudioError(
            "bake.no_contribution",
            "a rung keeps only a share of the splats, but it is not known what each adds to the pictures",
            fix="Bake a take, pass contribution, or set splats of all rungs to 1.",
            setting="bake.ladder",
            group=group,
        )
    values = contribution()
    if values.shape != (splats,) or not np.isfinite(values).all():
        raise StudioError(
            "bake.invalid_contribution",
            f"contribution gives {values.shape} values for {splats} splats, or some that are not finite",
            value=values.shape,
            group=group,
            expected=(splats,),
        )
    return ranking_of(values)


def _rendition(
    entry: GroupEntry, partial: Path, directory: Path, rung: Rung, psnr: float | None, codec: str
) -> JsonObject:
    """The group's values for the manifest, with its files moved to their names."""
    pruning: Pruning = "fine-tuned" if rung.finetuned else "importance" if rung.pruned else "none"
    tree = entry.to_dict()
    videos = _videos(tree)
    size = entry.size if isinstance(entry, MotionGroup) else _plane_size(entry)
    for values in videos:
        data = (partial / Path(values["path"]).name).read_bytes()
        values["checks"] = luma_checks(data, size, codec, entry.frame_count)
    sides = [tree["side"]] if "video" in tree else []  # in planes, "side" is a length
    (directory / FILES).mkdir(parents=True, exist_ok=True)
    for values in (*videos, *sides):
        file = partial / Path(values["path"]).name
        path = hashed_path(values["sha256"], file.suffix)
        os.replace(file, directory / path)
        values["path"] = path
    qp = max(values["qp"] for values in videos)
    qp = round(qp * QP_MAX / AV1_QP_MAX) if codec == "av1" else qp
    return {"id": rung.id, "qp": qp, "pruning": pruning, "psnr_to_trained": psnr, **tree}


def _videos(tree: JsonObject) -> list[JsonObject]:
    if "video" in tree:
        return [tree["video"]]
    return [plane for component in tree["components"] for plane in component["planes"]]


def _plane_size(entry: GroupEntry) -> tuple[int, int]:
    assert isinstance(entry, PlanesGroup)
    return entry.side, entry.side


def luma_checks(data: bytes, size: tuple[int, int], codec: str, frame_count: int) -> list[dict[str, int]]:
    """CRC-32 of the decoded luma of the first and of the middle picture of a video, as in the manifest."""
    wanted = sorted({0, frame_count // 2})
    found = []
    decoder = PlaneDecoder(data, "baking", size, frame_count, codec)
    try:
        picture = np.empty(size[::-1], dtype=np.uint8)
        for index in range(wanted[-1] + 1):
            decoder.read(picture)
            if index in wanted:
                found.append({"picture": index, "crc32": zlib.crc32(picture.data)})
    finally:
        decoder.close()
    return found


def content_name(data: bytes, suffix: str) -> tuple[str, str]:
    """Path and SHA-256 of a file with this content; `suffix` with its dot."""
    digest = hashlib.sha256(data).hexdigest()
    return hashed_path(digest, suffix), digest
