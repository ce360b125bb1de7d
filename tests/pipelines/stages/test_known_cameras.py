"""Known cameras, focal lengths and distances: from settings to arguments."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipelines.config import Config
from pipelines.stages import calibrate
from pipelines.stages.inputs import Inputs
from pipelines.stages.known_cameras import focal_lengths, known_cameras, known_distance
from pipelines.stages.reporter import StageReporter
from pipelines.takes.take import Take
from studio.calibration.settings import CalibrateSettings
from studio.camera_files import read_rig, write_rig
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from tests.support.errors import refuses


def context(tmp_path: Path, filmed: int = 1, suffix: str = "png", **settings) -> Inputs:
    for name in ("a", "b"):
        folder = tmp_path / "capture" / "images" / name
        folder.mkdir(parents=True, exist_ok=True)
        for frame in range(filmed):
            picture = Image.new("RGB", (80, 60), (frame, 90, 90))
            exif = Image.Exif()
            exif[0xA405] = 50  # focal length on 35 mm film
            picture.save(folder / f"{frame}.{suffix}", **({"exif": exif} if suffix == "jpg" else {}))
    capture = {"root": str(tmp_path / "capture"), "rig": None, "masks": "none"}
    config = Config.model_validate({"capture": capture, "calibrate": settings})
    return Inputs(Take.create(tmp_path / "take"), config)


def rig(names: tuple[str, ...], width: int = 160) -> Rig:
    K = np.array([[200.0, 0, width / 2], [0, 200, width * 3 / 8], [0, 0, 1]])
    return Rig(tuple(Camera(name, width, width * 3 // 4, K, np.eye(4)) for name in names))


def known_in(made: Inputs) -> Rig | None:
    return known_cameras(made.config.calibrate, made.footage.raw)


def test_an_older_solution_is_brought_to_the_footages_size(tmp_path: Path) -> None:
    made = context(tmp_path, known_cameras="old.json")
    write_rig(rig(("a.png", "b.png")), tmp_path / "capture" / "old.json")
    found = known_in(made)
    assert found.names == ("a", "b")
    assert (found["a"].width, found["a"].fx, found["a"].cx) == (80, 100, 40)
    write_rig(rig(("a",)), tmp_path / "capture" / "old.json")
    with refuses("calibration.camera_missing", value="b", known=("a",)):
        known_in(made)
    (tmp_path / "capture" / "old.json").unlink()
    with refuses("settings.file_not_found", file=tmp_path / "capture" / "old.json", setting="calibrate.known_cameras"):
        known_in(made)
    with refuses("settings.missing", setting="calibrate.known_cameras"):
        known_in(context(tmp_path, known="initial_poses"))
    assert known_in(context(tmp_path)) is None


def test_a_camera_file_of_another_shape_is_told_by_calibrate(tmp_path: Path) -> None:
    """A rig of the same aspect ratio is scaled by the footage and written unchanged; another one needs a size rule."""
    made = context(tmp_path)
    file = tmp_path / "capture" / "given.json"

    def calibrated(width: int, **capture) -> Rig:
        K = np.array([[100.0, 0, width / 2], [0, 100, 30], [0, 0, 1]])
        write_rig(Rig(tuple(Camera(name, width, 60, K, np.eye(4)) for name in ("a", "b"))), file)
        section = made.config.capture.model_copy(update={"rig": "given.json", **capture})
        fresh = Inputs(made.take, made.config.model_copy(update={"capture": section}))
        calibrate.run(fresh, StageReporter("calibrate"), None)
        return read_rig(made.take.rig)

    with pytest.raises(StudioError, match=r"Camera 'a': the aspect ratio of the footage, 80x60.*capture\.size_rule"):
        calibrated(88)
    assert calibrated(88, size_rule="crop")["a"].width == 88
    assert calibrated(80)["b"].width == 80


def test_a_known_distance_is_that_of_cameras_of_the_footage() -> None:
    assert known_distance(CalibrateSettings(), ("a", "b")) is None
    section = CalibrateSettings(known_distance=("a", "b", 2.5))
    assert known_distance(section, ("a", "b", "c")) == ("a", "b", 2.5)
    with refuses("settings.unknown_camera", value="b", found=["a", "c"], setting="calibrate.known_distance"):
        known_distance(section, ("a", "c"))


def test_looking_at_the_room_needs_masks(tmp_path: Path) -> None:
    made = context(tmp_path, look_at="room")
    with refuses("settings.conflict", value="room", setting="calibrate.look_at", other="capture.masks"):
        calibrate.run(made, StageReporter("calibrate"), None)


def test_focal_lengths_from_exif(tmp_path: Path) -> None:
    made = context(tmp_path, suffix="jpg")
    found = focal_lengths(made.footage.raw, 0)
    assert set(found) == {"a", "b"}
    assert found["a"] == pytest.approx(50 / 35 * 80, rel=0.05)
    assert focal_lengths(context(tmp_path / "other").footage.raw, 0) == {}


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, [[0], [2, 6, 10], [1, 3, 5, 7, 9, 11], list(range(12))]),
        ({"frame_count": 1}, [[0]]),
        ({"frame_count": 3}, [[2, 6, 10]]),
        ({"frame_count": 50}, [list(range(12))]),
        ({"frame": 7}, [[7]]),
    ],
)
def test_which_frames(settings: dict, expected: list[list[int]]) -> None:
    assert calibrate.frames_to_try(CalibrateSettings(**settings), range(12)) == expected


def test_frames_that_contradict_each_other() -> None:
    with refuses("settings.conflict", setting="calibrate.frame", other="calibrate.frame_count"):
        calibrate.frames_to_try(CalibrateSettings(frame=1, frame_count=2), range(3))
