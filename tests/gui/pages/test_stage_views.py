import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.gui.conftest import RunningWindow
from tests.support.errors import refuses
from tests.support.looping import heard, wait_in_loop
from tests.support.object_store import ObjectStore
from tests.support.players import newest
from tests.support.waiting import wait_until
from v3studio.gui.drawing.compare import boxes
from v3studio.gui.drawing.palette import GROUND
from v3studio.gui.models.evaluation import Evaluation
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.playback.sources import load
from v3studio.gui.models.preferences import RECENT, Preferences
from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.inspector import review_blocks
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.bake.qp_trial import TRIED_QPS
from v3studio.gui.pages.calibrate.points_view import PointsView
from v3studio.gui.pages.stage_view import StageView
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.pages.train import NOT_RUN
from v3studio.pipelines.config import dump_config, load_config
from v3studio.pipelines.new_take import NewTake
from v3studio.pipelines.takes.results.camera_uses import camera_uses
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import write_text
from v3studio.studio.edits import EditList
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import StreamReader
from v3studio.studio.stream.settings import LEVELS

SIZE = (720, 500)

ANOTHER_STAGE = """
import sys, types
for name in [name for name in sys.modules if name.startswith(("v3studio.gui", "v3studio.pipelines"))]:
    del sys.modules[name]
from v3studio.pipelines import stages
another = stages.Stage("another", "Another", "do something", version=1, weight=1, dependencies=("train",))
stages.STAGES = (*stages.STAGES, another)
nothing = types.SimpleNamespace(params=lambda inputs: {}, results=lambda inputs: [], units=lambda inputs: None)
sys.modules["v3studio.pipelines.stages.another"] = nothing
from v3studio.gui.app import main
sys.exit(main())
"""


def opened(views: StageViews, take: Path) -> None:
    views.player.adopt(*load(take))
    views.workspace.open(Take.open(take))


def shown(views: StageViews, accept: Callable[[np.ndarray], bool] = lambda picture: True) -> np.ndarray:
    """The picture, once it shows what was requested."""
    return newest(lambda: views.poll(SIZE, SIZE, 16.0), lambda: views.settled, accept)


def test_every_stage_of_a_finished_take_has_its_picture(views: StageViews, finished: Path) -> None:
    opened(views, finished / "take")
    for stage in views.stage_views:
        views.select(stage)
        for mode in views.stage_views[stage].modes:
            views.choose(mode)
            picture = shown(views, lambda picture: (picture != GROUND).any())
            views.stage_view.draw(SIZE, views.stage_view.state())  # raises if the picture above was only a message
            assert picture.shape == (SIZE[1], SIZE[0], 3), (stage, mode)
    views.select("initialize")
    views.choose("mesh")
    before = shown(views)
    gray = (before == before[..., :1]).all(axis=2).sum()
    assert (before != GROUND).any(axis=2).sum() > 0.05 * SIZE[0] * SIZE[1], gray
    views.on_screen.drag(60, 20, True, SIZE[1])
    assert (shown(views, lambda picture: bool((picture != before).any())) != before).any()


def test_a_stage_needs_no_code_in_the_window(open_window: Callable[..., RunningWindow], take_copy: Path) -> None:
    window = open_window(str(take_copy), program=("-c", ANOTHER_STAGE))
    window.wait_for("its state", lambda s: s["stages"].get("another", ["", ""])[1] == "not run")
    its_page = ("its page", lambda s: s["stage"] == "another" and s["settled"])
    window.click("stages", 0.3, 1 - 0.5 / (len(TITLES) + 1), until=its_page)
    window.key("F1", until=("no help", lambda s: "There is no help on Another" in s["notice"]))


def test_the_edits_show_all_trained_frames(views: StageViews, take_copy: Path) -> None:
    opened(views, take_copy)
    player, trained = views.player, views.player.opened.sources["trained"]
    player.choose("decoded")
    player.opened.sources["decoded"].frame_count = 2  # as of a bake of frames 0 and 1
    views.fit_transport()
    assert player.transport.frame_count == 2
    views.choose("edit")
    assert views.fit_transport()
    assert (player.transport.frame_count, player.transport.group_starts) == (5, trained.group_starts)
    player.transport.seek(3)
    views.editor.frame = 3
    views.editor.press("out")
    assert not views.fit_transport()

    def note() -> str:
        views.poll(SIZE, SIZE, 16.0)
        return {block.title: block.note for block in review_blocks(player, Evaluation(), Marks(None))}["Quality"]

    assert note() == "Not evaluated yet."
    player.transport.seek(4)
    assert note() == "Trimmed off."
    views.editor.press("out")
    assert views.editor.edits == EditList()
    assert note() == "Not evaluated yet."
    player.look_through("cam2")  # from where to look first
    before = player.orbit
    views.edit_view.drag(9, 0, False, SIZE[1])
    assert player.camera == ""
    assert player.orbit.key != before.key
    views.leave_edits()
    assert views.fit_transport()
    assert player.transport.frame_count == 2
    views.choose("edit")
    views.forget()  # another take is opened
    assert not views.edits_take


def test_capture_shows_the_image_of_every_camera(views: StageViews, finished: Path) -> None:
    opened(views, finished / "take")
    views.select("capture")
    views.choose("masks")  # pressed at first
    picture = shown(views)
    small = round(0.85 * 16)
    (box, *_) = boxes(SIZE, 6, 64 / 48, small + 8)
    scale = min(box.width / 64, (box.height - small - 8) / 48)
    places = set()
    for number in range(6):
        file = finished / "capture" / "images" / f"cam{number}" / "000.png"
        filmed = cv2.imread(str(file))[..., ::-1]
        large = cv2.resize(filmed, (int(64 * scale), int(48 * scale)), interpolation=cv2.INTER_LINEAR)
        inner = np.ascontiguousarray(large[2:-2, 2:-2])  # held-out cameras have a border
        errors = cv2.matchTemplate(picture, inner, cv2.TM_SQDIFF)
        least, _, place, _ = cv2.minMaxLoc(errors)
        assert least / large.size < 4, f"cam{number}"
        places.add(place)
    assert len(places) == 6


def test_frames_have_the_numbers_of_the_footage_that_they_were_trained_on(views: StageViews, take_copy: Path) -> None:
    opened(views, take_copy)
    take = Take.open(take_copy)
    for group in range(2):
        path = take.train_group(group) / "group.json"
        values = json.loads(path.read_text())
        path.write_text(json.dumps(values | {"frames": [60 + frame for frame in values["frames"]]}))
    opened(views, take_copy)
    wait_in_loop("assessed", lambda: views.workspace.assessment.numbers)
    views.select("review")
    shown(views)
    player = views.player
    player.transport.seek(3)
    shown(views)
    rows = {block.title: dict(block.rows) for block in review_blocks(player, Evaluation(), Marks(None))}["Frame"]
    assert rows["frame"] == "63 (60 to 64)", "trained on other frames than the settings name now"
    player.transport.select_span(1, 2)
    assert "Frames 61 to 62" in [block.title for block in review_blocks(player, Evaluation(), Marks(None))]


def test_stages_that_have_not_run_say_what_to_do(views: StageViews, footage_project: Path, tmp_path: Path) -> None:
    new = NewTake(str(footage_project / "capture"), "", str(tmp_path / "fresh"))
    opened(views, new.create())
    for stage, code in (
        ("calibrate", "take.no_cameras"),
        ("initialize", "take.not_initialized"),
        ("bake", "take.not_baked"),
    ):
        views.select(stage)
        stage_view = views.stage_views[stage]
        with refuses(code):
            stage_view.draw(SIZE, stage_view.state())
        shown(views)  # the sentence, not an exception
    train, plain = views.stage_views["train"], StageView(views.workspace, "train")
    wait_in_loop("the status", lambda: views.workspace.assessment.stages)
    assert plain.state() == ("not run yet", plain.em)
    assert train.nothing == NOT_RUN
    views.select("review")
    assert "Nothing trained" in views.message
    refused = heard(views.player.refused)
    assert not views.player.choose("decoded")
    assert "Bake" in str(refused)


def test_a_new_take_from_footage(footage_project: Path, tmp_path: Path) -> None:
    new = NewTake()
    with refuses("take.no_footage"):
        new.config()
    assert "Choose the footage folder" in new.found().words
    new.footage = str(tmp_path / "nowhere")
    with refuses("footage.no_folder", file=tmp_path / "nowhere"):
        new.config()
    assert "no such folder" in new.found().words
    new.footage = str(footage_project / "capture")
    assert "6 cameras" in new.found().words
    assert "No camera is held out" in new.found().words
    assert Path(new.proposed_take()).parent == footage_project
    new.settings, new.take = str(footage_project / "ball.yaml"), str(tmp_path / "take")
    words = new.found().words
    assert "No camera is held out" not in words
    assert "Held out: " in words
    root = new.create()
    assert load_config(root / "config.yaml").train.group_size == 3
    assert load_config(root / "config.yaml").capture.root == footage_project / "capture"
    with refuses("take.exists", file=tmp_path / "take"):
        new.create()
    new.take = str(footage_project)
    with pytest.raises(StudioError, match="not empty"):  # from the take
        new.create()


def test_a_new_take_from_footage_in_object_storage(
    object_store: ObjectStore,
    workspace: Workspace,
    footage_project: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    object_store.upload(footage_project / "capture", "day1")
    new = NewTake("s3://studio/day1", str(footage_project / "ball.yaml"))
    assert "in s3://studio/day1: 6 cameras" in new.found().words
    assert "Camera file: cameras.json." in new.found().words
    assert new.proposed_take() == str(tmp_path / "day1-take")
    new.take = "s3://studio/takes/first"
    with refuses("take.no_folder"):
        new.create()
    new.take = ""
    take = Take.open(new.create())
    config = load_config(take.config, [("calibrate.tie_points", "points.yaml")])
    assert tuple(camera_uses(config.capture)) == tuple(f"cam{number}" for number in range(6))
    write_text(take.config, dump_config(config))
    workspace.open(take)
    points = PointsView(workspace)
    points.state()
    with pytest.raises(StudioError, match=r"s3://studio/day1/points\.yaml: the window cannot save"):
        points.draw(SIZE, points.state())
    assert not list(tmp_path.glob("s3*")), "no folder is named like the address"


def test_preferences_survive_and_damage_is_no_obstacle(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "window.json"
    preferences = Preferences.read(path)
    for number in range(RECENT + 3):
        preferences.opened(f"/takes/{number}")
    preferences.opened("/takes/5")
    preferences.background = "white"
    assert preferences.save(path)
    again = Preferences.read(path)
    assert again == preferences
    assert again.recent[0] == "/takes/5"
    assert len(again.recent) == len(set(again.recent)) == RECENT
    path.write_text('{"background": "pink", "recent": 5, "picture_size": ["x"]}')
    assert Preferences.read(path) == Preferences()
    path.write_text("{")
    assert Preferences.read(path) == Preferences()


def test_qps_are_tried_on_a_whole_group_and_chosen_by_a_click(views: StageViews, take_copy: Path) -> None:
    opened(views, take_copy)
    views.select("bake")
    views.choose("try other QPs")
    bake = views.stage_views["bake"]
    table = len(TRIED_QPS) + 1  # rows, with the titles
    wait_until("all QPs", lambda: shown(views) is not None and len(bake.table_text.splitlines()) == table)
    with StreamReader.open(take_copy / "stream") as reader:
        longest = max(reader.groups, key=lambda group: group.frame_count)
    assert bake.trial.results[22].bytes_per_frame == longest.bytes / longest.frame_count, "what the bake gave"
    trials = [bake.trial.results[qp] for qp in sorted(bake.trial.results)]
    sizes = [trial.bytes_per_frame for trial in trials]
    assert sizes == sorted(sizes, reverse=True)
    assert trials[0].psnr > trials[-1].psnr + 3
    titles, *copied = (line.split("\t") for line in bake.table_text.splitlines())
    assert titles == ["QP", "KB per frame", "Mbit/s", "PSNR, dB"]
    assert [int(line[0]) for line in copied] == sorted(bake.trial.results)
    assert [float(line[3]) for line in copied] == pytest.approx([trial.psnr for trial in trials], abs=0.0051)
    x, y = bake.points[30]
    views.click(x + 2, y - 2)
    assert load_config(take_copy / "config.yaml").bake.quality == 30
    wait_in_loop("the new setting", lambda: views.workspace.config.bake.quality == 30)
    views.click(1.0, 1.0)
    assert load_config(take_copy / "config.yaml").bake.quality == 30, "not a point"
    assert set(bake.points) == {*bake.trial.results, *LEVELS}
    down = [bake.points[name][1] for name in LEVELS]
    assert down == sorted(down, reverse=True), "the best on top"
    views.click(*bake.points["good"])
    assert load_config(take_copy / "config.yaml").bake.quality == "good"
