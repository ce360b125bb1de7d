"""Layouts that no table lists: the camera and the frame are found in the names."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.studio.capture.test_patterns import touch
from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.detect import MASK_FOLDERS, all_beside, detect_images
from v3studio.studio.capture.inference import infer_layouts
from v3studio.studio.capture.patterns import find_files
from v3studio.studio.footage import open_footage

CAMERAS = ("cam0", "cam1", "cam2", "cam10")
WORDS = ("left", "right", "front", "top")
FRAMES = range(5)

GRIDS: list[tuple[Callable[[str, int], str], str]] = [
    (lambda c, f: f"images/{c}-{f:04d}.png", "images/{camera}-{frame}.png"),
    (lambda c, f: f"images/{c}_{f:02d}.png", "images/{camera}_{frame}.png"),
    (lambda c, f: f"{c}_frame{f:04d}.png", "{camera}_frame{frame}.png"),
    (lambda c, f: f"shots/{c}_rgb_{f:04d}.png", "shots/{camera}_rgb_{frame}.png"),
    (lambda c, f: f"frame{f:04d}_{c}.png", "frame{frame}_{camera}.png"),
    (lambda c, f: f"rgb/{f:06d}_{c}.png", "rgb/{frame}_{camera}.png"),
    (lambda c, f: f"{c}.{f:04d}.png", "{camera}.{frame}.png"),
    (lambda c, f: f"{c}f{f:03d}.jpg", "{camera}f{frame}.jpg"),
    (lambda c, f: f"take2_{c}_{f + 100:06d}.png", "take2_{camera}_{frame}.png"),
    (lambda c, f: f"frame{f:06d}/images/{c}.png", "frame{frame}/images/{camera}.png"),
    (lambda c, f: f"t{f}/{c}.jpg", "t{frame}/{camera}.jpg"),
    (lambda c, f: f"{c}/frame_{f + 1:05d}.jpg", "{camera}/frame_{frame}.jpg"),
    (lambda c, f: f"{c}/images/frame_{f:05d}.png", "{camera}/images/frame_{frame}.png"),
    (lambda c, f: f"data/{c}/rgb/{f:04d}.png", "data/{camera}/rgb/{frame}.png"),
    (lambda c, f: f"{c}/DCIM/IMG_{f + 31:04d}.JPG", "{camera}/DCIM/IMG_{frame}.JPG"),
    (lambda c, f: f"{c}/{c}_{f:04d}.png", "{camera}/{camera}_{frame}.png"),
    (lambda c, f: f"images/{WORDS[CAMERAS.index(c)]}_{f}.png", "images/{camera}_{frame}.png"),
    (lambda c, f: f"images/cam_{CAMERAS.index(c)}_{f:04d}.png", "images/{camera}_{frame}.png"),
    (lambda c, f: f"{CAMERAS.index(c):02d}_{f:06d}.png", "{camera}_{frame}.png"),
    (lambda c, f: f"{f:06d}_{CAMERAS.index(c):02d}.png", "{frame}_{camera}.png"),
    (lambda c, f: f"{c}/take1/{f:04d}.png", "{camera}/take1/{frame}.png"),
    (lambda c, f: f"{c}/A{CAMERAS.index(c)}C1_R1AB.{f + 86400:07d}.png", "{camera}/A*.{frame}.png"),
    (lambda c, f: f"{c}/Camera-2243{CAMERAS.index(c)}-{f:04d}.png", "{camera}/Camera-*-{frame}.png"),
    (lambda c, f: f"{c}/IMG_{100 * CAMERAS.index(c) + f:04d}.png", "{camera}/IMG_{frame}.png"),
    (lambda c, f: f"{c}/{f:06d}_{0.04 * f:.3f}.png", "{camera}/{frame}_*.png"),
    (lambda c, f: f"images/{c}/{12.92 + 0.04 * f:.6f}.png", "images/{camera}/{seconds}.png"),
    (lambda c, f: f"images/{22430 + 7 * CAMERAS.index(c)}_{f}.png", "images/{camera}_{frame}.png"),
]


@pytest.mark.parametrize(("name", "pattern"), GRIDS)
@pytest.mark.parametrize("within", ["", "capture/"])
def test_grids_are_found(tmp_path: Path, name: Callable[[str, int], str], pattern: str, within: str) -> None:
    touch(tmp_path, *(within + name(camera, frame) for camera in CAMERAS for frame in FRAMES))
    touch(tmp_path, within + "notes.txt", within + "depth/cam0/0001.png", within + "masks/cam0.png")
    detected, matches = detect_images(tmp_path)
    assert detected == within + pattern
    assert len({match.camera for match in matches}) == len(CAMERAS)
    assert len({match.frame for match in matches if match.camera == matches[0].camera}) == len(FRAMES)
    assert find_files(tmp_path, detected) == matches  # so that it can be pasted


@given(
    camera=st.sampled_from(["cam{}", "view_{}", "C{}", "{}", "device-{}", "kinect{}"]),
    frame=st.sampled_from(["{:04d}", "frame{:05d}", "frame_{:d}", "img_{:03d}", "f{:03d}"]),
    between=st.sampled_from(["/", "_", "-", ".", "/images/", "_rgb_"]),
    frame_first=st.booleans(),
    prefix=st.sampled_from(["", "footage/"]),
    cameras=st.integers(2, 12),
    frames=st.integers(2, 12),
    start=st.integers(0, 500),
)
@settings(max_examples=150, deadline=None)
def test_names_of_both_kinds_in_any_order(
    camera: str, frame: str, between: str, frame_first: bool, prefix: str, cameras: int, frames: int, start: int
) -> None:
    assume(camera != "{}" or frame.startswith(("frame", "img")))  # two numbers alone say too little
    assume(not (frame_first and between == "_rgb_"))
    truth = {}
    for number in range(cameras):
        for time in range(start, start + frames):
            parts = [camera.format(number), frame.format(time)]
            path = prefix + between.join(parts[::-1] if frame_first else parts) + ".png"
            truth[path] = (camera.format(number), time)
    best = infer_layouts(list(truth))[0]
    assert (best.is_grid, best.frames) == (True, frames)
    assert best.cameras == {name for name, _ in truth.values()}


@pytest.mark.parametrize(
    "names",
    [
        [f"images/IMG_{index:04d}.JPG" for index in range(30)],
        [f"images/DSC_2023_{index:04d}.JPG" for index in range(30)],
        [f"photos/cam{index}.png" for index in range(30)],
        [f"images/left_cam{index}.png" for index in range(6)] + [f"images/right_cam{index}.png" for index in range(6)],
    ],
)
def test_photographs_stay_cameras(tmp_path: Path, names: list[str]) -> None:
    touch(tmp_path, *names)
    _, matches = detect_images(tmp_path)
    assert len({match.camera for match in matches}) == len(names)


@pytest.mark.parametrize(
    ("images", "masks"),
    [
        ("ims/{}/{:06d}.jpg", "seg/{}/{:06d}.png"),
        ("images/{}/{:06d}.jpg", "masks/{}/{:06d}.png"),
        ("rgb/{}_{:04d}.png", "mask/{}_{:04d}.png"),
        ("rgb/{}/{:04d}.png", "Segmentation/{}/{:04d}.PNG"),
        ("color/{}/{:04d}.png", "fg_masks/{}/{:04d}.png"),
        ("{}/rgb/{:04d}.png", "{}/silhouettes/{:04d}.png"),
        ("images/{}/{:04d}.jpg", "masks/{}/{:04d}.jpg.png"),
        ("images/{}/{:04d}.jpg", "masks/{}/mask_{:04d}.png"),
        ("images/{}/{:04d}.jpg", "masks/{}/{:04d}_mask.png"),
        ("{}/{:04d}.jpg", "{}/{:04d}_mask.png"),
        ("images/{}_{:04d}.png", "images/{}_{:04d}.mask.png"),
        ("frame{1:04d}/images/{0}.png", "frame{1:04d}/masks/{0}.png"),
    ],
)
def test_images_and_masks_are_one_capture(tmp_path: Path, images: str, masks: str) -> None:
    touch(tmp_path, *(name.format(camera, frame) for camera in CAMERAS for frame in FRAMES for name in (images, masks)))
    _, matches = detect_images(tmp_path)
    places = {(match.camera, match.frame) for match in matches}
    assert places == {(camera, frame) for camera in CAMERAS for frame in FRAMES}
    beside = next(all_beside(tmp_path, MASK_FOLDERS, CAMERAS), None)
    assert {(match.camera, match.frame) for match in beside[1]} == places
    assert not {match.path for match in beside[1]} & {match.path for match in matches}


CARDS = {
    "one video each": (["cam0/GX010031.MP4", "cam1/GX010007.MP4"], "{camera}/*.MP4"),
    "on cards": (["cam0/DCIM/100GOPRO/GX010031.MP4", "cam1/DCIM/101GOPRO/GX010007.MP4"], "{camera}/DCIM/*/*.MP4"),
    "of the same name": (["cam0/clip/C0001.MP4", "cam1/clip/C0001.MP4"], "{camera}/clip/C0001.MP4"),
    "chapters": (["cam0/GX010031.MP4", "cam0/GX020031.MP4", "cam1/GX010007.MP4", "cam1/GX020007.MP4"],
                 "{camera}/G{chapter}????.MP4"),
    "chapters of older cameras": (["cam0/GOPR0031.MP4", "cam0/GP010031.MP4", "cam1/GOPR0007.MP4", "cam1/GP010007.MP4"],
                                  "{camera}/G{chapter}????.MP4"),
    "chapters in one folder": (["cam0_GX010031.MP4", "cam0_GX020031.MP4", "cam1_GX010007.MP4"],
                               "{camera}_G{chapter}????.MP4"),
    "names after chapters": (["videos/GX010031-a.MP4", "videos/GX020031-a.MP4", "videos/GX010031-b.MP4"],
                             "videos/G{chapter}????-{camera}.MP4"),
    "several recordings": (["cam0_GX010031.MP4", "cam0_GX010032.MP4", "cam1_GX010031.MP4"], "{camera}.MP4"),
}  # fmt: skip


@pytest.mark.parametrize("name", CARDS)
def test_folders_of_cards(tmp_path: Path, name: str) -> None:
    files, pattern = CARDS[name]
    touch(tmp_path, *files, *(file.replace(".MP4", ".LRV") for file in files))
    detected, matches = detect_images(tmp_path)
    assert detected == pattern
    assert [match.path.relative_to(tmp_path).as_posix() for match in matches] == files


def test_chapters_are_one_recording(tmp_path: Path, make: SimpleNamespace) -> None:
    for camera, number in (("cam0", "0031"), ("cam1", "0007")):
        for chapter, first in (("02", 5), ("01", 0), ("10", 9)):
            frames = [make.numbered(index) for index in range(first, {0: 5, 5: 9, 9: 12}[first])]
            make.video(tmp_path / camera / f"GX{chapter}{number}.MP4", frames)
    footage = open_footage(CaptureSettings(root=tmp_path, masks="none"))
    assert footage.frames == tuple(range(12))
    assert [make.number_of(footage.image("cam1", frame)) for frame in (11, 0, 5, 4, 9, 8)] == [11, 0, 5, 4, 9, 8]
    assert "3 files" in footage.description
    assert len(footage.files()) == 6
    with refuses("audio.several_files"):
        open_footage(CaptureSettings(root=tmp_path, masks="none", audio="cam0"))


def test_chapters_must_fit(tmp_path: Path, make: SimpleNamespace) -> None:
    for camera in ("cam0", "cam1"):
        make.video(tmp_path / camera / "GX010031.MP4", [make.numbered(0)] * 3)
        make.video(tmp_path / camera / "GX020031.MP4", [make.numbered(0, 192, 128)] * 3)
    with refuses("footage.chapters_differ", camera="cam0"):
        open_footage(CaptureSettings(root=tmp_path, masks="none"))


def test_a_pattern_without_files_is_answered_with_one_that_has_some(tmp_path: Path) -> None:
    touch(tmp_path, *(f"{camera}/frame_{frame}.png" for camera in CAMERAS for frame in FRAMES))
    with refuses("footage.not_found", setting="capture.images") as caught:
        open_footage(CaptureSettings(root=tmp_path, images="images/{camera}.png"))
    assert "'{camera}/frame_{frame}.png'" in str(caught.value)


def test_a_numbered_recording_opens_as_chapters(tmp_path: Path, make: SimpleNamespace) -> None:
    for camera in ("a", "b"):
        for part in range(2):
            make.video(tmp_path / camera / f"clip_{part}.mp4", [make.numbered(part)] * 2)
    with refuses("footage.video_as_frame") as caught:
        open_footage(CaptureSettings(root=tmp_path, masks="none", images="{camera}/clip_{frame}.mp4"))
    assert "{chapter}" in str(caught.value)
    footage = open_footage(CaptureSettings(root=tmp_path, masks="none", images="{camera}/clip_{chapter}.mp4"))
    assert [make.number_of(footage.image("a", frame)) for frame in footage.frames] == [0, 0, 1, 1]
