from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.studio.capture.detect import MASK_FOLDERS, all_beside, detect_images
from v3studio.studio.capture.patterns import find_files, interval_of


def touch(root: Path, *names: str) -> None:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).touch()


def test_a_folder_per_frame_and_wildcards(tmp_path: Path) -> None:
    touch(tmp_path, "0/images/a.jpg", "1/images/a.jpg", "1/images/b.png", "1/depth/a.png")
    places = [(match.camera, match.frame) for match in find_files(tmp_path, "{frame}/images/{camera}.*")]
    assert places == [("a", 0), ("a", 1), ("b", 1)]
    assert len(find_files(tmp_path, "**/{camera}.png")) == 2


def test_two_files_for_one_camera_are_refused(tmp_path: Path) -> None:
    touch(tmp_path, "videos/a.mp4", "videos/a.mov")
    files = {"file": tmp_path / "videos" / "a.mp4", "other": tmp_path / "videos" / "a.mov"}
    with refuses("footage.duplicate_file", **files, camera="a", frame=None):
        find_files(tmp_path, "videos/{camera}.*")
    touch(tmp_path, "i/a/1.png", "i/a/001.png")
    with refuses("footage.duplicate_file", camera="a", frame=1):
        find_files(tmp_path, "i/{camera}/{frame}.png")


def test_pattern_without_camera_or_with_unknown_parts(tmp_path: Path) -> None:
    with refuses("footage.bad_pattern", value="videos/*.mp4", placeholder="{camera}"):
        find_files(tmp_path, "videos/*.mp4")
    with refuses("footage.bad_pattern", value="{camera}/{cam}.mp4", placeholder="{cam}"):
        find_files(tmp_path, "{camera}/{cam}.mp4")


@pytest.mark.parametrize(
    ("files", "pattern"),
    [
        (["videos/a.mp4", "videos/b.mp4", "rgba/a/0.png"], "videos/{camera}.mp4"),
        (["image_white/0/0.png", "image_white/0/1.png", "image_white/transforms.json"],
         "image_white/{frame}/{camera}.png"),
        (["image/000.mp4", "image/001.mp4", "mask/000.mp4", "CamPose.inf"], "image/{camera}.mp4"),
        (["image/000.mp4", "image/0/img_0000.png", "image/0/img_0001.png", "mask/0/img_0000.png"],
         "image/{frame}/img_{camera}.png"),
        (["0/images/0.png", "0/images/1.png", "0/transforms.json", "1/images/0.png"], "{frame}/images/{camera}.png"),
        (["0/left.png", "0/right.png", "1/left.png", "1/right.png"], "{frame}/{camera}.png"),
        (["left/0.png", "left/1.png", "right/0.png", "right/1.png"], "{camera}/{frame}.png"),
        (["images/DSC_0007.jpg", "images/DSC_0008.jpg"], "images/{camera}.jpg"),
        (["0/images/a.png", "1/images/a.png"], "{frame}/images/{camera}.png"),
        (["a.mp4", "b.mp4", "bg/a.png"], "{camera}.mp4"),
        (["cam0/0001.png", "cam1/0001.png", "bg/0001.png"], "{camera}/{frame}.png"),
        (["shoot/day1/a.mp4", "shoot/day1/b.mp4"], "shoot/day1/{camera}.mp4"),
    ],
)  # fmt: skip
def test_common_layouts_are_detected(tmp_path: Path, files: list[str], pattern: str) -> None:
    touch(tmp_path, *files)
    detected, matches = detect_images(tmp_path)
    assert detected == pattern
    assert not {match.camera for match in matches} & {"bg", "masks"}


@pytest.mark.parametrize(
    ("times", "interval"),
    [([0, 40, 80, 160, 200], 40), ([160, 0, 30, 80, 110], 40), ([0, 1, 10], 5), ([0, 0, 0, 1], None), ([3], None)],
)
def test_the_usual_interval_of_times(times: list[float], interval: float | None) -> None:
    assert interval_of(times) == (None if interval is None else pytest.approx(interval))


def test_missing_and_ambiguous_footage_name_the_setting(tmp_path: Path) -> None:
    with refuses("footage.not_found", file=tmp_path, setting="capture.images"):
        detect_images(tmp_path)
    touch(tmp_path, "x/day1/a.mp4", "x/day1/b.mp4", "x/day2/a.mp4", "x/day2/b.mp4")
    with refuses("footage.ambiguous_layout", file=tmp_path, setting="capture.images") as caught:
        detect_images(tmp_path)
    for pattern in caught.value.value:
        assert len(find_files(tmp_path, pattern)) == (4 if "{chapter}" in pattern else 2)
    assert {"x/day1/{camera}.mp4", "x/{camera}/a.mp4"} <= set(caught.value.value)


def test_numbered_folders_are_frames_if_the_camera_file_says_so(tmp_path: Path) -> None:
    """HiFi4G's image_white as the capture: 0/1.png may be frame 0 of camera 1, or frame 1 of camera 0."""
    touch(tmp_path, *(f"{frame}/{camera}.png" for frame in range(2) for camera in range(3)))
    assert detect_images(tmp_path)[0] == "{camera}/{frame}.png"
    frames = ", ".join(f'{{"file_path": "images/{camera}.png"}}' for camera in range(3))
    (tmp_path / "transforms.json").write_text(f'{{"frames": [{frames}]}}')
    assert detect_images(tmp_path)[0] == "{frame}/{camera}.png"


def test_masks_of_other_layouts_are_detected(tmp_path: Path) -> None:
    touch(tmp_path, "a/masks/Cam001/Cam001_mask000003.png", "b/mask/0/img_0001.png", "c/mask/001.mp4")
    for folder, pattern, camera, frame in (
        ("a", "masks/{camera}/{camera}_mask{frame}.png", "Cam001", 3),
        ("b", "mask/{frame}/img_{camera}.png", "0001", 0),
        ("c", "mask/{camera}.mp4", "001", None),
    ):
        detected, (match,) = next(all_beside(tmp_path / folder, MASK_FOLDERS, [camera]))
        assert (detected, match.camera, match.frame) == (pattern, camera, frame)
