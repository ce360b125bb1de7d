from pathlib import Path

import numpy as np

from tests.support.errors import refuses
from v3studio.gui.models.camera_path import PathEditor
from v3studio.gui.models.history import History
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers
from v3studio.studio.formats.camera_path import read_path_keys

ORBIT = OrbitCamera(target=np.array([0.0, 0.0, 0.9]))


def with_views(count: int, file: Path | None = None) -> tuple[PathEditor, History]:
    editor, history = PathEditor(), History()
    editor.open(file, history)
    for number in range(count):
        editor.add(ORBIT.orbit(40.0 * number, 0).camera(640, 360), number)
        editor.selected = None
    return editor, history


def frames(editor: PathEditor) -> list[int]:
    return [key.frame for key in editor.keys]


def times(editor: PathEditor) -> list[float]:
    return [key.time for key in editor.keys]


def test_views_are_ordered_and_timed(tmp_path: Path) -> None:
    editor, history = with_views(3, tmp_path / "camera_path.json")
    assert (frames(editor), times(editor)) == ([0, 1, 2], [0, 2, 4])
    editor.move(2, -1)
    assert (frames(editor), times(editor), editor.selected) == ([0, 2, 1], [0, 2, 4], 1)
    editor.add(ORBIT.camera(640, 360), 7)  # after the selected one
    assert (frames(editor), times(editor)) == ([0, 2, 7, 1], [0, 2, 3, 4])
    editor.set_time(1, 0.5)
    assert times(editor) == [0, 0.5, 1.5, 2.5], "later ones move with it"
    for index, seconds in ((0, 1.0), (2, 0.5), (1, -1.0), (1, float("nan"))):
        with refuses("camera_path.times"):
            editor.set_time(index, seconds)
    editor.remove(0)
    assert (frames(editor), times(editor)) == ([2, 7, 1], [0, 1, 2])
    editor.next_easing(0)
    editor.set_frame(2, 5)
    assert [(key.frame, key.easing) for key in editor.keys] == [(2, "ease"), (7, "smooth"), (5, "smooth")]
    kept = read_path_keys(tmp_path / "camera_path.json", 1.0)
    assert [(key.frame, key.time, key.easing) for key in kept] == [(2, 0, "ease"), (7, 1, "smooth"), (5, 2, "smooth")]
    again = PathEditor()
    again.open(tmp_path / "camera_path.json", History())
    assert (frames(again), times(again)) == (frames(editor), times(editor))
    for _ in range(2):
        assert history.undo().startswith("Undone")
    assert [key.easing for key in editor.keys] == ["smooth"] * 3
    editor.load([])
    assert not (tmp_path / "camera_path.json").exists()
    history.undo()
    assert len(read_path_keys(tmp_path / "camera_path.json", 1.0)) == 3


def test_views_stay_with_their_frames_of_the_footage(tmp_path: Path) -> None:
    editor, _ = with_views(0, tmp_path / "camera_path.json")
    editor.numbers = FrameNumbers((60, 61, 62, 63, 64))
    for frame in (0, 4):
        editor.add(ORBIT.camera(640, 360), frame)
    again = PathEditor()
    again.open(tmp_path / "camera_path.json", History())
    again.numbers = FrameNumbers((62, 63, 64))  # capture.frames is 62: now
    assert (frames(again), again.frames) == ([60, 64], [None, 2])
    with refuses("camera_path.frame_missing", value=60):
        again.path(640, 360)
    again.set_frame(0, 1)
    assert (frames(again), again.frames) == ([63, 64], [1, 2])
    assert [again.path(640, 360).frame(seconds) for seconds in (0.0, 2.0)] == [1, 2]


def test_a_damaged_path_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "camera_path.json"
    file.write_text("{")
    editor, _ = with_views(0, file)
    assert "camera_path.json" in editor.error
    with refuses("camera_path.damaged"):
        editor.add(ORBIT.camera(640, 360), 0)
    assert (file.read_text(), editor.keys) == ("{", ())
