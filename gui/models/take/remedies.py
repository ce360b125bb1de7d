"""Remedies: which setting fixes a warning, and its value where the warning knows it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from pydantic import JsonValue

from v3studio.gui.models.take.page_words import setting_words
from v3studio.gui.models.take.settings import setting_value, stage_of
from v3studio.pipelines.config import Config
from v3studio.pipelines.events import Notice
from v3studio.studio.json_types import JsonData
from v3studio.studio.masks.sources import SOURCES
from v3studio.studio.yaml_text import inline_yaml

REMEDIES: Mapping[str, str] = {  # the setting that fixes a warning, by its code
    "bake.beyond_hardware": "train.max_splats",
    "bake.short_sound": "capture.audio_offset",
    "calibration.focal_length": "calibrate.shared_intrinsics",
    "calibration.match_inlier_ratio": "calibrate.frame_count",
    "calibration.reprojection_error": "calibrate.camera_model",
    "calibration.weak_cameras": "calibrate.frame_count",
    "cluster.no_node": "run.memory_per_group",
    "cluster.out_of_memory": "run.memory_per_group",
    "coverage.gaps": "bake.view_range",
    "evaluation.masks_contradicted": "capture.masks",
    "evaluation.no_held_out": "capture.held_out",
    "footage.few_frames": "calibrate.frame_count",
    "hull.mask_mismatch": "capture.mask_sensitivity",
    "mask.inverted": "capture.mask_labels",
    "rig.doubtful": "capture.cameras",
    "hull.outlier_mask": "capture.mask_sensitivity",
    "training.no_camera_color": "capture.frames",
    "training.slow": "capture.scale",
}

_SUGGESTED = {"footage.few_frames": "frames", "masks.contradiction": "suggested", "training.slow": "suggested"}
"""The field of a warning that has the setting's value, by its code."""

_OF_MASKS = ("evaluation.masks_contradicted", "hull.mask_mismatch", "hull.outlier_mask")
"""Warnings about the masks of cameras, which one has to see."""

_DETECTED = {source.name for source in SOURCES if source.detects}


@dataclass(frozen=True)
class Fix:
    """A button below a warning in the log: sets a setting, or shows it, or the mask of a camera in a frame, by its
    number. `done`: it has this value already."""

    setting: str
    value: JsonValue = None
    sets: bool = False
    done: bool = False
    camera: str = ""
    frame: int = -1  # -1: the one on screen

    @property
    def words(self) -> str:
        if self.camera:
            return f"Show {self.camera}" + (f", frame {self.frame}" if self.frame >= 0 else "")
        if self.done:
            return f"{setting_words(self.setting)} is {inline_yaml(self.value)} now"
        shown = setting_words(self.setting)
        return f"Set {shown} to {inline_yaml(self.value)}" if self.sets else f"Show {shown}"


def fix_of(notice: Notice | None, config: Config | None) -> Fix | None:
    """The fix of a warning or an error; None if there is none, or no settings are open."""
    if notice is None or config is None:
        return None
    setting = REMEDIES.get(notice.code) or str(notice.fields.get("setting", ""))
    if setting == "capture.mask_sensitivity" and config.capture.masks not in _DETECTED:
        setting = "capture.masks"
    if not stage_of(setting):
        return None
    value = "none" if notice.code == "coverage.gaps" else notice.fields.get(_SUGGESTED.get(notice.code, ""))
    if value is None:
        camera, frame = mask_of(notice.fields) if notice.code in _OF_MASKS else ("", -1)
        return Fix(setting, camera=camera, frame=frame)
    known = cast(JsonValue, value)
    return Fix(setting, known, sets=True, done=setting_value(config, setting) == known)


def mask_of(fields: Mapping[str, JsonData]) -> tuple[str, int]:
    """The camera and the number of the frame that a message names, or the first of several; "" and -1 without them."""

    def first(kind: str) -> JsonData:
        several = fields.get(f"{kind}s")
        return several[0] if isinstance(several, list | tuple) and several else fields.get(kind)

    camera, frame = first("camera"), first("frame")
    return str(camera or ""), frame if camera and isinstance(frame, int) else -1
