"""Plans a calibration: what the cameras come from, and what they are made from."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Literal

from v3studio.pipelines.stages.camera_file import camera_file, files_of
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.known_cameras import named_file
from v3studio.pipelines.stages.params import Params, settings_affecting
from v3studio.pipelines.stages.target import target_digest
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.camera_files import read_rig
from v3studio.studio.errors import StudioError

_MORE_FRAMES = (1, 3, 6, 12, 24)  # numbers of frames that are tried until they are enough


class CalibratePlan:
    """The sources of a take's cameras, looked for once. Raises StudioError: several sources are set."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs, self.take, self.config = inputs, inputs.take, inputs.config
        self.settings, self.footage = inputs.config.calibrate, inputs.raw_footage
        self.capture, self.threads = inputs.capture, inputs.threads
        ways = [name for name in ("board_images", "tie_points") if getattr(self.settings, name)]
        named = self.config.capture.rig not in (None, "auto")
        if len(ways) + named > 1:
            names = [*["capture.rig"] * named, *(f"calibrate.{way}" for way in ways)]
            problem = f"several camera sources are set: {' and '.join(names)}"
            fix = "Keep only one; capture.rig may be null."
            raise StudioError("settings.conflict", problem, fix=fix, setting=names[0], other=names[1])

    @cached_property
    def camera_file(self) -> Path | None:
        """The calibration file, if the stage only reads one; one found by capture.rig = auto is ignored if another
        source is set. Raises StudioError as the stage does."""
        if self.settings.board_images or self.settings.tie_points:
            return None
        return camera_file(self.capture)

    @property
    def source(self) -> Literal["file", "board", "tie points", "footage"]:
        """The source of the cameras."""
        if self.settings.board_images:
            return "board"
        if self.settings.tie_points:
            return "tie points"
        return "footage" if self.camera_file is None else "file"

    @property
    def tie_file(self) -> Path:
        """The file with tie points. Raises StudioError: there is none."""
        return named_file(self.settings, "tie_points", self.capture.root)

    @cached_property
    def attempts(self) -> list[list[int]]:
        """The frames of the footage that cameras are calibrated from; several lists if the first may not be enough."""
        return frames_to_try(self.settings, self.footage.frames)

    def params(self) -> Params:
        """Content of the calibration file, or the footage and calibration settings."""
        config, footage = self.config, self.footage
        if self.camera_file is not None:
            return {
                "camera file": _digest(self.camera_file),
                "cameras without calibration": self._uncalibrated(),
                **settings_affecting(config, "cameras_from_file"),
            }
        if self.source == "board":
            return {
                "board footage": target_digest(self.settings, self.capture),
                **settings_affecting(config, "cameras_from_target"),
            }
        if self.source == "tie points":
            return {
                "tie points": _digest(self.tie_file),
                "sizes": {name: list(footage.raw_size(name)) for name in footage.camera_names},
                **settings_affecting(config, "cameras_from_points"),
                **self._intrinsics_files(),
            }
        masked = self.settings.look_at != "everything"
        return {
            "footage": self.inputs.footage_digest,
            "frames": self.attempts,
            **settings_affecting(config, "cameras_from_images", *(("calibration_masks",) if masked else ())),
            **self._intrinsics_files(),
        }

    def _uncalibrated(self) -> list[str]:
        """Cameras of the footage that the take does not have, such as those that got masks since. Cameras that the
        footage has lost do not count: it may not be mounted."""
        try:
            known = read_rig(self.take.rig).names
        except StudioError:  # not there yet, or damaged, which is found elsewhere
            return []
        return [name for name in self.footage.camera_names if name not in known]

    def _intrinsics_files(self) -> Params:
        """Digests of the files that known intrinsics are read from."""
        digests: Params = {}
        if self.settings.known_cameras:
            digests["known"] = _digest(named_file(self.settings, "known_cameras", self.capture.root))
        if self.settings.intrinsics_images:
            digests["board footage"] = target_digest(self.settings, self.capture)
        return digests


def frames_to_try(section: CalibrateSettings, frames: Sequence[int]) -> list[list[int]]:
    """The frames of the footage that cameras are calibrated from; several lists if the first may not be enough."""
    if section.frame is None:
        counts = _MORE_FRAMES if section.frame_count is None else (section.frame_count,)
        fewer = sorted({min(count, len(frames)) for count in counts})
        return [_spread(frames, count) for count in fewer]
    frame, count, setting = section.frame, section.frame_count or 1, "calibrate.frame"
    if count > 1:
        problem = f"calibrate.frame = {frame} selects one frame, but calibrate.frame_count = {count} requests several"
        fix = "Set only one of them."
        raise StudioError(
            "settings.conflict", problem, value=frame, fix=fix, setting=setting, other="calibrate.frame_count"
        )
    if frame not in frames:
        first, last = int(frames[0]), int(frames[-1])
        problem = f"calibrate.frame = {frame} is not among the used frames"
        fix = f"Used frames are {first} to {last}."
        raise StudioError(
            "settings.unknown_frame", problem, value=frame, fix=fix, setting=setting, first=first, last=last
        )
    return [[frame]]


def _spread(frames: Sequence[int], count: int) -> list[int]:
    """The centers of equal parts: at the ends of a take there is often nobody in view. One frame: the first."""
    if count == 1:
        return [int(frames[0])]
    return [int(frames[int((part + 0.5) * len(frames) / count)]) for part in range(count)]


def _digest(path: Path) -> str | dict[str, str]:
    """Digest of a file, or digests of the files in a folder or of a pattern by name."""
    several = [match.path for match in files_of(path)]
    if several:
        return {f"{file.parent.name}/{file.name}": digest_of_file(file) for file in several}
    if path.is_dir():
        files = [
            file for pattern in ("*", "[0-9]*/cameras.*", "[0-9]*/images.*") for file in sorted(path.glob(pattern))
        ]
        return {file.relative_to(path).as_posix(): digest_of_file(file) for file in files if file.is_file()}
    return digest_of_file(path)
