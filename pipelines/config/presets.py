"""Presets: schedules of training, from a quick look to the paper's."""

from collections.abc import Mapping
from functools import reduce
from operator import getitem

from pydantic import JsonValue

from v3studio.pipelines.config.config import Config, values_of

_SHORTER: dict[str, Mapping[str, JsonValue]] = {
    "preview": {
        "initialize.points": 10_000,
        "train.keyframe_iterations": 800,
        "train.densify_from": 150,
        "train.densify_until": 500,
        "train.densify_max_splats": 20_000,
        "train.prune_ratio": 0.3,
        "train.prune_by": "opacity",
        "train.prune_finetune_iterations": 250,
        "train.max_splats": 18_000,
        "train.dilation": 0.1,
        "train.motion_iterations": 80,
        "train.motion_first_iterations": 150,
        "train.motion_views": 2,
        "train.motion_learning_rate": 4.0e-3,
        "train.hash_levels": 6,
        "train.mlp_layers": 1,
        "train.mlp_width": 32,
        "train.finetune_iterations": 80,
        "train.finetune_means": True,
        "train.joint_iterations": 0,
    },
    "standard": {
        "initialize.points": 14_000,
        "train.keyframe_iterations": 2000,
        "train.densify_from": 300,
        "train.densify_until": 1400,
        "train.densify_max_splats": 34_000,
        "train.prune_ratio": 0.35,
        "train.prune_by": "contribution",
        "train.prune_finetune_iterations": 800,
        "train.max_splats": 36_000,
        "train.dilation": 0.1,
        "train.motion_iterations": 170,
        "train.motion_first_iterations": 300,
        "train.motion_views": 2,
        "train.motion_learning_rate": 4.0e-3,
        "train.hash_levels": 6,
        "train.mlp_layers": 1,
        "train.mlp_width": 32,
        "train.finetune_iterations": 250,
        "train.finetune_means": True,
        "train.joint_iterations": 100,
    },
}
PRESETS = _SHORTER | {"final": {name: values_of(Config())[name] for name in _SHORTER["standard"]}}
"""Values by dotted name. preview: a quick look. standard: the schedule of sample_configs/quickstart.yaml, for CPUs.
final: the paper's schedule, the defaults, for GPUs. All of them set the same settings."""


def has_gpu() -> bool:
    """Return whether splats can be trained on a GPU of this machine."""
    from v3studio.studio.rasterizer import preferred_device

    return preferred_device().type != "cpu"


def preset_here() -> str:
    """The preset for this machine: without a GPU, the schedule of "final" would take days."""
    return "final" if has_gpu() else "standard"


def preset_of(config: Config) -> str:
    """The preset with the fewest settings that differ; the first of several."""
    values = values_of(config)
    return min(PRESETS, key=lambda name: sum(values[key] != value for key, value in PRESETS[name].items()))


def differing(config: Config, preset: str) -> dict[str, JsonValue]:
    """Settings of the take's processing that differ from a preset, with the preset's values; settings that a preset
    does not set have their defaults. Settings that describe the footage are left out."""
    footage = ("capture.", "calibrate.", "evaluate.exact_masks")
    values, usual = values_of(config), {**values_of(Config()), **PRESETS[preset]}
    return {name: value for name, value in usual.items() if not name.startswith(footage) and values[name] != value}


def with_values(config: Config, values: Mapping[str, JsonValue]) -> Config:
    """A validated copy with some values replaced, by dotted name. Raises StudioError: `settings.invalid`."""
    changed = config.model_dump(mode="json")
    for name, value in values.items():
        *sections, last = name.split(".")
        reduce(getitem, sections, changed)[last] = value
    return Config(**changed)
