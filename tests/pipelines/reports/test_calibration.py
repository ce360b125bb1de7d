from html.parser import HTMLParser
from typing import Any

import numpy as np

from tests.support.rigs import camera_at
from v3studio.pipelines.reports.calibration import calibration_warnings, intrinsics_sentences, render_calibration
from v3studio.pipelines.takes.results.stage_files import CameraChange, CameraRefinement, CheckedCameras
from v3studio.studio.calibration import reprojection_report
from v3studio.studio.calibration.report import CalibrationReport, CameraVerdict, RigVerdict, SharedIntrinsicsReport
from v3studio.studio.cameras import Rig


def report_with(error: float, **more: object) -> CalibrationReport:
    ahead: dict[str, Any] = {"focal": 100.0, "size": (80, 60), "up": (0, -1, 0)}
    places = {"left <1>": -0.5, "right": 0.5}
    rig = Rig(tuple(camera_at(name, (x, 0, 0), (x, 0, 1), **ahead) for name, x in places.items()))
    points = np.random.default_rng(0).uniform([-0.5, -0.5, 2], [0.5, 0.5, 3], (40, 3))
    seen = {}
    for camera in rig:
        pixels, _ = camera.project(points)
        seen[camera.name] = np.column_stack([np.arange(40), pixels + np.array([error, 0])])
    return reprojection_report(rig, points, seen).model_copy(update=more)


def with_camera(report: CalibrationReport, name: str, **changes: object) -> CalibrationReport:
    """The report with other figures of one camera."""
    camera = report.cameras[name].model_copy(update=changes)
    return report.model_copy(update={"cameras": {**report.cameras, name: camera}})


class Page(HTMLParser):
    """The page of a report; each element is closed."""

    def __init__(self, report: CalibrationReport, verdict: Any = None, refinement: Any = None) -> None:
        super().__init__()
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(render_calibration(report, ["left <1>", "right"], CheckedCameras(report, verdict, refinement)))
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        if tag != "meta":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_warnings() -> None:
    high = next(calibration_warnings(report_with(1.5)))
    assert (high.code, high.value) == ("calibration.reprojection_error", 1.5)
    said = list(calibration_warnings(with_camera(report_with(0.3), "right", mean=1.4, coverage=0.2)))
    assert [message.code for message in said[:2]] == ["calibration.poor_cameras", "calibration.low_coverage"]
    assert said[0].fields["cameras"] == said[1].fields["cameras"] == ["right"]
    low = next(calibration_warnings(report_with(0.3, match_inlier_ratio=0.45)))
    assert (low.code, low.value) == ("calibration.match_inlier_ratio", 0.45)
    assert "only 45% of the matches" in str(low)
    fine = list(calibration_warnings(report_with(0.3, match_inlier_ratio=0.78)))
    assert "calibration.match_inlier_ratio" not in [message.code for message in fine]


def test_weak_cameras_are_named_with_their_uncertainty() -> None:
    figures = {"agree": {"left <1>": 0.32, "right": 0.8}, "uncertain_degrees": {"left <1>": 0.1, "right": 0.41}}
    report = report_with(0.3, uncertain={"left <1>": 0.002, "right": 0.012}, **figures)
    weak = next(calibration_warnings(report))
    assert weak.code == "calibration.weak_cameras"
    assert weak.fields["cameras"] == ["right", "left <1>"]
    assert "right (position 1.2% of the distance to the points, 0.41 degrees)" in str(weak)
    assert "left <1> (32% of its matches agree)" in str(weak)
    assert {"1.20%,\xa00.41°", "80%"} <= set(Page(report).words)
    sure = report_with(0.3, agree={"right": 0.8}, uncertain={"right": 0.002}, uncertain_degrees={"right": 0.1})
    assert "calibration.weak_cameras" not in [message.code for message in calibration_warnings(sure)]


def test_a_focal_length_that_cannot_be() -> None:
    found = next(calibration_warnings(with_camera(report_with(0.3), "right", usual_focal=50.0)))
    assert (found.code, found.value) == ("calibration.focal_length", 100)
    assert (found.fields["camera"], found.fields["expected"]) == ("right", 50)


def test_shared_intrinsics() -> None:
    assert intrinsics_sentences(report_with(0.3)) == []
    cameras = ["left <1>", "right"]
    shared = SharedIntrinsicsReport(images=cameras, shared=True, misfit=3.4)
    report = report_with(0.3, match_inlier_ratio=0.8, sharing=[shared])
    assert intrinsics_sentences(report)[0].startswith("Shared intrinsics for 2 cameras (left <1> to right)")
    assert "80% of the matches between cameras agree with the camera poses" in Page(report).text
    assert "Shared intrinsics for" in Page(report).text
    separate = SharedIntrinsicsReport(images=cameras, shared=False, misfit=91.2)
    report = report_with(0.3, match_inlier_ratio=0.8, sharing=[separate])
    assert "Separate intrinsics for 2 cameras" in intrinsics_sentences(report)[0]
    assert "91 times" in intrinsics_sentences(report)[0]
    for aspect, words in ((1.0025, "0.25% higher than wide"), (0.99, "1.00% wider than high")):
        assert words in intrinsics_sentences(report_with(0.3, match_inlier_ratio=0.8, aspect=aspect))[0]


def test_the_page_shows_the_grade_and_what_was_checked_not_a_rating_of_the_error() -> None:
    verdict = RigVerdict(
        grade="usable",
        reason="Camera right disagrees with the others.",
        doubtful=("right",),
        cameras={"right": CameraVerdict(matches=345, fits=0.41, mask_error=0.17)},
    )
    change = CameraChange(degrees=0.52, distance=0.031, focal=-4.5, principal_point=2.0, radial=0.01)
    refinement = CameraRefinement(key="", frame=0, used=True, before=29.3, after=32.0, cameras={"right": change})
    text = Page(report_with(0.1), verdict, refinement).text
    assert "Calibration: usable Camera right disagrees" in text
    assert "41% of 345 17% 0.52\N{DEGREE SIGN}, 0.031 units, focal length -4.5 px" in text
    assert "+2.70 dB" in text
    assert "not checked yet" in Page(report_with(0.1)).text
