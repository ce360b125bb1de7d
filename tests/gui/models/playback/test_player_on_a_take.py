import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.players import picture_of, settle
from v3studio.gui.actions.marks import show_view, view_of
from v3studio.gui.drawing.canvas import text_width
from v3studio.gui.layout import RIGHT
from v3studio.gui.models.evaluation import Evaluation
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.sources import load, take_contents
from v3studio.gui.models.take.inspector import review_blocks
from v3studio.pipelines.reports.images import render
from v3studio.pipelines.takes.authored.marks import Mark, change_mark
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.results.evaluation import Contradiction
from v3studio.pipelines.takes.take import Take


def test_footage_is_what_the_camera_filmed_and_splats_are_drawn_from_there(player: PlayerPresenter) -> None:
    player.background = "black"
    assert player.choose("footage")
    assert player.camera == "cam4", "the held-out camera"
    shown = picture_of(player)
    footage = player.context.calibrated_footage
    mask = footage.mask("cam4", footage.frames[0])[..., None] / 255
    filmed = footage.image("cam4", footage.frames[0]).astype(float) * mask
    shrunk = shown.reshape(48, 4, 64, 4, 3).mean(axis=(1, 3))  # shown enlarged four times
    assert np.abs(shrunk - filmed).mean() < 3.0
    assert player.choose("trained")
    trained = picture_of(player)
    assert player.camera == "cam4"
    camera = footage.rig["cam4"].resized(256, 192)
    rendered = render(read_frame(player.opened.take.trained_files()[0][0]), camera, (0, 0, 0))
    assert np.abs(trained.astype(float) - rendered * 255).mean() < 1.0
    player.choose_mode("difference")
    assert player.reference == "footage"
    assert picture_of(player).max() > 0
    player.choose_mode("wipe")
    player.pull(128 if player.picture is None else player.picture.box.x + 64, 0)
    assert player.wipe == pytest.approx(0.25)
    assert picture_of(player).shape == (192, 256, 3)
    assert player.grabs(64, 0)
    assert not player.grabs(180, 0)


def test_a_half_trained_group_shows_the_frames_that_are_there(take_copy: Path) -> None:
    shutil.rmtree(take_copy / "stream")
    for frame in (0, 2):
        Take.open(take_copy).finished_frame(0, frame).unlink()
    player = PlayerPresenter()
    player.adopt(*load(take_copy))
    assert (player.transport.frame, player.transport.frame_count) == (1, 5), "the keyframe comes first"
    assert picture_of(player).any()
    player.transport.seek(2)
    settle(player)
    assert "Frame 2: not trained yet" in player.message
    player.transport.seek(4)
    assert picture_of(player).any()
    assert player.message == ""
    assert player.close()


def test_a_group_that_was_trained_again_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = Take.create(tmp_path)
    # the results of a stage after the training are what is shown
    monkeypatch.setattr(
        Take, "finished_frame", lambda self, group, index: tmp_path / f"tidy/{group}/frame_{index}.safetensors"
    )
    files = [take.finished_frame(group, 2 * group + index) for group in range(3) for index in range(2)]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    before = take_contents(take)
    assert take_contents(take) == before
    for file in files[2:4]:
        os.utime(file, (1, 1))
    assert take_contents(take) != before


def test_masks_that_contradict_the_footage_are_named(player: PlayerPresenter, finished: Path) -> None:
    evaluation = Evaluation.read(finished / "take" / "evaluation.json")
    assert evaluation.wrong_masks(2) == ("", [])
    assert evaluation.masks is not None
    wrong = Contradiction(frame=2, camera="cam3", kind="missing", share=0.25)
    evaluation = replace(evaluation, masks=evaluation.masks.model_copy(update={"contradictions": (wrong,)}))
    for frame, rows in ((2, [("cam3, missing", "25% of the performer")]), (3, [])):
        player.transport.seek(frame)
        settle(player)
        (block,) = (block for block in review_blocks(player, evaluation, Marks(None)) if block.bad)
        assert block.rows == rows
        assert "cam3" in block.note


def test_wheel_and_drag_move_within_a_cameras_image(player: PlayerPresenter) -> None:
    player.look_through("cam1")
    player.wheel(0, 0, 5)
    assert player.image_zoom.zoom == pytest.approx(0.9**-5)
    player.drag(20, 0, False, 200)
    assert player.image_zoom.u < 0.5
    assert player.camera == "cam1"
    player.reset()
    assert player.image_zoom == ImageZoom()


def test_figures_are_those_of_evaluation_json(player: PlayerPresenter, finished: Path) -> None:
    path = finished / "take" / "evaluation.json"
    written = json.loads(path.read_text())
    evaluation = Evaluation.read(path)
    row = written["frames"][3]
    player.transport.seek(3)
    settle(player)
    shown = {block.title: dict(block.rows) for block in review_blocks(player, evaluation, Marks(None))}
    quality = shown["Quality, mean of held-out cameras"]
    assert quality["masked PSNR"] == f"{row['psnr_trained']:.2f} / {row['psnr_decoded']:.2f}"
    assert quality["SSIM"] == f"{row['ssim_trained']:.4f} / {row['ssim_decoded']:.4f}"
    assert quality["size"] == f"{row['bytes'] / 1000:.1f} KB"
    assert shown["Frame"]["splats"] == f"{row['splats']:,}"
    wide = [text_width(name, 14) + text_width(value, 14) for name, value in quality.items()]
    assert max(wide) <= (RIGHT - 1.8) * 16, "no value is cut in a panel of the least width"
    assert evaluation.series("psnr_decoded", 7) == [*(frame["psnr_decoded"] for frame in written["frames"]), None, None]
    figures, whose = evaluation.figures(3, "cam4")
    assert (whose, figures["psnr_decoded"]) == ("camera cam4", row["cameras"]["cam4"]["psnr_decoded"])
    assert evaluation.figures(99) == ({}, "")


def test_marks_stay_in_the_take(tmp_path: Path) -> None:
    path = tmp_path / "marks.json"
    marks = Marks(path)
    marks.set(4, "  hand is blurred ", None)
    marks.set(1, "", None)
    marks.set(9, "flicker", None)
    marks.put(1, None, marks.marks[1])
    again = Marks(path)
    assert again.notes == {4: "hand is blurred", 9: "flicker"}
    change_mark(path, 2, Mark(frame=2, note="thin", author="Anna"), None)  # in a browser
    assert again.refresh()
    assert not again.refresh()
    assert again.notes == {2: "thin (Anna)", 4: "hand is blurred", 9: "flicker"}
    assert (again.next_after(4, 1), again.next_after(4, -1), again.next_after(9, -1)) == (9, 2, 4)
    session = Marks(None)
    session.set(2, "kept until closed", None)
    assert not session.kept


def test_a_mark_keeps_its_view_and_leads_back_to_it(player: PlayerPresenter) -> None:
    player.orbit = player.orbit.orbit(120, -40).zoom(3).pan(15, 5, 192)
    free, seen = view_of(player), player.view()
    assert free.eye == pytest.approx(seen.center.tolist())
    player.look_through("cam4")
    player.choose_mode("wipe")
    player.wipe = 0.3
    compared = view_of(player)
    assert (compared.camera, compared.wipe, compared.whole) == ("cam4", 0.3, False)
    player.choose_mode("single")
    player.reset()
    player.wipe = 0.5
    filmed = view_of(player)
    assert (filmed.camera, filmed.wipe, filmed.whole) == ("cam4", None, True)

    show_view(player, free)
    again = player.view()
    assert player.camera == ""
    assert np.allclose(again.world_to_camera, seen.world_to_camera)
    assert np.allclose(again.K, seen.K)
    for view in (compared, filmed):
        show_view(player, view)
        assert view_of(player) == view
    show_view(player, compared.model_copy(update={"camera": "gone"}))
    assert player.camera == ""
    assert player.orbit.eye == pytest.approx(np.array(compared.eye)), "from the same place"
