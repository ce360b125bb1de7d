from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.looping import heard, wait_in_loop
from tests.support.rigs import intrinsics, ring
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.capture.view import CaptureView
from v3studio.gui.pages.choices import ViewMode
from v3studio.pipelines.config import load_config
from v3studio.pipelines.runs.runner import run
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import write_rig

SIZE = (800, 600)


@pytest.fixture
def take(tmp_path: Path) -> Take:
    """Ten cameras around a ball, two frames; in the second, cam3 has lost half of it. The cameras are known."""
    rig = ring(10, heights=[0.5], K=intrinsics(100.0, (64, 48)), size=(64, 48))
    write_rig(rig, tmp_path / "rig.json")
    random = np.random.default_rng(0).normal(size=(2000, 3))
    ball = rig.focus + 0.4 * random / np.linalg.norm(random, axis=1, keepdims=True)
    for number, camera in enumerate(rig):
        (tmp_path / "images" / camera.name).mkdir(parents=True)
        pixels, _ = camera.project(ball)
        for frame in range(2):
            image = np.zeros((48, 64, 4), np.uint8)
            cv2.fillPoly(image, [cv2.convexHull(pixels.round().astype(np.int32))], (80, 120, 200, 255))
            if (number, frame) == (3, 1):
                image[:, : round(pixels[:, 0].mean())] = 0
            cv2.imwrite(str(tmp_path / "images" / camera.name / f"{frame:03d}.png"), image)
    settings = tmp_path / "capture.yaml"
    settings.write_text("capture: {root: ., rig: rig.json, masks: alpha}\ninitialize: {resolution: 32}\n")
    take = Take(tmp_path / "take")
    run(take, load_config(settings), stages="calibrate")
    return take


def test_masks_are_judged_before_training_and_the_worst_comes_first(workspace: Workspace, take: Take) -> None:
    workspace.open(take)
    wait_in_loop("the take", lambda: workspace.checked)
    assert workspace.row("capture").doubts, "nobody has looked at the masks"
    view, names = CaptureView(workspace), [f"cam{number}" for number in range(10)]

    def drawn(frame: int) -> list[str]:
        """The cameras in the order of their tiles, once the masks are judged."""
        view.frame = frame
        view.draw(SIZE, view.state())
        wait_in_loop("a verdict", lambda: frame in view.verdicts)
        view.draw(SIZE, view.state())
        return [name for name, _ in view.places]

    assert sorted(drawn(0)) == sorted(names)
    assert not any(verdict.wrong for verdict in view.verdicts[0])
    worst = drawn(1)[0]
    assert [verdict.camera for verdict in view.verdicts[1] if verdict.wrong] == [worst]
    assert view.verdicts[1][0].lacks > 0.3
    view.check()
    wait_in_loop("the check", lambda: view.footage_check.problems)
    (problem,) = view.footage_check.problems
    assert (problem.camera, problem.frame) == (worst, 1)
    wanted = heard(view.wanted)
    view.draw(SIZE, view.state())
    for row in range(0, SIZE[1], 4):  # where the line is
        view.click(100, row)
    assert set(wanted) == {(worst, 1)}
    workspace.change_settings({"capture.scale": 0.5})
    view.state()
    assert not view.footage_check.problems, "they were about other settings"
    assert workspace.row("capture").doubts


def test_the_card_is_shown_once_it_is_measured(workspace: Workspace, take: Take) -> None:
    workspace.open(take)
    wait_in_loop("the take", lambda: workspace.checked)
    workspace.change_settings({"capture.frames": ":1"})  # without the mask that is damaged
    view = CaptureView(workspace)
    view.mode = ViewMode.CARD
    before = view.draw(SIZE, view.state())
    view.check()
    wait_in_loop("the card", lambda: view.footage_check.card is not None)
    assert (view.draw(SIZE, view.state()) != before).mean() > 0.1
    assert view.places == []
