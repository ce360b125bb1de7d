"""The calibration report and its warnings."""

from __future__ import annotations

from html.parser import HTMLParser

import numpy as np

from pipelines.reports.calibration import (
    calibration_figures,
    calibration_lenses,
    calibration_warnings,
    render_calibration,
)
from studio.calibration import reprojection_report
from studio.cameras import Camera, Rig


def report_with(error: float) -> dict:
    K = np.array([[100.0, 0, 40], [0, 100, 30], [0, 0, 1]])
    cameras = []
    for name, x in (("left <1>", -0.5), ("right", 0.5)):
        pose = np.eye(4)
        pose[0, 3] = -x
        cameras.append(Camera(name, 80, 60, K, pose))
    rig = Rig(tuple(cameras))
    points = np.random.default_rng(0).uniform([-0.5, -0.5, 2], [0.5, 0.5, 3], (40, 3))
    seen = {}
    for camera in rig:
        pixels, _ = camera.project(points)
        seen[camera.name] = np.column_stack([np.arange(40), pixels + np.array([error, 0])])
    return {**reprojection_report(rig, points, seen).to_dict(), "unregistered": {"lost": "only 3 features were found"}}


class Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta",):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_page_says_what_the_report_holds():
    report = report_with(0.3)
    page = Page()
    page.feed(render_calibration(report, ["left <1>", "right"]))
    assert page.open == []  # whole HTML
    text = " ".join(" ".join(page.words).split())
    assert "Calibration: excellent" in text
    assert "0.300 px" in text
    assert "80 observations of 40 points by 2 cameras" in text
    assert "left <1>" in text
    assert "not registered: only 3 features were found" in text


def test_warnings():
    last = calibration_warnings(report_with(0.3))[-1]
    assert str(last) == "camera 'lost' was not registered: only 3 features were found."
    assert (last.code, last.fields["camera"]) == ("calibration.unregistered", "lost")
    high = calibration_warnings(report_with(1.5))[0]
    assert high.code == "calibration.reprojection_error"
    assert high.value == 1.5
    report = report_with(0.3)
    report["cameras"]["right"]["mean"] = 1.4
    report["cameras"]["right"]["coverage"] = 0.2
    said = calibration_warnings(report)
    assert [message.code for message in said[:2]] == ["calibration.poor_cameras", "calibration.low_coverage"]
    assert said[0].fields["cameras"] == said[1].fields["cameras"] == ["right"]
    low = calibration_warnings({**report_with(0.3), "match_inlier_ratio": 0.45})[0]
    assert (low.code, low.value) == ("calibration.match_inlier_ratio", 0.45)
    assert "only 45% of the matches" in str(low)
    fine = calibration_warnings({**report_with(0.3), "match_inlier_ratio": 0.78})
    assert "calibration.match_inlier_ratio" not in [message.code for message in fine]


def test_a_focal_length_that_cannot_be():
    report = report_with(0.3)
    report["cameras"]["right"]["usual_focal"] = 50.0
    found = calibration_warnings(report)[0]
    assert (found.code, found.value) == ("calibration.focal_length", 100)
    assert (found.fields["camera"], found.fields["expected"]) == ("right", 50)


def test_lenses_in_common():
    report = report_with(0.3)
    assert calibration_lenses(report) == []
    cameras = ["left <1>", "right"]
    report |= {"match_inlier_ratio": 0.8, "sharing": [{"images": cameras, "shared": True, "misfit": 3.4}]}
    assert calibration_lenses(report)[0].startswith("Shared intrinsics for 2 cameras (left <1> to right)")
    page = Page()
    page.feed(render_calibration(report, cameras))
    text = " ".join(" ".join(page.words).split())
    assert (
        "80% of the matches between cameras agree with the camera poses (75% or more is normal). Shared intrinsics for"
        in text
    )
    report["sharing"][0] |= {"shared": False, "misfit": 91.2}
    assert "Separate intrinsics for 2 cameras" in calibration_lenses(report)[0]
    assert "91 times" in calibration_lenses(report)[0]


def test_figures_of_the_event():
    figures = calibration_figures(report_with(0.3))
    assert figures["reprojection_mean"] == 0.3
    assert figures["cameras"] == {"left <1>": 0.3, "right": 0.3}
    assert figures["unregistered"] == {"lost": "only 3 features were found"}
