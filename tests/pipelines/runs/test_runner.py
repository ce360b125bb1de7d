import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.support.errors import refuses
from tests.support.events import frames_in, warnings_in
from tests.support.tiny_capture import settings_in
from v3studio.pipelines.config import load_config
from v3studio.pipelines.events import (
    Event,
    Finished,
    Log,
    Metrics,
    Preview,
    Progress,
    StageFinished,
    StageStarted,
    Warned,
)
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.runs.runner import StageNotes, run, status
from v3studio.pipelines.stages import STAGE_NAMES, stage_named
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.results.kept_bakes import keep_bake, kept_bakes
from v3studio.pipelines.takes.results.point_files import read_points
from v3studio.pipelines.takes.results.records import RecordedWarning, StageRecord
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import Cancelled, StudioError

FEW = ("train.keyframe_iterations=5", "train.motion_iterations=1", "train.finetune_iterations=1", "capture.frames=:2")


class Project:
    """A copy of the finished take next to its capture."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.take = Take.open(folder / "take")

    def run(self, *overrides: str, **options: Any) -> list[Event]:
        config = settings_in(self.folder, *overrides)
        events: list[Event] = []
        try:
            run(self.take, config, events.append, **options)
        finally:
            assert isinstance(events[-1], Finished)
            self.events = events
        return events

    def states(self, *overrides: str) -> dict[str, str]:
        self.found = status(self.take, settings_in(self.folder, *overrides))
        return {name: statuses.state for name, statuses in self.found.items()}

    def bytes_of(self, *names: str) -> dict[str, bytes]:
        files = [path for name in names for path in sorted((self.take.root / name).rglob("*")) if path.is_file()]
        return {path.relative_to(self.take.root).as_posix(): path.read_bytes() for path in files}

    def written(self, name: str) -> dict[str, int]:
        return {path.name: path.stat().st_mtime_ns for path in (self.take.root / name).rglob("frame_*")}


@pytest.fixture
def project(copied: Path) -> Project:
    return Project(copied)


def ran(events: list[Event]) -> list[str]:
    return [event.stage for event in events if isinstance(event, StageStarted)]


def test_a_run_leaves_every_result_in_its_place(project: Path) -> None:
    root = project.take.root
    assert {path.name for path in root.iterdir()} == {
        "take.json", "config.yaml", *STAGE_NAMES[:-2], "stream", "evaluation.json", "report.html", ".v3studio",
    }  # fmt: skip
    assert [path.name for path in sorted((root / "train/group_000").iterdir())] == [
        "frame_000000.safetensors", "frame_000001.safetensors", "frame_000002.safetensors", "group.json",
    ]  # fmt: skip
    assert {path.name for path in (root / "stream").iterdir()} == {"manifest.json", "files"}
    assert len(list((root / "stream" / "files").iterdir())) == 4  # a side file and a video for each group
    points, colors = read_points(root / "initialize/group_001/points.ply")
    assert points.shape == colors.shape == (400, 3)
    # the ball of radius 0.55 is at (0.09, 0.06, 0) in frame 3; a hull from five cameras is slightly larger
    assert np.abs(np.linalg.norm(points - [0.09, 0.06, 0], axis=1) - 0.55).mean() < 0.1
    assert len(read_frame(root / "train/group_001/frame_000003.safetensors")) <= 400


def test_evaluation_says_what_was_measured_and_how(project: Path) -> None:
    evaluation = json.loads(project.take.evaluation.read_text())
    summary, protocol = evaluation["summary"], evaluation["protocol"]
    assert {"psnr_trained", "psnr_decoded", "ssim_trained", "ssim_decoded", "bytes_per_frame"} <= set(summary)
    assert protocol["held_out"] is True
    assert (protocol["cameras"], protocol["resolution"]) == (["cam4"], {"cam4": [64, 48]})
    on_disk = sum(path.stat().st_size for path in project.take.stream.rglob("*") if path.is_file())
    assert protocol["total_bytes"] == on_disk
    assert summary["bytes_per_frame"] == pytest.approx(on_disk / 5, abs=0.1)
    assert [row["frame"] for row in evaluation["frames"]] == [0, 1, 2, 3, 4]
    for row in evaluation["frames"]:
        assert row["psnr_decoded"] == row["cameras"]["cam4"]["psnr_decoded"]
    mean = np.mean([row["psnr_trained"] for row in evaluation["frames"]])
    assert summary["psnr_trained"] == pytest.approx(mean, abs=1e-3)


def test_psnr_is_that_of_the_cropped_held_out_image(project: Path) -> None:
    """Compared with NumPy, from the files: decoded frame 3 rendered here, the held-out PNG over black, cropped here."""
    import torch

    from v3studio.studio.camera_files import read_rig
    from v3studio.studio.rasterizer import rasterize
    from v3studio.studio.stream import StreamReader

    rgba = np.array(Image.open(project.folder / "capture/images/cam4/003.png")).astype(float) / 255
    truth = rgba[..., :3] * rgba[..., 3:]
    rows, columns = np.flatnonzero(rgba[..., 3].any(1)), np.flatnonzero(rgba[..., 3].any(0))
    with StreamReader.open(project.take.stream) as reader, torch.no_grad():
        image = rasterize(reader.gaussians(3), read_rig(project.take.rig)["cam4"]).image.clamp(0, 1).double().numpy()
    part = np.s_[max(0, rows[0] - 8) : rows[-1] + 9, max(0, columns[0] - 8) : columns[-1] + 9]
    expected = -10 * np.log10(((image[part] - truth[part]) ** 2).mean())
    measured = json.loads(project.take.evaluation.read_text())["frames"][3]["cameras"]["cam4"]["psnr_decoded"]
    assert measured == pytest.approx(expected, abs=0.01)


def test_marks_come_into_the_report_without_measuring_again(project: Path) -> None:
    before, times = project.bytes_of("train", "stream", "initialize", "calibrate"), project.written("train")
    evaluation = project.take.evaluation.read_bytes()
    rows = {row["index"]: row for row in json.loads(evaluation)["frames"]}
    images = project.take.report.read_text().count("data:image/jpeg;base64,")
    project.take.marks.write_text('{"marks": [{"frame": 3, "note": "<hand> is blurred"}, {"frame": 1, "note": ""}]}')
    events = project.run()
    assert (events[0].stages, events[0].done, ran(events)) == ((), STAGE_NAMES, [])
    text = project.take.report.read_text()
    table = text.split("<h2>Marks</h2>")[1].split("</table>")[0]
    assert "&lt;hand&gt; is blurred" in table
    assert table.index("(no note)") < table.index("blurred"), "in the order of the frames"
    row = rows[3]
    figures = (f"{row['psnr_trained']:.2f} dB", f"{row['psnr_decoded']:.2f} dB", f"{row['bytes'] / 1000:.1f}")
    assert "".join(f"<td>{one}</td>" for one in figures) in table
    assert text.count('id="mark 3"') == 4, "a tick in each plot"
    assert text.count("data:image/jpeg;base64,") == images
    assert project.take.evaluation.read_bytes() == evaluation
    assert project.bytes_of("train", "stream", "initialize", "calibrate") == before
    assert project.written("train") == times
    assert set(project.states().values()) == {"done"}
    project.take.marks.write_text("[1")
    project.run()
    assert "marks.json" in project.take.report.read_text()
    assert project.states()["evaluate"] == "done"


def test_a_bake_is_kept_within_the_run(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    holders = []

    def keep(take: Take, name: str) -> Any:
        holders.append(take.running())
        return keep_bake(take, name)

    monkeypatch.setattr("v3studio.pipelines.runs.runner.keep_bake", keep)
    events = project.run(stages=("bake",), command="v3studio bake", keep="fine")
    assert [holder["command"] for holder in holders] == ["v3studio bake"]
    assert (events[-2].stage, events[-1].outcome) == ("bake", "done")
    assert [(kept.name, kept.is_stream) for kept in kept_bakes(project.take)] == [("fine", True)]
    with refuses("bakes.name_taken"):
        project.run(stages=("bake",), keep="fine")
    assert project.events[-1].outcome == "failed"


def test_a_lost_capture_leaves_finished_stages_done(project: Path) -> None:
    shutil.rmtree(project.folder / "capture")
    states = project.states()
    assert states["train"] == "done"
    assert "not checked against the footage" in project.found["train"].reason
    with refuses("footage.folder_missing"):
        project.run()
    assert project.events[-1].result["stages"] == {}, "nothing was verified"
    project.take.trained_frame(0, 0).unlink()
    assert project.states()["train"] == "stale"
    assert "frame_000000" in project.found["train"].reason
    project.take.rig.unlink()
    assert project.states()["calibrate"] == "stale"
    assert "calibrate/rig.json" in project.found["calibrate"].reason


def test_a_changed_image_is_noticed(project: Path) -> None:
    path = project.folder / "capture/images/cam1/002.png"
    image = np.array(Image.open(path))
    image[20:25, 30:35, :3] = 255
    Image.fromarray(image).save(path)
    states = project.states()
    assert states["calibrate"] == "done"  # it came from a file that did not change
    assert states["initialize"] == "stale"
    assert project.found["initialize"].reason == "the footage changed"


@pytest.mark.parametrize("place", [(1, 3), (0, 2)])  # group and frame: before and after the keyframe
def test_a_deleted_frame_alone_is_trained_again_and_comes_out_the_same(project: Path, place: str) -> None:
    before = project.bytes_of("train", "stream")
    project.take.trained_frame(*place).unlink()
    assert project.states()["train"] == "partial"
    assert (project.found["train"].units_done, project.found["train"].units) == (4, 5)
    events = project.run()
    assert frames_in(events) == [place[1]]
    assert ran(events) == ["train"]  # the same result as before, so nothing after it is stale
    after = project.bytes_of("train", "stream")
    assert after.keys() == before.keys()
    assert [name for name, data in after.items() if data != before[name] and "json" not in name] == []


def test_a_longer_take_keeps_what_the_shorter_one_trained(project: Path) -> None:
    shutil.rmtree(project.take.root)
    Take.create(project.take.root)
    stages = ("calibrate", "initialize", "train")
    project.run("capture.frames=:3", stages=stages)
    times = project.written("train")
    assert len(times) == 3
    events = project.run(stages=stages)
    assert frames_in(events) == [4, 3]
    after = project.written("train")
    assert {name: after[name] for name in times} == times


@pytest.mark.parametrize("name", STAGE_NAMES)
def test_force_makes_all_results_of_a_stage_again_and_gives_the_same(project: Path, name: str) -> None:
    paths = stage_named(name).code.results(Inputs(project.take, settings_in(project.folder)))
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in paths}
    assert before
    events = project.run(stages=(name,), force=True)
    assert ran(events) == [name]
    for path, (data, written) in before.items():
        # a stream keeps a file of the same content; that the others are there says that nothing else is
        assert path.stat().st_mtime_ns > written or path.parent.name == "files", path
        assert name == "evaluate" or path.read_bytes() == data, path  # reports hold times
    if name == "train":
        assert frames_in(events) == [1, 2, 0, 4, 3]
    if name == "bake":
        notes = list(project.take.work("bake").glob("group_*.json"))
        assert len(notes) == 2
        assert min(note.stat().st_mtime_ns for note in notes) > max(written for _, written in before.values())


@pytest.mark.parametrize("name", STAGE_NAMES[1:])
def test_a_forced_stage_that_is_cancelled_keeps_the_earlier_results(project: Path, name: str) -> None:
    places = ("calibrate", "initialize", "train", "stream")
    before, flag = project.bytes_of(*places), Cancellation()

    def emit(event: Event) -> None:
        if isinstance(event, Progress):
            flag.cancel()

    with pytest.raises(Cancelled):
        run(project.take, settings_in(project.folder), emit, stages=(name,), force=True, cancellation=flag)
    assert project.bytes_of(*places) == before
    assert project.states() == dict.fromkeys(STAGE_NAMES, "done")


@pytest.mark.parametrize(
    ("name", "setting", "code"),
    [
        ("calibrate", "capture.rig=broken.json", "camera_file.unknown_format"),
        ("bake", "bake.quality=90 dB", "bake.target_missed"),
    ],
)
def test_a_forced_stage_that_fails_keeps_the_earlier_results(project: Path, name: str, setting: str, code: str) -> None:
    before = project.bytes_of("calibrate", "initialize", "stream")
    (project.folder / "capture/broken.json").write_text("{}")
    with refuses(code):
        project.run(setting, stages=(name,), force=True)
    assert project.bytes_of("calibrate", "initialize", "stream") == before
    assert load_config(project.take.config).bake.quality == 22
    assert project.states() == dict.fromkeys(STAGE_NAMES, "done")


def test_another_seed_trains_again_with_progress_and_previews(project: Path) -> None:
    before = project.bytes_of("train")
    overrides = ("run.seed=7", "run.preview_seconds=0.001")
    events = project.run(*overrides, stages=("initialize", "train"))
    assert frames_in(events) == [1, 2, 0, 4, 3]
    after = project.bytes_of("train")
    assert all(after[name] != before[name] for name in before if name.endswith("safetensors"))

    progress = [event for event in events if isinstance(event, Progress)]
    for stage in ("initialize", "train"):
        fractions = [event.fraction for event in progress if event.stage == stage]
        assert fractions == sorted(fractions)
        assert fractions[-1] == 1.0
    totals = [event.total_fraction for event in progress]
    assert totals == sorted(totals)
    figures = [event.figures for event in progress if event.stage == "train" and "loss" in event.figures]
    assert {"loss", "psnr", "splats", "iteration", "group", "frame"} <= set(figures[0])

    previews = [event for event in events if isinstance(event, Preview)]
    assert {event.camera for event in previews} == {"cam4"}
    assert Image.open(previews[-1].path).size == (64, 48)


def test_without_held_out_cameras_the_evaluation_says_so(project: Path) -> None:
    events = project.run("capture.held_out=[]", *FEW)
    protocol = json.loads(project.take.evaluation.read_text())["protocol"]
    assert (protocol["held_out"], len(protocol["cameras"])) == (False, 6)
    assert warnings_in(events, "evaluation.no_held_out")
    assert "these are the training cameras" in project.take.report.read_text()


MASKS = """
import numpy as np
from v3studio.studio.masks import FunctionMaskSource

def bright(image, camera, frame):
    return (image.max(axis=2) > 20).astype(np.float32)

source = FunctionMaskSource(bright, cameras=("cam0", "cam1", "cam2", "cam3"))
"""


def test_cameras_without_masks_are_called_so_by_every_stage(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "masks_of_four_cameras.py").write_text(MASKS)
    monkeypatch.syspath_prepend(str(tmp_path))
    events = project.run("capture.masks=masks_of_four_cameras:source", *FEW, force=True)
    unused = [event for event in events if isinstance(event, Log) and "'cam5'" in event.message]
    assert {event.stage for event in unused} == {"calibrate", "initialize"}
    assert all("masks" in event.message for event in unused)
    (warning,) = warnings_in(events, "evaluation.no_held_out")
    assert "cam4" in warning.message
    protocol = json.loads(project.take.evaluation.read_text())["protocol"]
    assert "cam4" in protocol["note"]
    assert protocol["cameras"] == ["cam0", "cam1", "cam2", "cam3"]


def test_an_empty_mask_in_a_later_frame_ends_training(project: Path) -> None:
    path = project.folder / "capture/images/cam2/004.png"
    image = np.array(Image.open(path))
    image[..., 3] = 0
    Image.fromarray(image).save(path)
    project.take.forget("train")
    with pytest.raises(StudioError, match=r"Camera 'cam2': the mask is empty in frame 4"):
        project.run("run.seed=3", "train.keyframe_iterations=1000000")  # hours, if it were not ended
    assert frames_in(project.events) == []
    assert project.states("run.seed=3")["train"] == "failed"
    assert project.found["train"].reason.startswith("last attempt: ")


def test_a_damaged_trained_frame_is_trained_again(project: Path) -> None:
    path = project.take.trained_frame(0, 1)
    path.write_bytes(path.read_bytes()[:100])
    assert frames_in(project.run(stages=("train",))) == [1, 2, 0]


def test_a_damaged_stream_is_noticed_and_baked_again(project: Path) -> None:
    path = sorted(project.take.stream.glob("files/*.mp4"))[0]
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    assert project.states()["bake"] == "partial"
    assert "bake" in ran(project.run())
    assert path.read_bytes() == whole


def test_cancelled_from_another_thread(project: Path) -> None:
    flag = Cancellation()
    config = load_config(project.folder / "ball.yaml", [("run.seed", 5)])
    events: list[Event] = []

    def emit(event: Event) -> None:
        events.append(event)
        if isinstance(event, Metrics) and event.stage == "train":
            flag.cancel()

    with pytest.raises(Cancelled):
        run(project.take, config, emit, cancellation=flag)
    assert events[-1].outcome == "cancelled"
    assert frames_in(events) == [1]
    assert not any(isinstance(event, StageFinished) and event.stage == "train" for event in events)
    assert frames_in(project.run("run.seed=5", stages=("train",))) == [2, 0, 4, 3]


def test_a_stage_may_be_named_alone_and_an_unknown_one_is_refused(project: Path) -> None:
    project.take.forget("evaluate")
    project.run(stages="evaluate")
    assert any(isinstance(event, StageFinished) and event.stage == "evaluate" for event in project.events)
    with refuses("stage.unknown", value="evalute"):
        project.run(stages=("bake", "evalute"))
    assert project.events[-1].outcome == "failed"


def test_warnings_stay_until_their_group_is_made_without_them() -> None:
    passed: list[Event] = []

    def warned(group: int, camera: str) -> Warned:
        fields = {"group": group, "camera": camera}
        return Warned(stage="initialize", code="hull.mask_mismatch", message=camera, fields=fields)

    def kept(notes: StageNotes, earlier: StageRecord | None) -> list[str]:
        return [warning.message for warning in notes.with_kept(earlier)]

    first = StageNotes(passed.append)
    for event in (warned(0, "a"), warned(1, "b"), warned(2, "c")):
        first(event)
    assert kept(first, None) == ["a", "b", "c"]
    earlier = StageRecord(stage="initialize", params={}, result="", warnings=tuple(first.with_kept(None)))
    again = StageNotes(passed.append)
    for event in (warned(2, "c"), Metrics(stage="initialize", group=0, values={}), Metrics(group=2, values={})):
        again(event)
    assert kept(again, earlier) == ["b", "c"], "group 0 is fine now, 1 was not made again"
    assert len(passed) == 6
    assert RecordedWarning(message="of all").group == 0
