"""The calibration report: an HTML page, figures for events, and warnings."""

from collections.abc import Iterator, Sequence

from v3studio.pipelines.reports.page import rendered
from v3studio.pipelines.takes.results.stage_files import NOT_CHECKED, CheckedCameras, checked_cameras
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import write_text
from v3studio.studio.calibration.report import CalibrationReport
from v3studio.studio.camera_files import read_rig
from v3studio.studio.errors import Message
from v3studio.studio.json_types import JsonData

_SPARSE = 0.4  # smallest fraction of the image with observations; elsewhere lens distortion is extrapolated
_UNSURE = 0.02  # largest 1-sigma camera position uncertainty, as a fraction of the distance to the points
_FAR_OFF = 0.05  # largest error of a measured point in meters: five standard deviations
_NEAR, _FAR = 0.05, 100  # plausible camera distances in meters


def intrinsics_sentences(report: CalibrationReport) -> list[str]:
    """Sentences about shared intrinsics, if calibration compared shared and separate ones."""
    from v3studio.studio.calibration.sfm.shared_intrinsics import LIMIT
    from v3studio.studio.calibration.sfm.verdict import TRUSTED

    found: list[str] = []
    if report.match_inlier_ratio is not None and report.match_inlier_ratio < TRUSTED:
        return found  # the comparison is meaningless if the poses are wrong
    for each in report.sharing:
        which = f"{len(each.images)} cameras ({each.images[0]} to {each.images[-1]})"
        if each.shared:
            found.append(f"Shared intrinsics for {which}: they fit as well as separate ones.")
        else:
            found.append(
                f"Separate intrinsics for {which}: with shared ones the errors grow {each.misfit:.0f} times more "
                f"than expected by chance (limit {LIMIT:.0f}; set calibrate.shared_intrinsics to override)."
            )
    if report.aspect != 1:
        longer = "higher than wide" if report.aspect > 1 else "wider than high"
        found.append(f"Pixels are {100 * abs(report.aspect - 1):.2f}% {longer} in all cameras.")
    return found


def write_calibration_page(take: Take) -> None:
    """Write calibrate/report.html again; nothing for a camera file. Raises StudioError: `take.damaged`."""
    checked = checked_cameras(take)
    if isinstance(checked.report, CalibrationReport):
        page = render_calibration(checked.report, read_rig(take.rig).names, checked)
        write_text(take.calibration_report.with_suffix(".html"), page)


def calibration_figures(report: CalibrationReport) -> dict[str, JsonData]:
    """Figures for an event: reprojection errors over all cameras and the mean of each, pixels; and the share of
    matches that agree, if it was measured."""
    errors, ratio = report.reprojection, report.match_inlier_ratio
    return {
        **{f"reprojection_{name}": getattr(errors, name) for name in ("mean", "median", "p95")},
        "points": report.points,
        "cameras": {name: camera.mean for name, camera in report.cameras.items()},
        **({} if ratio is None else {"match_inlier_ratio": ratio}),
    }


def calibration_warnings(report: CalibrationReport) -> Iterator[Message]:
    """Warnings about a calibration; codes `calibration.*`."""
    from v3studio.studio.calibration.sfm.verdict import MISPLACED, TRUSTED, WEAK

    yield from tie_warnings(report)
    mean = report.reprojection.mean
    if mean > 1 and not report.tie_points:
        problem = (
            f"the mean reprojection error is {mean:.2f} px; more than 1 px means that cameras moved, the footage "
            "is not synchronized, or the camera model has too few parameters"
        )
        fields: dict[str, JsonData] = {"setting": "calibrate.camera_model"}
        yield Message("calibration.reprojection_error", problem, value=mean, fields=fields)
    for name, figures in report.cameras.items():
        if figures.usual_focal is not None:
            problem = (
                f"camera '{name}' has a focal length of {figures.focal:.0f} px, the others "
                f"{figures.usual_focal:.0f} px; unless its zoom differs, its intrinsics are wrong"
            )
            fix = (
                "Try calibrate.shared_intrinsics or calibrate.intrinsics_groups, or set its intrinsics with "
                "calibrate.known_cameras."
            )
            fields = {"camera": name, "expected": figures.usual_focal, "setting": "calibrate.shared_intrinsics"}
            yield Message("calibration.focal_length", problem, value=figures.focal, fix=fix, fields=fields)
    poor = [name for name, figures in report.cameras.items() if figures.mean > 1]
    if poor and mean <= 1:
        problem = f"the reprojection error is more than 1 px for {', '.join(poor)}"
        fix = "Check these cameras before training."
        yield Message("calibration.poor_cameras", problem, fix=fix, fields={"cameras": poor})
    match_inlier_ratio = report.match_inlier_ratio
    if match_inlier_ratio is not None and match_inlier_ratio < TRUSTED:
        yield Message(
            "calibration.match_inlier_ratio",
            f"only {match_inlier_ratio:.0%} of the matches between cameras agree with the camera poses (75% or "
            "more is normal); some poses may be wrong even if the reprojection error is low",
            value=match_inlier_ratio,
            fix="Try calibrate.shared_intrinsics if the lenses are identical, different or more frames "
            "(calibrate.frame, calibrate.frame_count), or a calibration target.",
            fields={"expected": TRUSTED, "setting": "calibrate.shared_intrinsics"},
        )
    weak = {
        name: f"{name} (position {report.uncertain[name]:.1%} of the distance to the points, {degrees:.2f} degrees)"
        for name, degrees in report.uncertain_degrees.items()
        if report.uncertain[name] > WEAK
    }
    weak |= {n: f"{n} ({share:.0%} of its matches agree)" for n, share in report.agree.items() if share < MISPLACED}
    if weak:
        problem = f"these cameras are less certain than the others (1 sigma): {', '.join(weak.values())}"
        fix = "Use more frames (calibrate.frame_count), or marked points."
        fields = {"cameras": list(weak), "setting": "calibrate.frame_count"}
        yield Message("calibration.weak_cameras", problem, fix=fix, fields=fields)
    known = report.known_intrinsics
    sparse = [n for n, figures in report.cameras.items() if figures.coverage < _SPARSE and n not in known]
    if sparse:
        problem = (
            f"observations cover less than {_SPARSE:.0%} of the image for {', '.join(sparse)}; lens distortion is "
            "unreliable elsewhere"
        )
        yield Message("calibration.low_coverage", problem, fields={"cameras": sparse})


def tie_warnings(report: CalibrationReport) -> Iterator[Message]:
    """Warnings about a calibration from tie points; codes `tie_points.*`."""
    if not report.tie_points:
        return
    mean = report.reprojection.mean
    if mean > 1:
        problem = (
            f"the mean reprojection error of the tie points is {mean:.2f} px; more than 1 px means that they were "
            "marked inaccurately, in images of another size, or with other intrinsics"
        )
        yield Message("tie_points.reprojection_error", problem, value=mean)
    unsure = {name: share for name, share in report.uncertain.items() if share > _UNSURE}
    if unsure:
        worst = max(unsure, key=lambda name: unsure[name])
        problem = (
            f"the 1-sigma position uncertainty of {', '.join(unsure)} is up to {unsure[worst]:.0%} of the distance "
            f"to the points ({worst})"
        )
        fix = "Mark more points in these cameras, spread over the image and in depth."
        fields = {"cameras": list(unsure), "camera": worst}
        yield Message("tie_points.position_uncertainty", problem, value=unsure[worst], fix=fix, fields=fields)
    for mark in report.left_out:
        where = "behind the camera" if mark.error is None else f"{mark.error:.1f} px away"
        problem = f"point '{mark.point}' was rejected in {mark.camera}: the other marks put it {where}"
        fields = {"point": mark.point, "camera": mark.camera}
        yield Message("tie_points.rejected", problem, value=mark.error, fix="Check this mark.", fields=fields)
    off = {name: point.off for name, point in report.tie_points.items() if point.off is not None}
    far = sorted((name for name in off if off[name] > _FAR_OFF), key=lambda name: -off[name])
    if far:
        named = ", ".join(f"'{name}' ({off[name]:.3g} m)" for name in far[:3]) + (", ..." if len(far) > 3 else "")
        problem = f"measured positions disagree with the marks: {named}"
        fix = "Check the measurements; the world axes must be right-handed with z up."
        yield Message("tie_points.world_error", problem, fix=fix, fields={"points": far})
    away = report.geometry.radius
    if report.metric and not _NEAR < away < _FAR:
        problem = f"the mean distance of the cameras from their common center is {away:.3g} m, which is implausible"
        fix = "Check that positions and distances are in meters."
        yield Message("tie_points.unit", problem, value=away, fix=fix)


def render_calibration(report: CalibrationReport, names: Sequence[str], checked: CheckedCameras) -> str:
    """Render the HTML page. `names`: cameras in the order to show."""
    most = max((max(map(max, figures.coverage_map)) for figures in report.cameras.values()), default=1)
    return rendered(
        "calibration.html.j2",
        report=report,
        names=[name for name in names if name in report.cameras],
        verdict=checked.verdict,
        not_checked=NOT_CHECKED,
        refinement=checked.refinement,
        warnings=list(calibration_warnings(report)),
        intrinsics=intrinsics_sentences(report),
        most=max(most, 1),
        longest=max(report.tracks.values(), default=1),
    )
