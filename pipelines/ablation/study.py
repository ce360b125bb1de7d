"""The paper's ablation on any capture: which part of training is worth its place, in PSNR against kilobytes a frame."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pipelines.ablation.variants import Variant
from pipelines.config import Config, load_config
from pipelines.config.loading import digest_text
from pipelines.events import Emit
from pipelines.runs.runner import run
from pipelines.takes.atomic_files import digest_of, read_json, write_json
from pipelines.takes.take import Take

_KEPT = ("psnr_decoded", "psnr_trained", "ssim_decoded", "lpips_decoded")
_METHOD: dict[str, Any] = {"method": "pchip", "require_matching_points": False, "min_overlap": 0}


def ablate(
    config_path: Path,
    out: Path,
    overrides: Sequence[tuple[str, Any]],
    variants: Sequence[Variant],
    qps: Sequence[int],
    emit: Callable[[str], Emit],
) -> dict[str, Any]:
    """Train each variant, bake it at each QP, decode and measure it, and write `out`/ablation.json as it grows.

    Each variant is a take of its own under `out`/takes. What variants share (cameras, initial points, keyframes that
    are trained alike) is copied, not made again; points that are measured already are not measured again.

    Args:
        config_path: the configuration of the full method.
        out: folder for the takes and the results.
        overrides: settings on top of the file, for all variants.
        variants: the first one is what the others are compared with.
        qps: ascending or not; at least four, or no rate can be compared.
        emit: told what is done, gives who hears of that work's events.

    Returns:
        What stands in ablation.json: `variants`, each with `points` (qp, kb_per_frame, psnr_decoded, psnr_trained,
        ssim_decoded, and lpips_decoded where evaluate.lpips asks for it) and, but for the first, `bd_rate_percent` and
        `bd_psnr_db` against it (None where the curves do not overlap).

    Raises:
        StudioError, Cancelled: as of `run`.
    """
    results_path = out / "ablation.json"
    out.mkdir(parents=True, exist_ok=True)
    before = read_json(results_path) if results_path.is_file() else {"variants": []}
    known = {entry["name"]: entry for entry in before["variants"]}
    results: dict[str, Any] = {"protocol": None, "qps": sorted(qps), "variants": []}
    base: Take | None = None
    for variant in variants:
        config = load_config(config_path, [*overrides, *variant.settings.items()])
        take = Take.create(out / "takes" / variant.name)
        if base is None:
            base = take
        else:
            share(base, take)
        entry = known.get(variant.name, {})
        digest = digest_of(digest_text(config))
        if entry.get("settings") != digest:
            entry = {"points": []}
        entry.update(name=variant.name, title=variant.title, settings=digest)
        results["variants"].append(entry)
        _measure(take, config, variant, entry, qps, emit)
        results["protocol"] = read_json(take.evaluation)["protocol"]
        compare(results["variants"])
        write_json(results_path, results)
    return results


def _measure(
    take: Take, config: Config, variant: Variant, entry: dict[str, Any], qps: Sequence[int], emit: Callable[[str], Emit]
) -> None:
    have = {point["qp"] for point in entry["points"]}
    missing = [qp for qp in qps if qp not in have]
    if not missing:
        return
    run(take, config, emit(f"{variant.title}: training"), stages=("calibrate", "initialize", "train"))
    for qp in missing:
        settings = {"qp": qp, "target_kb_per_frame": None, "target_psnr": None}
        baked = config.model_copy(update={"bake": config.bake.model_copy(update=settings)})
        run(take, baked, emit(f"{variant.title}: QP {qp}"), stages=("bake", "evaluate"))
        summary = read_json(take.evaluation)["summary"]
        entry["points"].append(
            {
                "qp": qp,
                "kb_per_frame": round(summary["bytes_per_frame"] / 1000, 3),
                **{name: summary[name] for name in _KEPT if name in summary},
            }
        )
    entry["points"].sort(key=lambda point: point["qp"])


def share(source: Take, target: Take) -> None:
    """Copy cameras, initial points and keyframes to a take that has none; the runner checks whether they fit it."""
    for name in ("calibrate", "initialize"):
        if (source.root / name).is_dir() and not (target.root / name).exists():
            shutil.copytree(source.root / name, target.root / name)
            record = source.record(name)
            if record.is_file():
                target.record(name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(record, target.record(name))
    if (target.root / "train").exists():
        return
    for folder in sorted((source.root / "train").glob("group_*")):
        frames = sorted(folder.glob("frame_*.safetensors"))
        if frames and (folder / "group.json").is_file():
            (target.root / "train" / folder.name).mkdir(parents=True)
            for path in (folder / "group.json", frames[0]):
                shutil.copy2(path, target.root / "train" / folder.name / path.name)


def compare(variants: list[dict[str, Any]]) -> None:
    """Write into each entry but the first how its rate-distortion curve lies against the first one's (Bjontegaard).

    `bd_rate_percent`: mean difference in bytes at equal PSNR, below 0 is smaller than the first; `bd_psnr_db`: mean
    difference in PSNR at equal bytes. Piecewise cubic interpolation (pchip), over the range that both curves cover.
    """
    import bjontegaard

    anchor = _curve(variants[0]["points"])
    for entry in variants[1:]:
        rates, qualities = _curve(entry["points"])
        entry["bd_rate_percent"] = entry["bd_psnr_db"] = None
        if min(len(rates), len(anchor[0])) < 4:
            continue
        overlap = min(max(qualities), max(anchor[1])) - max(min(qualities), min(anchor[1]))
        if overlap > 0:
            value = bjontegaard.bd_rate(*anchor, rates, qualities, **_METHOD)
            entry["bd_rate_percent"] = round(float(value), 2)
        if min(max(rates), max(anchor[0])) > max(min(rates), min(anchor[0])):
            value = bjontegaard.bd_psnr(*anchor, rates, qualities, **_METHOD)
            entry["bd_psnr_db"] = round(float(value), 3)


def _curve(points: Sequence[dict[str, Any]]) -> tuple[list[float], list[float]]:
    """Kilobytes a frame and PSNR, both rising; a point that costs more and is no better is left out."""
    rates: list[float] = []
    qualities: list[float] = []
    for rate, quality in sorted((point["kb_per_frame"], point["psnr_decoded"]) for point in points):
        if not qualities or quality > qualities[-1]:
            rates.append(rate)
            qualities.append(quality)
    return rates, qualities
