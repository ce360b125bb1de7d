"""Remedies: which setting fixes a warning, and its value where the warning knows it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

from pydantic import JsonValue

from gui.models.take.page_words import setting_words
from gui.models.take.settings import setting_value, stage_of
from pipelines.config import Config
from pipelines.events import Notice
from studio.json_types import JsonData
from studio.masks.sources import SOURCES
from studio.yaml_text import inline_yaml

Value = Callable[[Mapping[str, JsonData]], JsonData]  # the value from the warning's fields; None if they do not tell it


@dataclass(frozen=True)
class Remedy:
    """What to do about a warning: the setting, and its value; None if people must choose it."""

    setting: str
    value: Value | None = None


def _told(name: str) -> Value:
    return lambda fields: fields.get(name)


REMEDIES: Mapping[str, Remedy] = {  # by code of the warning
    "bake.beyond_hardware": Remedy("train.max_splats"),
    "bake.short_sound": Remedy("capture.audio_offset"),
    "calibration.focal_length": Remedy("calibrate.shared_intrinsics"),
    "calibration.match_inlier_ratio": Remedy("calibrate.frame_count"),
    "calibration.reprojection_error": Remedy("calibrate.camera_model"),
    "calibration.weak_cameras": Remedy("calibrate.frame_count"),
    "cluster.no_node": Remedy("run.memory_per_group"),
    "cluster.out_of_memory": Remedy("run.memory_per_group"),
    "coverage.gaps": Remedy("bake.view_range", lambda _fields: "none"),
    "evaluation.no_held_out": Remedy("capture.held_out"),
    "footage.few_frames": Remedy("calibrate.frame_count", _told("frames")),
    "hull.mask_mismatch": Remedy("capture.mask_sensitivity"),
    "mask.inverted": Remedy("capture.mask_labels"),
    "rig.doubtful": Remedy("capture.cameras"),
    "hull.outlier_mask": Remedy("capture.mask_sensitivity"),
    "training.no_camera_color": Remedy("capture.frames"),
    "training.no_color_chart": Remedy("train.camera_colors"),
    "training.slow": Remedy("capture.scale", _told("suggested")),
}

_DETECTED = {source.name for source in SOURCES if source.detects}


@dataclass(frozen=True)
class Fix:
    """A button below a warning in the log: sets a setting, or shows it. `done`: it has this value already."""

    setting: str
    value: JsonValue = None
    sets: bool = False
    done: bool = False

    @property
    def words(self) -> str:
        if self.done:
            return f"{setting_words(self.setting)} is {inline_yaml(self.value)} now"
        shown = setting_words(self.setting)
        return f"Set {shown} to {inline_yaml(self.value)}" if self.sets else f"Show {shown}"


def fix_of(notice: Notice | None, config: Config | None) -> Fix | None:
    """The fix of a warning or an error; None if there is none, or no settings are open."""
    if notice is None or config is None:
        return None
    remedy = REMEDIES.get(notice.code) or Remedy(str(notice.fields.get("setting", "")))
    if remedy.setting == "capture.mask_sensitivity" and config.capture.masks not in _DETECTED:
        remedy = Remedy("capture.masks")
    if not stage_of(remedy.setting):
        return None
    if remedy.value is None or (value := remedy.value(notice.fields)) is None:
        return Fix(remedy.setting)
    known = cast(JsonValue, value)
    return Fix(remedy.setting, known, sets=True, done=setting_value(config, remedy.setting) == known)
