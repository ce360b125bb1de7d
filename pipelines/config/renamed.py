"""Renamed settings, values and stages. Old names are accepted, with a one-line note.

Digests (what a result was made from) use the original names, so that a rename makes nothing stale: see `first_names`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from studio.errors import StudioError
from studio.json_types import JsonData, JsonObject

STAGES = {"initialise": "initialize"}
"""Stages, which are also folders of a take and sections of settings: old name to new."""

SETTINGS = {
    "calibrate.lens": "calibrate.camera_model",
    "calibrate.shared_lens": "calibrate.shared_intrinsics",
    "calibrate.lens_groups": "calibrate.intrinsics_groups",
    "calibrate.lens_images": "calibrate.intrinsics_images",
    "calibrate.known": "calibrate.known_cameras",
    "calibrate.keep_known": "calibrate.fix_intrinsics",
    "calibrate.keep_poses": "calibrate.fix_poses",
    "calibrate.board_stands": "calibrate.board_upright",
    "train.density": "train.strategy",
    "train.motion_velocity_neighbours": "train.motion_velocity_neighbors",
    "train.motion_neighbours": "train.motion_neighbors",
    "train.simulate_quantisation": "train.simulate_quantization",
}
"""Dotted names of settings, old to new. Sections in `STAGES` are renamed as a whole."""

VALUES: dict[str, dict[str, str]] = {"train.strategy": {"gradient": "default"}}
"""Values of settings, old to new, by the setting's new name."""

ADDED: JsonObject = {
    "train.regularize": "planes",
    "train.refine_masks": "never",
    "train.refine_above": 0.22,
    "train.refine_moved_below": 0.66,
    "train.refine_every": 100,
    "train.refined_alpha_weight": 1.0,
    "train.chroma_siting": "none",
    "train.final_iterations": 0,
    "train.final_dropout": 0.1,
    "train.finetune_rate_final": 1.0,
    "train.motion_acceleration": 0.0,
    "train.motion_half_size": 0.0,
    "train.prune_by": "opacity",
    "train.relocate_ratio": 0.05,
    "train.dilation": 0.3,
    "train.camera_colors": False,
    "train.camera_color_iterations": 600,
    "train.camera_color_every": 150,
    "train.camera_vignettes": True,  # colors that were fitted before stay as they are
    "train.color_chart_frame": None,
    "train.full_size_details": False,
    "bake.ladder": [],
    "bake.first_group_size": None,
    "bake.b_frames": None,
    "bake.smooth_paths": None,
    "bake.view_range": "auto",  # written with the next bake; nothing is baked again for it
    "capture.mask_colored_shadows": False,
    "capture.audio": None,
    "capture.audio_offset": 0.0,
    "capture.transfer": "auto",
}
"""Settings added after takes of format 2 were first written, each with the value that keeps the earlier behavior."""

KEPT_SECTIONS = ("train",)
"""Sections in which the settings of an older take get the values of `ADDED`: a new default must not train it again."""

REPORT_KEYS = {
    "explained": "match_inlier_ratio",
    "geometry.neighbours": "neighbors",
    "moments": "sync_frames",
    "boards": "target",
    "target.moments": "sync_frames",
    "known_lenses": "known_intrinsics",
    "lenses": "intrinsics",
}
"""Keys of calibrate/report.json, old to new; of a nested key the last part changes."""


def complete_older_take(values: JsonObject) -> None:
    """Add what the settings of an older take lack, at the value that keeps its results, to those of `KEPT_SECTIONS`.

    Args:
        values: sections as read from a take's config.yaml, which lists all settings that existed; changed in place.
    """
    for name, value in ADDED.items():
        section, _, setting = name.partition(".")
        found = values.get(section)
        if section in KEPT_SECTIONS and isinstance(found, dict) and found:
            found.setdefault(setting, value)


RECORD_KEYS = {"ingredients": "params"}
"""Keys of a stage's record, old to new."""

_FIRST_STAGES = {now: before for before, now in STAGES.items()}
_FIRST_SETTINGS = {now: before for before, now in SETTINGS.items()}
_FIRST_VALUES = {name: {now: before for before, now in values.items()} for name, values in VALUES.items()}
_noted: set[str] = set()


def current_name(name: str) -> str:
    """The new name of a setting (dotted) or stage."""
    section, dot, rest = name.partition(".")
    return SETTINGS.get(name) or f"{STAGES.get(section, section)}{dot}{rest}"


def first_name(name: str) -> str:
    """The original name of a setting (dotted) or stage."""
    section, dot, rest = name.partition(".")
    return _FIRST_SETTINGS.get(name) or f"{_FIRST_STAGES.get(section, section)}{dot}{rest}"


def current_value(name: str, value: Any) -> Any:
    """The new name of a value; `name` is the setting's new name."""
    return VALUES.get(name, {}).get(value, value) if isinstance(value, str) else value


def current_names(params: Mapping[str, JsonData]) -> dict[str, JsonData]:
    """Params (settings by dotted name, and "result of STAGE") under the new names and values."""
    found = {}
    for key, value in params.items():
        name = _result_of(key, STAGES) or current_name(key)
        found[name] = current_value(name, value)
    return found


def first_names(params: Mapping[str, JsonData]) -> dict[str, JsonData]:
    """Params under the original names and values, which digests are made of."""
    found = {}
    for key, value in params.items():
        values = _FIRST_VALUES.get(key, {})
        name = _result_of(key, _FIRST_STAGES) or first_name(key)
        found[name] = values.get(value, value) if isinstance(value, str) else value
    return found


def first_tree(tree: Mapping[str, Mapping[str, JsonData]]) -> dict[str, dict[str, JsonData]]:
    """All sections, in their order, under the original names and values, without `ADDED` settings at their default."""
    found: dict[str, dict[str, JsonData]] = {}
    for section, values in tree.items():
        kept = {f"{section}.{name}": value for name, value in values.items()}
        kept = {name: value for name, value in kept.items() if name not in ADDED or ADDED[name] != value}
        found[first_name(section)] = {key.partition(".")[2]: value for key, value in first_names(kept).items()}
    return found


def current_path(path: str) -> str:
    """The new path of a file, relative to its take."""
    head, slash, rest = path.partition("/")
    return f"{STAGES.get(head, head)}{slash}{rest}"


def first_path(path: str) -> str:
    """The original path of a file, relative to its take."""
    head, slash, rest = path.partition("/")
    return f"{_FIRST_STAGES.get(head, head)}{slash}{rest}"


def renamed(values: JsonObject, where: str) -> tuple[JsonObject, list[str]]:
    """Sections of settings under the new names and values.

    Args:
        values: sections by name, as read from a file.
        where: file name for errors.

    Returns:
        the sections, and what was renamed ("calibrate.lens is now calibrate.camera_model").

    Raises:
        StudioError: a setting is given under its old and its new name (`settings.both_names`).
    """
    found: JsonObject = {}
    changes: list[str] = []
    for old_section, content in values.items():
        section = STAGES.get(old_section, old_section)
        if section != old_section:
            changes.append(f"{old_section} is now {section}")
            if section in values:
                raise _both(where, old_section, section)
        if not isinstance(content, Mapping):
            found[section] = content
            continue
        settings: JsonObject = {}
        for key, value in content.items():
            old = f"{section}.{key}"
            name = SETTINGS.get(old, old)
            if name != old:
                changes.append(f"{old} is now {name}")
                if name.partition(".")[2] in content:
                    raise _both(where, old, name)
            now = current_value(name, value)
            if now != value:
                changes.append(f"{name}: {value} is now {now}")
            settings[name.partition(".")[2]] = now
        found[section] = settings
    return found, changes


def renamed_override(name: str, value: Any) -> tuple[str, Any, list[str]]:
    """An override (dotted name, value) under its new name and value, and what was renamed."""
    now = current_name(name)
    new = current_value(now, value)
    changes = [f"{name} is now {now}"] if now != name else []
    return now, new, changes + ([f"{now}: {value} is now {new}"] if new != value else [])


def note_renames(where: str, changes: list[str]) -> None:
    """Print one line on stderr, once per process for each file and set of names."""
    if not changes:
        return
    line = f"{where}: {', '.join(dict.fromkeys(changes))}."
    if line not in _noted:
        _noted.add(line)
        print(f"note: {line}", file=sys.stderr)


def _both(where: str, old: str, new: str) -> StudioError:
    return StudioError(
        "settings.both_names",
        f"{old} was renamed to {new}, and both are set",
        file=where,
        fix=f"Keep {new}.",
        setting=new,
    )


def _result_of(key: str, stages: Mapping[str, str]) -> str | None:
    begin = "result of "
    return f"{begin}{stages.get(key[len(begin) :], key[len(begin) :])}" if key.startswith(begin) else None
