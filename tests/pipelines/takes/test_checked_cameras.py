"""What is known about the cameras of a take, from the files of three stages."""

from pathlib import Path

from pipelines.takes.atomic_files import write_model
from pipelines.takes.checked_cameras import NOT_CHECKED, checked_cameras
from pipelines.takes.stage_files import CameraRefinement, CamerasFromFile
from pipelines.takes.take import Take
from studio.calibration.verdict import RigVerdict


def test_the_verdict_of_initialize_and_the_refinement_are_added_as_they_come(tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    assert checked_cameras(take).sentences == []
    for path in (take.calibration_report, take.rig_verdict, take.camera_refinement):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_model(take.calibration_report, CamerasFromFile(file="rig.json"))
    assert checked_cameras(take).sentences == [NOT_CHECKED]
    write_model(take.rig_verdict, RigVerdict(grade="wrong", reason="The rig is folded.", fix="Use a board."))
    assert checked_cameras(take).sentences == ["Cameras wrong: The rig is folded. Use a board."]
    refinement = CameraRefinement(key="k", frame=3, used=False, before=30.0, after=30.01)
    write_model(take.camera_refinement, refinement)
    assert checked_cameras(take).sentences[1:] == [refinement.sentence]
    assert "+0.01 dB" in refinement.sentence
