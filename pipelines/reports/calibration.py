"""The calibration's report for people: a page, a line of figures for events, and what to warn of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

_BANDS = {
    "excellent": "under 0.5 px",
    "acceptable": "0.5 to 1 px",
    "review": "over 1 px",
}
_SPARSE = 0.4
"""Share of the image that observations should cover at least, or the lens is a guess in the rest."""
_UNSURE = 0.02
"""Share of the distance to the points; what marks leave open beyond it is worth a warning."""
_FAR_OFF = 5
"""Times calibrate.tie_world_accuracy that a measured place may be off."""
_NEAR, _FAR = 0.05, 100
"""Meters; cameras nearer or farther are likely given in another unit."""


def calibration_lenses(report: dict[str, Any]) -> list[str]:
    """Sentences on lenses in common, where the footage was asked."""
    from studio.calibration.sfm.shared_intrinsics import LIMIT
    from studio.calibration.sfm.verdict import TRUSTED

    found: list[str] = []
    if report.get("match_inlier_ratio", 1.0) < TRUSTED:
        return found  # what a wrong solution says of lenses means nothing
    for each in report.get("sharing", []):
        which = f"{len(each['images'])} cameras ({each['images'][0]} to {each['images'][-1]})"
        if each["shared"]:
            found.append(f"One lens for {which}: it fits as well as a lens each.")
        else:
            found.append(
                f"A lens each for {which}: with one for all the errors grow {each['misfit']:.0f} times as much as by "
                f"chance (up to {LIMIT:.0f} would pass; calibrate.shared_intrinsics decides it beforehand)."
            )
    return found


def calibration_figures(report: dict[str, Any]) -> dict[str, Any]:
    """The figures that an event carries: over all cameras, and the mean error of each."""
    return {
        **{f"reprojection_{key}": value for key, value in report["reprojection"].items()},
        "quality": report["quality"],
        "points": report["points"],
        "cameras": {name: figures["mean"] for name, figures in report["cameras"].items()},
        "unregistered": report.get("unregistered", {}),
        **({"match_inlier_ratio": report["match_inlier_ratio"]} if "match_inlier_ratio" in report else {}),
    }


def calibration_warnings(report: dict[str, Any]) -> list[str]:
    """Sentences on what should be looked at."""
    from studio.calibration.sfm.verdict import TRUSTED

    found = tie_warnings(report)
    if report["reprojection"]["mean"] > 1 and "tie_points" not in report:
        found.append(
            f"The cameras' mean reprojection error is {report['reprojection']['mean']:.2f} px; over 1 px something is "
            "wrong: cameras that moved, footage that is not synchronized, or a lens model with too few terms."
        )
    for name, figures in report["cameras"].items():
        if "usual_focal" in figures:
            found.append(
                f"Camera '{name}' has a focal length of {figures['focal']:.0f} px where the others have "
                f"{figures['usual_focal']:.0f}: unless it is zoomed so, its lens was not found; try "
                "calibrate.shared_intrinsics or intrinsics_groups, or give its lens (calibrate.known_cameras)."
            )
    poor = [name for name, figures in report["cameras"].items() if figures["mean"] > 1]
    if poor and report["reprojection"]["mean"] <= 1:
        found.append(f"The reprojection error is over 1 px for {', '.join(poor)}; look at them before you train.")
    match_inlier_ratio = report.get("match_inlier_ratio", 1.0)
    if match_inlier_ratio < TRUSTED:
        found.append(
            f"Only {match_inlier_ratio:.0%} of the matches between cameras agree with where they were put (0.75 and "
            "more is usual): some may stand wrongly, whatever their reprojection error; try "
            "calibrate.shared_intrinsics where the lenses are alike, other or more moments (calibrate.frame, frames) "
            "or a board."
        )
    known = report.get("known_lenses", ())
    sparse = [n for n, figures in report["cameras"].items() if figures["coverage"] < _SPARSE and n not in known]
    if sparse:
        found.append(
            f"Less than {_SPARSE:.0%} of the image holds anything to calibrate by for {', '.join(sparse)}; elsewhere "
            "their lenses are a guess."
        )
    for name, reason in report.get("unregistered", {}).items():
        found.append(f"Camera '{name}' found no place: {reason}.")
    return found


def tie_warnings(report: dict[str, Any]) -> list[str]:
    """Sentences on points marked by hand."""
    if "tie_points" not in report:
        return []
    found = []
    if report["reprojection"]["mean"] > 1:
        found.append(
            f"The marks lie {report['reprojection']['mean']:.2f} px from where they should, on the mean; over 1 px "
            "they were set carelessly, in pictures of another size or for other lenses."
        )
    unsure = {name: share for name, share in report.get("uncertain", {}).items() if share > _UNSURE}
    if unsure:
        worst = max(unsure, key=lambda name: unsure[name])
        found.append(
            f"The marks say where {', '.join(unsure)} {'stands' if len(unsure) == 1 else 'stand'} only to "
            f"{unsure[worst]:.0%} of the distance to the points ({worst}); mark more points there, spread over the "
            "picture and in depth."
        )
    for mark in report.get("left_out", []):
        where = "behind the camera" if mark["error"] is None else f"{mark['error']:.1f} px from the mark"
        found.append(
            f"Point '{mark['point']}' was left out in {mark['camera']}: the other marks say that it lies {where}; look "
            "at it again."
        )
    off = {name: point["off"] for name, point in report["tie_points"].items() if "off" in point}
    far = sorted((name for name in off if off[name] > _FAR_OFF * report["world_accuracy"]), key=lambda name: -off[name])
    if far:
        named = ", ".join(f"'{name}' ({off[name]:.3g} m)" for name in far[:3]) + (", ..." if len(far) > 3 else "")
        found.append(
            f"Measured places lie far from where the marks say: {named}. One of them is wrong, or the axes are not "
            "right-handed with z up."
        )
    away = report["geometry"]["radius"]
    if report["metric"] and not _NEAR < away < _FAR:
        found.append(f"The cameras stand {away:.3g} m from the point they look at; are places and distances in meters?")
    return found


def render_calibration(report: dict[str, Any], names: Sequence[str]) -> str:
    """The page.

    Args:
        report: what calibrate/report.json holds.
        names: the cameras, in the order to show.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("pipelines.reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    most = max((max(map(max, figures["coverage_map"])) for figures in report["cameras"].values()), default=1)
    return environment.get_template("calibration.html.j2").render(
        report=report,
        names=[name for name in names if name in report["cameras"]],
        bands=_BANDS,
        warnings=calibration_warnings(report),
        lenses=calibration_lenses(report),
        most=max(most, 1),
        longest=max(report["tracks"].values(), default=1),
    )
