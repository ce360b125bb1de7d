"""The color differences between the cameras of a take, fitted once before its groups are trained."""

from functools import partial

from v3studio.pipelines.stages.params import derived_seed
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.camera_fit import check_first_points, ensure_fitted, initial_points
from v3studio.pipelines.stages.training.plan import TrainPlan
from v3studio.pipelines.stages.training.views import ViewReader
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.results.stage_files import CameraColors
from v3studio.studio.counts import counted
from v3studio.studio.errors import Message

_LARGE = 13.0  # levels of 255 from the mean camera from which on a camera is named in the log


def ensure_camera_colors(plan: TrainPlan, reporter: StageReporter, key: str) -> None:
    """Fit the matrices unless they are there; any worker gives the same bytes. Raises StudioError."""
    check_first_points(plan.take, "the colors of the cameras are fitted to")
    fit = partial(_fit_to_splats, plan, reporter, key)
    ensure_fitted(plan, reporter, plan.take.camera_colors, CameraColors, key, fit)


def _fit_to_splats(plan: TrainPlan, reporter: StageReporter, key: str) -> None:
    from v3studio.studio.training import fit_camera_colors

    group, reader = plan.groups[0], ViewReader.of(plan.inputs, before_fits=True, colored=False)
    reading, fitting = reporter.counting("colors of cameras: image"), reporter.counting("colors of cameras: step")
    views = reader.views(group.keyframe, reporter, reading, plan.inputs.threads)
    points, seed = initial_points(plan.take, group, reader.device), derived_seed(plan.seed, "camera colors")
    matrices = fit_camera_colors(views, *points, plan.settings, seed=seed, progress=fitting)
    names = [view.camera.name for view in views]
    rows = {name: tuple(map(tuple, matrix.tolist())) for name, matrix in zip(names, matrices, strict=True)}
    colors = CameraColors(key=key, frame=int(group.keyframe), cameras=rows)
    plan.take.forget("train")
    write_model(plan.take.camera_colors, colors)
    _log_differences(reporter, colors)
    without = [name for name in reader.footage.train_cameras if name not in names]
    if without:
        reporter.warn(
            Message(
                "training.no_camera_color",
                f"the colors of {', '.join(without)} are not corrected in any frame: they do not see the performer in "
                f"frame {group.keyframe}, to which the colors of the cameras are fitted",
                fix="Start the take (capture.frames) at a frame in which all cameras see the performer, or leave these "
                "cameras out.",
                fields={"cameras": tuple(without), "frame": int(group.keyframe)},
            )
        )


def _log_differences(reporter: StageReporter, colors: CameraColors) -> None:
    """Log how far apart the cameras are, on a middle gray."""
    off = {name: colors.off_on_gray(name) for name in colors.cameras}
    far = sorted((name for name in off if off[name] > _LARGE), key=lambda name: -off[name])
    reporter.log(
        f"colors of {counted(len(off), 'camera')}: a middle gray differs from the mean camera by "
        f"{sum(off.values()) / len(off):.0f} levels of 255 (mean), {max(off.values()):.0f} (most)"
        + (f"; most in {', '.join(far[:5])}" if far else "")
    )
