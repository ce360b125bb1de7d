from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.rigs import camera_at
from tests.support.splats import converted_splats, write_group
from tests.support.streams import bake_numbered, set_capture
from v3studio.pipelines.takes.authored.camera_paths import film_world, keys_in_take, path_keys
from v3studio.pipelines.takes.authored.edits import change_edits
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, write_frame
from v3studio.pipelines.takes.results.videos import decoded_video, open_reader, trained_video
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits import EditList, Trim, World
from v3studio.studio.formats.camera_path import Key, write_path_keys
from v3studio.studio.stream import CapturePlace

POINTS = np.random.default_rng(1).normal(0, 0.3, (50, 3))
WORLD = World(up=(0, 1, 0), origin=(0, 0.5, 0), scale=10)  # y up in the capture


@pytest.fixture(params=["decoded", "trained"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, str]:
    """A take and which of its frames are read: 2 to 7 of 9, in a world that is turned and ten times as large."""
    take = Take.create(tmp_path / "take")
    splats = converted_splats(0)
    for frame in range(9):
        write_frame(take.finished_frame(0, frame), splats, FrameMetadata())
    write_group(take, 0, range(9))
    change_edits(take.edits, EditList(trim=Trim(first=2, last=7), world=WORLD), "trim")
    bake_numbered(take.stream, (6,), 25)
    set_capture(take.stream, CapturePlace(2, WORLD.similarity))
    return str(take.root), request.param


def test_a_camera_of_nuke(place: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "a.nk").write_text("Camera2 {\n inputs 0\n translate {{curve x0 0 1 2 3 4} 2 {curve x0 30}}\n}\n")
    keys = keys_in_take(*place, tmp_path / "a.nk")
    assert [key.frame for key in keys] == [2, 3, 4]
    source, of = place
    if of == "trained":
        video = trained_video(source)
    else:
        with open_reader(source) as reader:
            video = decoded_video(reader)
    film = film_world(video)
    placed = WORLD.similarity.points(POINTS)  # where the splats are
    for key in keys:
        x, y, z = (film.points(placed) - [key.frame, 2, 30]).T  # as Nuke's camera sees them: along -z, with y up
        focal = 50 / 24.576 * 1280
        expected = np.column_stack([640 + focal * x / -z, 360 - focal * y / -z])
        np.testing.assert_allclose(key.camera.project(POINTS)[0], expected, atol=1e-6)


def test_a_path_of_the_studio(place: tuple[str, str], tmp_path: Path) -> None:
    cameras = [camera_at("a", (3, 0, 9), size=(1280, 720)), camera_at("b", (0, 5, 20), size=(1280, 720))]
    write_path_keys([Key(1.0, cameras[0], 0.0), Key(2.0, cameras[1], 5.0)], tmp_path / "path.json")
    keys = keys_in_take(*place, tmp_path / "path.json")
    assert [(key.time, key.frame) for key in keys] == [(1, 2), (2, 7)]
    for key, camera in zip(keys, cameras, strict=True):
        seen = camera.project(WORLD.similarity.points(POINTS))[0]
        np.testing.assert_allclose(key.camera.project(POINTS)[0], seen, atol=1e-6)
    with refuses("camera_path.which_camera", value="a"):
        keys_in_take(*place, tmp_path / "path.json", "a")


def test_a_camera_that_stands_still_sees_the_whole_video(place: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "a.nk").write_text("Camera3 {\n inputs 0\n translate {0 0 30}\n}\n")
    first, last = keys_in_take(*place, tmp_path / "a.nk")
    assert (first.frame, last.frame) == (2, 7)
    np.testing.assert_array_equal(first.camera.world_to_camera, last.camera.world_to_camera)


def test_numbers_of_the_film_tool(place: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "a.nk").write_text("Camera2 {\n inputs 0\n translate {{curve x1001 0 1 2 3 4} 2 30}\n}\n")
    with refuses("camera_path.other_frames", expected=[2, 7]):
        keys_in_take(*place, tmp_path / "a.nk")
    video = trained_video(place[0])
    keys = path_keys(video, tmp_path / "a.nk", numbers=range(1003, 1009))
    assert [key.frame for key in keys] == [-2, -1, 0, 1, 2]
