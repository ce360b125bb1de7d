"""Cameras: those that came with the capture, else structure from motion on one moment of the footage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pipelines.files import atomic_path, digest_of_file, write_json
from pipelines.point_files import write_points
from pipelines.stages.arguments import camera_file, sfm_settings
from pipelines.stages.base import Context, Ingredients, StageReporter, settings_of, without
from studio.errors import StudioError


class CalibrateStage:
    """See the module."""

    name = "calibrate"
    title = "Cameras"
    version = 1
    weight = 1.0
    needs: tuple[str, ...] = ()

    def ingredients(self, context: Context) -> Ingredients:
        """A calibration file's content, or the footage and how it is calibrated."""
        given = camera_file(context.config.capture)
        if given is not None:
            return {"camera file": _digest(given), "capture.cameras": list(context.config.capture.cameras)}
        capture = settings_of(context.config, "capture.images", "capture.cameras", "capture.color_matrix")
        if context.config.calibrate.ignore_performer:
            capture |= without(settings_of(context.config, "capture"), *_NO_MATTER_FOR_MASKS)
        return {
            "footage": context.footage_digest,
            "frame": self._frame(context),
            **capture,
            **without(settings_of(context.config, "calibrate", "run.seed"), "calibrate.frame"),
        }

    def results(self, context: Context) -> list[Path]:
        """calibrate/rig.json."""
        return [context.take.rig]

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """All or nothing."""
        return None

    def run(self, context: Context, reporter: StageReporter) -> dict[str, Any]:
        """Write rig.json and report.json."""
        from studio.camera_files import write_rig

        given = camera_file(context.config.capture)
        if given is not None:
            rig, report = self._from_file(context, given)
        else:
            rig, report = self._from_footage(context, reporter)
        with atomic_path(context.take.rig) as temporary:
            write_rig(rig, temporary)
        write_json(context.take.calibration_report, report)
        context.forget_footage()
        reporter.progress(1.0, "cameras stand")
        return {"cameras": len(rig), "source": report["source"]}

    def _from_file(self, context: Context, path: Path) -> tuple[Any, dict[str, Any]]:
        from studio.camera_files import read_rig
        from studio.cameras import Rig
        from studio.capture import match_rig

        names = context.raw_footage.camera_names
        rig = read_rig(path)
        if context.config.capture.cameras:
            rig = Rig(tuple(camera for camera in rig if camera.name in names or Path(camera.name).stem in names))
        return Rig(tuple(match_rig(rig, names).values())), {"source": "file", "file": str(path)}

    def _frame(self, context: Context) -> int:
        frames = context.raw_footage.frames
        wanted = context.config.calibrate.frame
        if wanted is None:
            return int(frames[0])
        if wanted not in frames:
            raise StudioError(
                f"calibrate.frame = {wanted} is not among the frames that are used ({frames[0]} to {frames[-1]})."
            )
        return wanted

    def _from_footage(self, context: Context, reporter: StageReporter) -> tuple[Any, dict[str, Any]]:
        from studio.calibration import calibrate_from_images

        footage = context.raw_footage
        frame = self._frame(context)
        images = {}
        for number, camera in enumerate(footage.camera_names):
            reporter.progress(0.1 * number / len(footage.camera_names), f"reading frame {frame}")
            images[camera] = footage.raw_image(camera, frame)
        masks = None
        if context.config.calibrate.ignore_performer:
            # structure from motion wants what may be looked at: the room
            masks = {
                camera: np.where(footage.raw_matte(camera, frame) < 128, 255, 0).astype(np.uint8)
                for camera in footage.camera_names
            }
        work = context.take.work(self.name)
        work.mkdir(parents=True, exist_ok=True)
        result = calibrate_from_images(
            images,
            masks,
            workdir=work,
            settings=sfm_settings(context.config.calibrate, context.config.run),
            progress=reporter.part("structure from motion", 0.1, 1.0),
        )
        with atomic_path(context.take.calibration_points) as temporary:
            write_points(temporary, result.points, None, result.colors)
        return result.rig.subset(footage.camera_names), {"source": "footage", "frame": frame, **result.report}


_NO_MATTER_FOR_MASKS = (
    "capture.root", "capture.rig", "capture.fps", "capture.background", "capture.held_out", "capture.held_out_every",
    "capture.evaluation_mattes", "capture.cache_megabytes", "capture.stop", "capture.start", "capture.step",
    "capture.scale", "capture.size_rule",
)  # fmt: skip


def _digest(path: Path) -> Any:
    """Of a file, or of the files in a folder."""
    if path.is_dir():
        return {file.name: digest_of_file(file) for file in sorted(path.iterdir()) if file.is_file()}
    return digest_of_file(path)
