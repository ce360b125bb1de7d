"""What each camera is used for: training, evaluation (held out), or nothing."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

from studio.capture import CaptureSettings, find_cameras, held_out_cameras
from studio.errors import StudioError

USES = ("training", "held out", "not used")  # what a camera can be used for


@dataclass(frozen=True)
class CameraUses:
    """See the module. `uses`: one of `USES` by camera, in the footage's order."""

    uses: Mapping[str, str]

    @classmethod
    def of(cls, spec: CaptureSettings) -> Self:
        """As the settings say. Raises StudioError: there is no footage, or the settings name unknown cameras."""
        names = find_cameras(spec)
        used = tuple(name for name in names if not spec.cameras or name in spec.cameras)
        held_out = held_out_cameras(spec, used)
        return cls(
            {name: "held out" if name in held_out else "training" if name in used else "not used" for name in names}
        )

    def with_use(self, use: str, *cameras: str) -> Self:
        """A copy with another use of some cameras, one of `USES`."""
        return replace(self, uses={**self.uses, **dict.fromkeys(cameras, use)})

    def settings(self, spec: CaptureSettings) -> dict[str, object]:
        """Settings, by dotted name, that give the cameras these uses; offsets of unused ones, which are refused, go."""
        used = [name for name, use in self.uses.items() if use != "not used"]
        if "training" not in self.uses.values():
            problem = "no camera is left to train on"
            raise StudioError("settings.no_training_camera", problem, fix="Use at least one for it.")
        values: dict[str, object] = {
            "capture.cameras": [] if len(used) == len(self.uses) else used,
            "capture.held_out": [name for name, use in self.uses.items() if use == "held out"],
        }
        if any(name not in used for name in spec.offsets):
            values["capture.offsets"] = {name: offset for name, offset in spec.offsets.items() if name in used}
        return values
