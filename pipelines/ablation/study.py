"""The paper's ablation on any capture: what each part of training contributes, as PSNR against kilobytes per frame."""

import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from v3studio.pipelines.ablation.variants import Variant
from v3studio.pipelines.config import Config, load_config
from v3studio.pipelines.config.loading import dump_config
from v3studio.pipelines.events import Emit
from v3studio.pipelines.runs.runner import run
from v3studio.pipelines.stages import STAGE_NAMES
from v3studio.pipelines.takes.authored.drawn_masks import for_another_take
from v3studio.pipelines.takes.files.digests import digest_of
from v3studio.pipelines.takes.files.json_files import Result, read_model, write_model
from v3studio.pipelines.takes.frames.frame_numbers import trained_groups
from v3studio.pipelines.takes.results.evaluation import Protocol, read_evaluation
from v3studio.pipelines.takes.take import Take

METHOD: dict[str, str | bool | int] = {"method": "pchip", "require_matching_points": False, "min_overlap": 0}
"""Options of `bjontegaard`: piecewise cubic interpolation over the range that both curves cover."""


class RatePoint(Result):
    """A variant baked at one QP, measured after decoding."""

    qp: int
    kb_per_frame: float
    """Size of the whole stream per frame; 1 KB is 1000 bytes."""

    psnr_decoded: float
    psnr_trained: float | None = None
    ssim_decoded: float | None = None
    lpips_decoded: float | None = None


class VariantResult(Result):
    """One variant."""

    name: str
    title: str

    settings: str = ""
    """Digest of its settings; points measured with other settings are discarded."""

    points: tuple[RatePoint, ...] = ()
    """Sorted by QP."""

    bd_rate_percent: float | None = None
    """Mean size difference from the first variant at equal PSNR; negative means smaller. None if the curves do not
    overlap; not set for the first variant."""

    bd_psnr_db: float | None = None
    """Mean PSNR difference from the first variant at equal size."""


class AblationResults(Result):
    """Contents of ablation.json."""

    protocol: Protocol | None = None
    qps: tuple[int, ...] = ()
    variants: tuple[VariantResult, ...] = ()


def ablate(
    config_path: Path,
    out: Path,
    overrides: Sequence[tuple[str, Any]],
    variants: Sequence[Variant],
    qps: Sequence[int],
    emit: Callable[[str], Emit],
) -> AblationResults:
    """Train each variant, bake it at each QP, decode and measure it; update `out`/ablation.json after each, and
    return it.

    Each variant is a take under `out`/takes. Results that variants share (cameras, initial points, keyframes) are
    copied, and measured points are reused.

    Args:
        variants: the others are compared with the first.
        qps: in any order; BD-rate needs at least four.
        emit: called with a description of each run; returns the receiver of its events.

    Raises:
        StudioError, Cancelled: as `run`; ablation.json is damaged (`take.damaged`).
    """
    results_path = out / "ablation.json"
    out.mkdir(parents=True, exist_ok=True)
    before = read_model(results_path, AblationResults) if results_path.is_file() else AblationResults()
    known = {entry.name: entry for entry in before.variants}
    entries: list[VariantResult] = []
    results = AblationResults()
    base: Take | None = None
    for variant in variants:
        config = for_another_take(load_config(config_path, [*overrides, *variant.settings.items()]), config_path)
        take = Take.create(out / "takes" / variant.name)
        base = base or take
        if take is not base:
            share(base, take)
        digest = digest_of(dump_config(config))
        last = known.get(variant.name)
        points = last.points if last is not None and last.settings == digest else ()
        points = _measure(take, config, variant, points, qps, emit)
        entries.append(VariantResult(name=variant.name, title=variant.title, settings=digest, points=points))
        results = AblationResults(
            protocol=read_evaluation(take.evaluation).protocol, qps=tuple(sorted(qps)), variants=compare(entries)
        )
        write_model(results_path, results)
    return results


def _measure(
    take: Take,
    config: Config,
    variant: Variant,
    points: tuple[RatePoint, ...],
    qps: Sequence[int],
    emit: Callable[[str], Emit],
) -> tuple[RatePoint, ...]:
    """The variant's points, after measuring the missing ones."""
    missing = [qp for qp in qps if all(point.qp != qp for point in points)]
    if not missing:
        return points
    run(take, config, emit(f"{variant.title}: training"), stages=STAGE_NAMES[: STAGE_NAMES.index("bake")])
    for qp in missing:
        baked = config.model_copy(update={"bake": config.bake.replace(quality=qp)})
        run(take, baked, emit(f"{variant.title}: QP {qp}"), stages=("bake", "evaluate"))
        summary = read_evaluation(take.evaluation).summary
        measures = {name: value for name, value in summary.measures.items() if name in RatePoint.model_fields}
        points += (RatePoint(qp=qp, kb_per_frame=round(summary.bytes_per_frame / 1000, 3), **measures),)
    return tuple(sorted(points, key=lambda point: point.qp))


def share(source: Take, target: Take) -> None:
    """Copy cameras, initial points, the set and keyframes to a take without them; the runner checks whether they are
    valid."""
    for name in ("calibrate", "initialize", "set"):
        if (source.root / name).is_dir() and not (target.root / name).exists():
            shutil.copytree(source.root / name, target.root / name)
            record = source.record(name)
            if record.is_file():
                target.record(name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(record, target.record(name))
    if (target.root / "train").exists():
        return
    for group in trained_groups(source):
        target.train_group(group.index).mkdir(parents=True)
        keyframe = source.trained_frame(group.index, group.first + group.middle)
        for path in (source.train_group(group.index) / "group.json", keyframe):
            shutil.copy2(path, target.train_group(group.index) / path.name)


def compare(variants: Sequence[VariantResult]) -> tuple[VariantResult, ...]:
    """The variants, all but the first with BD-rate and BD-PSNR of its rate-distortion curve against the first's
    (Bjontegaard), by piecewise cubic interpolation (pchip) over the range that both curves cover."""
    import bjontegaard

    curves = [monotonic((point.kb_per_frame, point.psnr_decoded) for point in entry.points) for entry in variants]
    anchor = curves[0]
    results = [variants[0]]
    for entry, (rates, qualities) in zip(variants[1:], curves[1:], strict=True):
        bd_rate = bd_psnr = None
        if min(len(rates), len(anchor[0])) >= 4:
            if min(max(qualities), max(anchor[1])) > max(min(qualities), min(anchor[1])):
                bd_rate = round(float(bjontegaard.bd_rate(*anchor, rates, qualities, **METHOD)), 2)
            if min(max(rates), max(anchor[0])) > max(min(rates), min(anchor[0])):
                bd_psnr = round(float(bjontegaard.bd_psnr(*anchor, rates, qualities, **METHOD)), 3)
        results.append(entry.model_copy(update={"bd_rate_percent": bd_rate, "bd_psnr_db": bd_psnr}))
    return tuple(results)


def monotonic(points: Iterable[tuple[float, float]]) -> tuple[list[float], list[float]]:
    """Rates and qualities of a curve, both increasing; points that cost more without being better are dropped."""
    rates: list[float] = []
    qualities: list[float] = []
    for rate, quality in sorted(points):
        if not qualities or quality > qualities[-1]:
            rates.append(rate)
            qualities.append(quality)
    return rates, qualities
