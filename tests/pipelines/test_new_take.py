import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.errors import refuses
from v3studio.pipelines.config import load_config, presets
from v3studio.pipelines.config.presets import preset_of
from v3studio.pipelines.new_take import CALIBRATE, NewTake, uses_words
from v3studio.studio.footage import open_footage


def test_the_camera_file_may_be_beside_the_footage(tmp_path: Path) -> None:
    """HiFi4G: transforms.json one level above the folder of the images."""
    pose = np.diag([1.0, -1, -1, 1]).tolist()
    common = {"transform_matrix": pose, "w": 32, "h": 24, "fl_x": 30, "fl_y": 30, "cx": 16, "cy": 12}
    frames = [{"file_path": f"images/{name}.png", **common} for name in ("0", "1")]
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames}))
    (tmp_path / "example").mkdir()
    for name in ("0", "1"):
        Image.new("RGB", (32, 24)).save(tmp_path / "example" / f"{name}.png")
    assert "Camera file: ../transforms.json." in NewTake(str(tmp_path / "example")).found().words
    assert "Camera file: transforms.json." in NewTake(str(tmp_path)).found().words


def images(folder: Path, mask: int | None = None, cameras: str = "ab") -> Path:
    """Three black images of each camera, or masks with this value in the middle."""
    image = Image.new("RGB" if mask is None else "L", (32, 24))
    image.paste(mask or 0, (8, 8, 24, 16))
    for camera in cameras:
        (folder / camera).mkdir(parents=True)
        for frame in range(3):
            image.save(folder / camera / f"{frame:04d}.png")
    return folder


@pytest.mark.parametrize("typed", ["fast", "0", "-25", "nan", "inf", "10000", "25 fps"])
def test_a_frame_rate_that_makes_no_sense_is_refused_in_a_sentence(typed: str, tmp_path: Path) -> None:
    new = NewTake(str(images(tmp_path / "shots")), take=str(tmp_path / "take"), fps=typed)
    words = new.found().words
    assert all(part in words for part in (typed, "not a frame rate", "such as 25"))
    with refuses("take.bad_rate"):
        new.create()
    assert not (tmp_path / "take").exists()
    assert new.proposed_take().endswith("shots-take"), "other fields are not touched"


def test_frames_and_cameras_are_chosen(project: Path) -> None:
    new = NewTake(str(project / "capture"), take=str(project / "take"))
    counts: list[tuple[int, int]] = []
    footage = new.found(lambda done, total, **_: counts.append((done, total)))
    inspection = footage.inspection
    assert inspection.frames == tuple(range(5))
    assert list(inspection.thumbnails) == list(footage.uses) == [f"cam{number}" for number in range(6)]
    assert list(inspection.strip) == [0, 1, 2, 3, 4]
    assert counts == [(done, 11) for done in range(11)], "6 cameras and 5 frames"
    assert inspection.suggested == ("cam5",)
    new.uses = {**footage.uses, **dict.fromkeys(inspection.suggested, "held out"), "cam0": "not used"}
    assert uses_words(new.uses) == "4 cameras for training, 1 held out, 1 not used"
    new.frames = "1 to 3"
    capture = load_config(new.create() / "config.yaml").capture
    assert open_footage(capture, None).frames == (1, 2, 3)
    assert (capture.held_out, capture.cameras) == (("cam5",), tuple(f"cam{number}" for number in range(1, 6)))


@pytest.mark.parametrize("typed", ["3 to 1", "all", "-1", "1:3", "1 to"])
def test_frames_that_make_no_sense_are_refused(typed: str, project: Path) -> None:
    new = NewTake(str(project / "capture"), frames=typed)
    with refuses("take.bad_frames", value=typed):
        new.create()


def test_one_of_several_layouts_and_camera_files_is_chosen(project: Path) -> None:
    (project / "capture" / "images").rename(project / "capture" / "day")
    shutil.copytree(project / "capture" / "day", project / "capture" / "night")
    new = NewTake(str(project / "capture"), take=str(project / "take"))
    footage = new.found()
    assert len(footage.images) == 2, footage.words
    new.images = next(pattern for pattern in footage.images if pattern.startswith("day"))
    shutil.copy(project / "capture" / "cameras.json", project / "capture" / "rig.json")
    rigs = new.found().inspection.rigs
    assert sorted(rigs) == ["cameras.json", "rig.json"]
    new.rig = "rig.json"
    assert not new.found().inspection.rigs
    assert load_config(new.create() / "config.yaml").capture.rig == "rig.json"
    new.rig = CALIBRATE
    assert new.config().capture.rig is None


def test_cameras_without_masks_are_not_used(tmp_path: Path) -> None:
    images(tmp_path / "shots" / "ims", cameras="abc")
    images(tmp_path / "shots" / "seg", 200, "ac")
    for name, cameras in (("train", "ac"), ("test", "b")):
        count = len(cameras)
        poses = [np.eye(4) + np.eye(4, k=3) * number for number in range(count)]
        meta = {"k": [[[[30, 0, 16], [0, 30, 12], [0, 0, 1]]] * count], "w2c": [[pose.tolist() for pose in poses]]}
        meta |= {"fn": [[f"{camera}/0000.png" for camera in cameras]]}
        (tmp_path / "shots" / f"{name}_meta.json").write_text(json.dumps({"w": 32, "h": 24, **meta}))
    footage = NewTake(str(tmp_path / "shots")).found()
    lines = footage.inspection.lines
    (advice,) = (line for line in lines if "capture.held_out: " in line)
    assert "capture.held_out: [c]" in advice, "b, which is for evaluation, has no masks"
    assert all("masks" in line for line in lines if "'b'" in line)
    assert footage.inspection.unmasked == ("b",)
    assert footage.uses == {"a": "training", "b": "not used", "c": "training"}
    shutil.copytree(tmp_path / "shots" / "seg" / "a", tmp_path / "shots" / "seg" / "b")
    lines = NewTake(str(tmp_path / "shots")).found().inspection.lines
    (advice,) = (line for line in lines if "capture.held_out: " in line)
    assert "capture.held_out: [b]" in advice


@pytest.mark.parametrize("gpu", [False, True])
def test_the_first_preset_fits_the_machine(gpu: bool, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presets, "has_gpu", lambda: gpu)
    new = NewTake(str(project / "capture"), take=str(project / "take"))
    name = "final" if gpu else "standard"
    assert new.unchosen()["preset"] == name
    assert preset_of(load_config(new.create() / "config.yaml")) == name
    new.settings = str(project / "ball.yaml")
    assert new.config().train == load_config(project / "ball.yaml").train  # what was chosen stays
    new.preset = "preview"
    assert preset_of(new.config()) == "preview"


def test_one_of_several_masks_plates_and_sounds_is_chosen(tmp_path: Path) -> None:
    root = tmp_path / "shots"
    images(root / "images")
    images(root / "masks", 255)
    images(root / "masks_fine", 128)
    for kind in ("clean_plates", "backgrounds"):
        (root / kind).mkdir()
        for camera in ("a", "b"):
            Image.new("RGB", (32, 24)).save(root / kind / f"{camera}.png")
    (root / "boom.wav").write_bytes(b"")
    new = NewTake(str(root), take=str(tmp_path / "take"))
    inspection = new.found().inspection
    assert set(inspection.masks) == {"masks/{camera}/{frame}.png", "masks_fine/{camera}/{frame}.png"}
    assert set(inspection.plates) == {"clean_plates/{camera}.png", "backgrounds/{camera}.png"}
    assert inspection.sounds == ("boom.wav",)
    new.plates, new.audio = "backgrounds/{camera}.png", "boom.wav"
    capture = new.config().capture
    assert (capture.masks, capture.clean_plates, capture.audio) == (("clean_plate", "model"), new.plates, "boom.wav")
    new.masks = "masks_fine/{camera}/{frame}.png"
    capture = new.config().capture
    assert (capture.masks, capture.mask_files) == ("auto", new.masks)
