"""Bad footage: one clear sentence each."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from studio.capture import CaptureSpec, open_footage
from studio.capture.checks import check_footage
from studio.errors import Cancelled, StudioError


def test_sound_footage_has_no_problems(image_folders: Path, three_videos: Path) -> None:
    calls: list[tuple[int, int]] = []
    footage = open_footage(CaptureSpec(image_folders, images="images/{camera}/{frame}.png"))
    assert check_footage(footage, lambda done, total, **_: calls.append((done, total))) == []
    assert calls[-1] == (8, 8)
    assert len(calls) == 9


def test_checking_can_be_stopped(image_folders: Path) -> None:
    def stop(done: int, total: int, **figures: object) -> None:
        if done == 3:
            raise Cancelled

    with pytest.raises(Cancelled):
        check_footage(open_footage(CaptureSpec(image_folders)), stop)


def test_a_camera_missing_in_a_frame(image_folders: Path) -> None:
    (image_folders / "images" / "right" / "000006.png").unlink()
    with pytest.raises(StudioError, match=r"^Camera 'right' has no frame 6, which other cameras have; .*$"):
        open_footage(CaptureSpec(image_folders))
    footage = open_footage(CaptureSpec(image_folders), strict=False)
    assert footage.frames == (5, 7, 8)
    assert len(check_footage(footage)) == 1


def test_different_frame_counts(three_videos: Path, make: SimpleNamespace) -> None:
    make.video(three_videos / "videos" / "cam2.mp4", [make.numbered(index) for index in range(9)])
    with pytest.raises(StudioError, match=r"Camera 'cam2' ends after frame 8, but others go on to frame 11.*stop to 9"):
        open_footage(CaptureSpec(three_videos))
    assert open_footage(CaptureSpec(three_videos, stop=9)).frames == tuple(range(9))


def test_different_rates(three_videos: Path, make: SimpleNamespace) -> None:
    make.video(three_videos / "videos" / "cam2.mp4", [make.numbered(index) for index in range(12)], fps=30)
    with pytest.raises(StudioError, match="'cam1' runs at 25 frames a second and 'cam2' at 30"):
        open_footage(CaptureSpec(three_videos))
    assert open_footage(CaptureSpec(three_videos, fps=25)).fps == 25


def test_different_sizes_within_a_camera(image_folders: Path, make: SimpleNamespace) -> None:
    make.image(image_folders / "images" / "left" / "000007.png", make.numbered(7, 80, 64))
    problems = check_footage(open_footage(CaptureSpec(image_folders)))
    assert len(problems) == 1
    assert "000007.png is 80x64, but camera 'left' began with 96x64" in problems[0]


def test_truncated_and_unreadable_images(image_folders: Path) -> None:
    cut = image_folders / "images" / "left" / "000007.png"
    cut.write_bytes(cut.read_bytes()[:-40])
    (image_folders / "images" / "right" / "000008.png").write_text("not an image")
    footage = open_footage(CaptureSpec(image_folders))
    problems = check_footage(footage)
    assert len(problems) == 2
    assert "000007.png is damaged or truncated" in problems[0]
    assert "000008.png cannot be read" in problems[1]
    assert all("\n" not in problem for problem in problems)
    with pytest.raises(StudioError, match=r"000007\.png"):
        footage.image("left", 7)
    assert footage.image("left", 6).shape == (64, 96, 3)


def test_truncated_jpeg(tmp_path: Path, make: SimpleNamespace) -> None:
    rng = np.random.default_rng(0)
    path = make.image(tmp_path / "images" / "a.jpg", rng.integers(0, 255, (64, 96, 3), dtype=np.uint8))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    problems = check_footage(open_footage(CaptureSpec(tmp_path)))
    assert len(problems) == 1
    assert "a.jpg is damaged or truncated" in problems[0]


def test_truncated_video_names_its_file(three_videos: Path) -> None:
    path = three_videos / "videos" / "cam2.mp4"
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(StudioError, match=r"cam2\.mp4 cannot be opened: it is truncated or not a video"):
        open_footage(CaptureSpec(three_videos))


def test_empty_and_all_white_masks(image_folders: Path, make: SimpleNamespace) -> None:
    for frame in (6, 7):
        make.image(image_folders / "masks" / "left" / f"{frame:06d}.png", np.zeros((64, 96), np.uint8))
    make.image(image_folders / "masks" / "right" / "000005.png", np.full((64, 96), 255, np.uint8))
    problems = check_footage(open_footage(CaptureSpec(image_folders)))
    assert len(problems) == 2
    assert problems[0].startswith("Camera 'left': the mask is empty in frame 6-7;")
    assert problems[1].startswith("Camera 'right': the mask is all white in frame 5,")


def test_missing_mask_and_wrong_mask_shape(image_folders: Path, make: SimpleNamespace) -> None:
    mask = image_folders / "masks" / "left" / "000006.png"
    mask.unlink()
    with pytest.raises(StudioError, match="Camera 'left' has no mask for frame 6"):
        open_footage(CaptureSpec(image_folders))
    make.image(mask, np.full((64, 64), 255, np.uint8))
    problems = check_footage(open_footage(CaptureSpec(image_folders)))
    assert len(problems) == 1
    assert "000006.png is 64x64" in problems[0]


def test_two_cameras_with_one_name(three_videos: Path, make: SimpleNamespace) -> None:
    make.video(three_videos / "videos" / "cam2.mkv", [make.numbered(0)])
    with pytest.raises(StudioError, match="Two files are camera 'cam2'"):
        open_footage(CaptureSpec(three_videos))
    assert open_footage(CaptureSpec(three_videos, images="videos/{camera}.mp4")).camera_names == (
        "cam1",
        "cam2",
        "cam10",
    )


def test_masks_that_are_not_there(three_videos: Path, make: SimpleNamespace) -> None:
    for masks, words in (
        ("files", "no mask files were found"),
        ("clean_plate", "no clean plates were found"),
        ("alpha", "camera 'cam1' have none"),
    ):
        with pytest.raises(StudioError, match=words):
            open_footage(CaptureSpec(three_videos, masks=masks))
    make.image(three_videos / "bg" / "cam1.png", make.numbered(0))
    with pytest.raises(StudioError, match="Camera 'cam2' has no clean plate"):
        open_footage(CaptureSpec(three_videos, masks="clean_plate"))
    for name in ("cam2", "cam10"):
        make.image(three_videos / "bg" / f"{name}.png", make.numbered(0, 80, 64))
    footage = open_footage(CaptureSpec(three_videos, masks="clean_plate"))
    with pytest.raises(StudioError, match="clean plate of camera 'cam2' is 80x64, its footage 96x64"):
        footage.matte("cam2", 0)


def test_no_such_camera_or_frame(three_videos: Path) -> None:
    footage = open_footage(CaptureSpec(three_videos, masks="none"))
    with pytest.raises(StudioError, match="no footage of camera 'cam3'"):
        footage.image("cam3", 0)
    with pytest.raises(StudioError, match="has no frame 99"):
        footage.image("cam1", 99)
    with pytest.raises(StudioError, match="cameras names camera 'cm1', which the footage has not; did you mean 'cam1'"):
        open_footage(CaptureSpec(three_videos, cameras=("cm1",)))
