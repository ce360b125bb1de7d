"""Main figures of stages are told in words and units."""

from __future__ import annotations

import pytest

from pipelines.reports.summary_words import summary_words
from pipelines.stages.summaries import BakeSummary, CalibrateSummary, EvaluationSummary, InitializeSummary, TrainSummary

QUALITY = {"psnr_trained": 30.724, "psnr_decoded": 30.601, "ssim_trained": 0.91, "ssim_decoded": 0.9}
SUMMARIES = {
    "calibrate": CalibrateSummary(
        cameras=12, source="footage", grade="good", mean_error_px=0.314, match_inlier_ratio=0.914
    ),
    "initialize": InitializeSummary(groups=2, points_per_group=30000, faces=(600, 1200)),
    "train": TrainSummary(groups=2, frames=30, splats=(31906, 28000)),
    "bake": BakeSummary(groups=2, frames=30, bytes=5_100_000, bytes_per_frame=54100, renditions=6),
    "evaluate": EvaluationSummary(
        **QUALITY, bytes_per_frame=54100.4, psnr_trained_lowest_frame=29, psnr_decoded_lowest_frame=28.9
    ),
}
WORDS = {
    "calibrate": "12 cameras from the footage, checked: good, mean reprojection error 0.31 px, 91% of the matches "
    "agree",
    "initialize": "2 groups, 30,000 points each, meshes of 600 to 1,200 triangles",
    "train": "30 frames in 2 groups, 28,000 to 31,906 splats per group",
    "bake": "30 frames in 2 groups, 5.1 MB in 6 renditions, 54.1 KB per frame to play the best one",
    "evaluate": "PSNR 30.60 dB (before baking 30.72 dB), lowest frame 28.90 dB, SSIM 0.9000 (before baking 0.9100), "
    "54.1 KB per frame",
}


@pytest.mark.parametrize("stage", SUMMARIES)
def test_each_stage(stage: str) -> None:
    values = SUMMARIES[stage].to_json()
    words = summary_words(stage, values)
    assert words == WORDS[stage]
    assert not any(name in words for name in values if "_" in name)
