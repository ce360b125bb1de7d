"""The log says figures with words and units."""

from __future__ import annotations

from gui.models.take.log_words import metrics_words
from gui.models.take.run_state import RunState
from pipelines.events import Metrics, StageFinished


def test_figures_of_each_stage_are_words_with_units() -> None:
    said = {
        "calibrate": metrics_words(
            Metrics(
                stage="calibrate",
                values={
                    "reprojection_mean": 0.312, "reprojection_median": 0.2, "reprojection_p95": 0.9, "points": 3201,
                    "cameras": {"a": 0.1, "b": 0.4}, "unregistered": {"cam09": "too few matches"},
                    "match_inlier_ratio": 0.92,
                },
            )
        ),
        "initialize": metrics_words(
            Metrics(
                stage="initialize", group=1,
                values={"points": 45000, "faces": 200_000, "disagreement": {"cam01": 0.02, "cam02": 0.05}},
            )
        ),
        "train": metrics_words(
            Metrics(stage="train", group=0, frame=12, values={"index": 2, "splats": 35871, "seconds": 64.0})
        ),
        "bake": metrics_words(Metrics(stage="bake", group=0, values={"splats": 900, "bytes": 463_210, "frames": 15})),
        "evaluate": metrics_words(
            Metrics(stage="evaluate", group=0, frame=3, values={"psnr_trained": 30.771, "psnr_decoded": 30.638})
        ),
        "all": metrics_words(Metrics(stage="evaluate", values={"psnr_trained": 30.771, "psnr_decoded": 30.638})),
    }  # fmt: skip
    assert said == {
        "calibrate": "Calibrate: 2 cameras, mean reprojection error 0.31 px (95% below 0.90 px), 3,201 points, "
        "92% of the matches agree, not registered: cam09",
        "initialize": "Initialize, group 1: 45,000 points, mesh of 200,000 triangles, "
        "masks differ from the hull by up to 5% (cam02)",
        "train": "Train, frame 12: 35,871 splats, 1 min 04 s",
        "bake": "Bake, group 0: 15 frames, 900 splats, 463.2 KB",
        "evaluate": "Evaluate, frame 3: PSNR 30.77 dB trained, PSNR 30.64 dB decoded",
        "all": "Evaluate: PSNR 30.64 dB (before baking 30.77 dB)",
    }


def test_a_finished_stage_says_what_it_made() -> None:
    run = RunState()
    run.apply(StageFinished(stage="bake", seconds=9, summary={"frames": 30, "groups": 2, "bytes": 925_207}))
    assert run.lines[-1] == ("", "Bake: done in 9.0 s. 30 frames in 2 groups, 925.2 KB")
