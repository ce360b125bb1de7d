"""Main figures of a finished stage as words with units, for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from studio.comparison.metrics import EVALUATED
from studio.counts import plural
from studio.json_types import JsonData


def summary_words(stage: str, summary: Mapping[str, JsonData]) -> str:
    """One line, for example "30 frames in 2 groups, 31,906 splats"."""
    rest = dict(summary)
    words = [part for part in _WORDS[stage](rest) if part] if stage in _WORDS else []
    # whatever is left over: figures of stages added by others
    words += [f"{name.replace('_', ' ')} {_plain(value)}" for name, value in rest.items() if value is not None]
    return ", ".join(words)


def size_words(count: float) -> str:
    """Bytes as "2.6 KB", "12.8 MB" or "1.4 GB" (1 KB = 1000 bytes)."""
    for unit, name in ((1e9, "GB"), (1e6, "MB")):
        if count >= unit:
            return f"{count / unit:.1f} {name}"
    return f"{count / 1000:.1f} KB"


def _calibrate(rest: dict[str, JsonData]) -> list[str]:
    cameras, source = rest.pop("cameras", None), rest.pop("source", None)
    error, ratio = rest.pop("mean_error_px", None), rest.pop("match_inlier_ratio", None)
    grade = rest.pop("grade", None)
    origin = "" if source is None else f" from {'a camera file' if source == 'file' else f'the {source}'}"
    return [
        "" if cameras is None else f"{_count(cameras, 'camera')}{origin}",
        "" if grade is None else f"checked: {grade}",
        "" if not isinstance(error, int | float) else f"mean reprojection error {error:.2f} px",
        "" if not isinstance(ratio, int | float) else f"{ratio:.0%} of the matches agree",
    ]


def _initialize(rest: dict[str, JsonData]) -> list[str]:
    groups, points, faces = rest.pop("groups", None), rest.pop("points_per_group", None), rest.pop("faces", None)
    return [
        "" if groups is None else _count(groups, "group"),
        "" if points is None else f"{_plain(points)} points each",
        "" if not faces else f"meshes of {_span(faces)} triangles",
    ]


def _train(rest: dict[str, JsonData]) -> list[str]:
    shares = rest.pop("outlines_off", None)
    off = [one for one in shares if one is not None] if isinstance(shares, list | tuple) else []
    return [
        _length(rest),
        _span_words(rest.pop("splats", None)),
        f"masks and splats disagree along {_span(off)}% of the outlines" if off else "",
    ]


def _bake(rest: dict[str, JsonData]) -> list[str]:
    length = _length(rest)
    total, per_frame, renditions = (rest.pop(name, None) for name in ("bytes", "bytes_per_frame", "renditions"))
    several = isinstance(renditions, int) and renditions > 1
    size = "" if not isinstance(total, int | float) else size_words(total)
    rate = "" if not isinstance(per_frame, int | float) else f"{size_words(per_frame)} per frame"
    qps, psnr = rest.pop("qps", None), rest.pop("psnr_to_trained", None)
    quality = [f"QP {_span(qps)}" if qps else "", f"{psnr:.1f} dB to trained" if isinstance(psnr, float) else ""]
    groups = rest.pop("unsmoothed", None)
    if isinstance(groups, list | tuple) and groups:
        quality.append(f"without smooth paths: group {', '.join(map(_plain, groups))}")
    if several:
        size, rate = size and f"{size} in {renditions} renditions", rate and f"{rate} to play the best one"
    return [length, size, rate, *quality]


def _evaluate(rest: dict[str, JsonData]) -> list[str]:
    words = []
    for metric in EVALUATED:
        decoded, trained, lowest, _ = (
            rest.pop(f"{metric.name}_{what}", None)
            for what in ("decoded", "trained", "decoded_lowest_frame", "trained_lowest_frame")
        )
        if not isinstance(decoded, int | float) or not isinstance(trained, int | float):
            continue
        words.append(f"{metric.title} {metric.text(decoded)} (before baking {metric.text(trained)})")
        if isinstance(lowest, int | float):
            words.append(f"lowest frame {metric.text(lowest)}")
    per_frame = rest.pop("bytes_per_frame", None)
    words.append(f"{size_words(per_frame)} per frame" if isinstance(per_frame, int | float) else "")
    flicker, borders = rest.pop("flicker", None), rest.pop("flicker_at_group_borders", None)
    if isinstance(flicker, int | float):
        at = f" ({borders:.1f} at group borders)" if isinstance(borders, int | float) else ""
        words.append(f"flicker {flicker:.1f} of 255 levels{at}")
    return words


_WORDS = {
    "calibrate": _calibrate,
    "initialize": _initialize,
    "train": _train,
    "bake": _bake,
    "evaluate": _evaluate,
}


def _length(rest: dict[str, JsonData]) -> str:
    frames, groups = rest.pop("frames", None), rest.pop("groups", None)
    if frames is None or groups is None:
        return ""
    return f"{_count(frames, 'frame')} in {_count(groups, 'group')}"


def _span_words(splats: JsonData) -> str:
    if not isinstance(splats, list | tuple) or not splats:
        return ""
    return f"{_span(splats)} splats{' per group' * (len(splats) > 1)}"


def _span(values: object) -> str:
    """Numbers as "294", or "294 to 310" if they differ."""
    if not isinstance(values, Sequence) or not values:
        return _plain(values)
    low, high = min(values), max(values)
    return _plain(low) if low == high else f"{_plain(low)} to {_plain(high)}"


def _count(value: object, noun: str) -> str:
    return f"{_plain(value)} {plural(noun, value if isinstance(value, int | float) else 2)}"


def _plain(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        text = ", ".join(map(_plain, value)) if isinstance(value, list | tuple) else str(value)
        return text if len(text) <= 60 else text[:57] + "..."
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:.4g}" if abs(value) < 1000 else f"{value:,.0f}"
