from pathlib import Path

from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.calibrate.view import CalibrateView
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.results.stage_files import CameraChange, CameraRefinement
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.report import CameraVerdict, RigVerdict

SIZE = (900, 600)


def test_it_shows_matches_masks_and_what_refinement_changed(workspace: Workspace, take_copy: Path) -> None:
    take = Take.open(take_copy)
    workspace.open(take)
    view = CalibrateView(workspace)
    view.mode = "report"
    verdict = RigVerdict(
        grade="usable",
        reason="Camera cam1 disagrees with the others.",
        doubtful=("cam1",),
        blamed="cameras",
        cameras={"cam1": CameraVerdict(matches=120, fits=0.4, mask_error=0.33), "cam2": CameraVerdict()},
    )
    write_model(take.rig_verdict, verdict)
    change = CameraChange(degrees=0.5, distance=0.02, focal=1.0, principal_point=0.0, radial=0.0)
    report = CameraRefinement(key="", frame=0, used=True, before=29.0, after=31.0, cameras={"cam1": change})
    write_model(take.camera_refinement, report)
    before = view.state()
    table = view.draw(SIZE, before)
    rows = {line.split("\t")[0]: line.split("\t")[1:] for line in view.table_text.splitlines()}
    assert rows["cam1"][-3:] == ["40% of 120", "33%", "0.50\N{DEGREE SIGN}, 0.02"]
    assert rows["cam2"][-3:] == ["", "", ""]
    (block,) = [block for block in view.blocks if verdict.reason in block.note]
    assert "+2.00 dB" in block.note

    write_model(take.rig_verdict, verdict.model_copy(update={"doubtful": ()}))
    view.draw(SIZE, view.state())
    view.mode = "cameras"
    assert view.draw(SIZE, view.state()).shape == table.shape
