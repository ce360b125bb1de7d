"""Bad footage: one clear error per problem."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image, ImageCms

from tests.support.errors import cancel_at, refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.images import image_header, read_image
from v3studio.studio.errors import Cancelled
from v3studio.studio.footage import open_footage
from v3studio.studio.footage.checks import check_footage


def test_checking_can_be_stopped(image_folders: Path) -> None:
    with pytest.raises(Cancelled):
        check_footage(open_footage(CaptureSettings(root=image_folders)), cancel_at(3))


def test_a_camera_missing_in_a_frame(image_folders: Path) -> None:
    (image_folders / "images" / "right" / "000006.png").unlink()
    with refuses("footage.frames_missing", camera="right", frames=(6,)) as caught:
        open_footage(CaptureSettings(root=image_folders))
    assert "capture.frames" not in str(caught.value), "no range has frames 5 and 7, but not 6"
    footage = open_footage(CaptureSettings(root=image_folders), strict=False)
    assert footage.frames == (5, 7, 8)
    assert [problem.code for problem in check_footage(footage)] == ["footage.frames_missing"]


def test_different_frame_counts(three_videos: Path, make: SimpleNamespace) -> None:
    make.video(three_videos / "videos" / "cam2.mp4", [make.numbered(index) for index in range(9)])
    with refuses("footage.camera_ends_early", value=8, camera="cam2", expected=11, setting="capture.frames") as caught:
        open_footage(CaptureSettings(root=three_videos))
    assert "set capture.frames to :9" in str(caught.value)
    assert open_footage(CaptureSettings(root=three_videos, frames=":9")).frames == tuple(range(9))


def test_a_camera_that_is_numbered_from_another_number(image_folders: Path) -> None:
    """The range in the error can be pasted."""
    for frame in (8, 7, 6, 5):
        file = image_folders / "images" / "right" / f"{frame:06d}.png"
        file.rename(file.with_name(f"{frame + 1:06d}.png"))
    with refuses("footage.camera_ends_early", camera="left") as caught:
        open_footage(CaptureSettings(root=image_folders))
    pasted = re.search(r"capture\.frames to (\S+)", str(caught.value))
    assert open_footage(CaptureSettings(root=image_folders, frames=pasted[1])).frames == (6, 7, 8)


@pytest.mark.parametrize(("space", "named"), [("sRGB", False), ("LAB", True)])
def test_other_color_profiles_are_named(tmp_path: Path, make: SimpleNamespace, space: str, named: bool) -> None:
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile(space)).tobytes()
    Image.fromarray(make.numbered(0)).save(tmp_path / "0.png", icc_profile=profile)
    assert ("color profile" in image_header(tmp_path / "0.png")[3]) == named


def test_images_that_exif_turns_are_named(tmp_path: Path, make: SimpleNamespace) -> None:
    for camera, orientation in (("a", 1), ("b", 6)):
        exif = Image.Exif()
        exif[0x0112] = orientation
        (tmp_path / "images" / camera).mkdir(parents=True)
        Image.fromarray(make.numbered(0)).save(tmp_path / "images" / camera / "0.jpg", exif=exif)
    footage = open_footage(CaptureSettings(root=tmp_path, masks="none"))
    (line,) = [line for line in footage.description.splitlines() if "EXIF" in line]
    assert "'b'" in line
    assert "'a'" not in line
    assert footage.image("b", 0).shape == footage.image("a", 0).shape


def test_different_rates(three_videos: Path, make: SimpleNamespace) -> None:
    make.video(three_videos / "videos" / "cam2.mp4", [make.numbered(index) for index in range(12)], fps=30)
    with refuses("footage.fps_mismatch", value=(25, 30), cameras=("cam1", "cam2"), setting="capture.fps"):
        open_footage(CaptureSettings(root=three_videos))
    assert open_footage(CaptureSettings(root=three_videos, fps=25)).fps == 25


def test_different_sizes_within_a_camera(image_folders: Path, make: SimpleNamespace) -> None:
    path = make.image(image_folders / "images" / "left" / "000007.png", make.numbered(7, 80, 64))
    (problem,) = check_footage(open_footage(CaptureSettings(root=image_folders)))
    assert (problem.code, problem.file, problem.value) == ("footage.size_changed", path, (80, 64))
    assert problem.fields == {"camera": "left", "frame": 7, "expected": (96, 64)}


def test_truncated_and_unreadable_images(image_folders: Path) -> None:
    cut = image_folders / "images" / "left" / "000007.png"
    cut.write_bytes(cut.read_bytes()[:-40])
    text = image_folders / "images" / "right" / "000008.png"
    text.write_text("not an image")
    footage = open_footage(CaptureSettings(root=image_folders))
    problems = [(problem.code, problem.file) for problem in check_footage(footage)]
    assert problems == [("footage.image_unreadable", path) for path in (cut, text)]
    with refuses("footage.image_unreadable", file=cut):
        footage.image("left", 7)
    assert footage.image("left", 6).shape == (64, 96, 3)


def test_empty_and_all_white_masks(image_folders: Path, make: SimpleNamespace) -> None:
    for frame in (6, 7):
        make.image(image_folders / "masks" / "left" / f"{frame:06d}.png", np.zeros((64, 96), np.uint8))
    make.image(image_folders / "masks" / "right" / "000005.png", np.full((64, 96), 255, np.uint8))
    problems = check_footage(open_footage(CaptureSettings(root=image_folders)))
    assert [(problem.code, problem.fields) for problem in problems] == [
        ("mask.empty", {"camera": "left", "frames": (6, 7)}), ("mask.full", {"camera": "right", "frames": (5,)}),
    ]  # fmt: skip


def test_missing_mask_and_wrong_mask_shape(image_folders: Path, make: SimpleNamespace) -> None:
    mask = image_folders / "masks" / "left" / "000006.png"
    mask.unlink()
    with refuses("mask.missing", camera="left", frames=(6,), kind="mask"):
        open_footage(CaptureSettings(root=image_folders))
    make.image(mask, np.full((64, 64), 255, np.uint8))
    (problem,) = check_footage(open_footage(CaptureSettings(root=image_folders)))
    assert (problem.code, problem.file, problem.value) == ("mask.aspect_ratio", mask, (64, 64))
    assert problem.fields == {"camera": "left", "frame": 6, "expected": (96, 64)}


def test_masks_that_are_not_there(three_videos: Path, make: SimpleNamespace) -> None:
    for masks, code, setting in (
        ("files", "mask.not_found", "capture.mask_files"),
        ("clean_plate", "mask.plates_not_found", "capture.clean_plates"),
        ("alpha", "mask.alpha_missing", "capture.masks"),
    ):
        with refuses(code, setting=setting):
            open_footage(CaptureSettings(root=three_videos, masks=masks))
    make.image(three_videos / "bg" / "cam1.png", make.numbered(0))
    with refuses("mask.plate_missing", camera="cam2"):
        open_footage(CaptureSettings(root=three_videos, masks="clean_plate"))
    for name in ("cam2", "cam10"):
        make.image(three_videos / "bg" / f"{name}.png", make.numbered(0, 80, 64))
    footage = open_footage(CaptureSettings(root=three_videos, masks="clean_plate"))
    with refuses("mask.plate_size", value=(80, 64), camera="cam2", expected=(96, 64)):
        footage.mask("cam2", 0)


def test_no_such_camera_or_frame(three_videos: Path) -> None:
    footage = open_footage(CaptureSettings(root=three_videos, masks="none"))
    with refuses("footage.unknown_camera", value="cam3", known=("cam1", "cam2", "cam10")):
        footage.image("cam3", 0)
    with refuses("footage.no_such_frame", file=three_videos / "videos" / "cam1.mp4", value=99):
        footage.image("cam1", 99)
    with refuses("footage.unknown_camera", value="cm1", setting="capture.cameras", suggestion="cam1"):
        open_footage(CaptureSettings(root=three_videos, cameras=("cm1",)))


def test_videos_and_images_cannot_be_mixed(three_videos: Path, make: SimpleNamespace) -> None:
    make.image(three_videos / "videos" / "still.png", make.numbered(0))
    with refuses("footage.mixed_media", cameras=["cam10", "still"], setting="capture.images"):
        open_footage(CaptureSettings(root=three_videos, images="videos/{camera}.*"))


def test_an_image_beyond_pillows_limit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.png"
    Image.new("RGB", (64, 48)).save(path)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    with refuses("footage.image_too_large", file=path):
        read_image(path)
