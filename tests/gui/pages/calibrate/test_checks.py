import json
from pathlib import Path

from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.calibrate.measured_cameras import MeasuredCameras, Verdict
from v3studio.gui.pages.calibrate.view import CalibrateView
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.results.stage_files import CameraChange, CameraRefinement, InitialPointsReport
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.report import CameraVerdict, RigVerdict
from v3studio.studio.camera_files import read_rig

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
    files = [take.initialize_group(group) / "report.json" for group in range(2)]
    made = [read_model(path, InitialPointsReport).disagreement for path in files]
    off = {name: f"{max(errors[name] for errors in made):.0%}" for name in ("cam1", "cam2")}
    assert rows["cam1"][-3:] == ["40% of 120", off["cam1"], "0.50\N{DEGREE SIGN}, 0.02"], "as in the log"
    assert rows["cam2"][-3:] == ["", off["cam2"], ""]
    (block,) = [block for block in view.blocks if verdict.reason in block.note]
    assert "+2.00 dB" in block.note

    write_model(take.rig_verdict, verdict.model_copy(update={"doubtful": ()}))
    view.draw(SIZE, view.state())
    view.mode = "cameras"
    assert view.draw(SIZE, view.state()).shape == table.shape


def test_a_dot_is_of_the_measured_error_of_its_camera(take_copy: Path) -> None:
    take = Take.open(take_copy)
    path = take.initialize_group(0) / "report.json"
    fine = CameraVerdict(matches=120, fits=0.9, mask_error=0.05)
    names = [f"cam{number}" for number in range(6)]
    verdict = RigVerdict(grade="good", reason="", cameras=dict.fromkeys(names, fine))
    rig = json.loads(take.rig.read_text())
    camera = next(camera for camera in rig["cameras"] if camera["name"] == "cam4")
    camera["K"][0][0] *= 1.6
    take.rig.write_text(json.dumps(rig))
    write_model(take.rig_verdict, verdict)
    report = read_model(path, InitialPointsReport)
    errors = {**dict.fromkeys(names, 0.05), "cam3": 0.3, "cam2": 0.5}
    write_model(path, report.model_copy(update={"disagreement": errors}))
    measured = MeasuredCameras.read(take, read_rig(take.rig))
    dots = {name: measured.verdict(name) for name in names}
    assert dots["cam3"] == Verdict.WORSE
    assert dots["cam2"] == dots["cam4"] == Verdict.DISAGREES
    assert dots["cam0"] == dots["cam1"] == Verdict.AGREES
