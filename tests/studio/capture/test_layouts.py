"""Layouts of published data sets, each as a tiny capture: footage, masks and cameras are found without settings."""

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.studio.capture.test_patterns import touch
from tests.support.errors import refuses
from v3studio.pipelines.stages.camera_file import camera_file
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import match_rig, open_footage

WIDTH, HEIGHT = 96, 64
# world to camera: turned about y and z, one meter to the side
POSE = np.array([[0.0, -0.8, 0.6, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.6, 0.8, 3.0], [0, 0, 0, 1]])
K = np.array([[90.0, 0, 47.5], [0, 91.0, 31.5], [0, 0, 1]])  # OpenCV's pixel coordinates
MASK = np.zeros((HEIGHT, WIDTH), np.uint8)
MASK[20:40, 30:60] = 255


def write_cameras(path: Path, *names: str) -> None:
    """A file in a format whose reader is tested in tests/studio/camera_files."""
    ours = K.copy()
    ours[:2, 2] += 0.5
    write_rig(Rig(tuple(Camera(name, WIDTH, HEIGHT, ours, POSE) for name in names)), path)


def write_images(
    make: SimpleNamespace, images: Path, masks: Path | None, *names: str, frames: int = 2, mask: np.ndarray = MASK
) -> None:
    """Images, and masks if any, at paths with {c} and {f}."""
    for c in names:
        for f in range(frames):
            make.image(Path(str(images).format(c=c, f=f)), make.numbered(f))
            if masks is not None:
                make.image(Path(str(masks).format(c=c, f=f)), mask)


def hifi4g(root: Path, make: SimpleNamespace) -> None:
    write_cameras(root / "transforms.json", "0", "1", "2")
    write_images(make, root / "example/{c}.png", None, "0", "1", "2", frames=1)


def opencv_xml(path: Path) -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("CameraMatrix", K)
    storage.write("DistortionCoeffs", np.zeros((5, 1)))
    storage.write("RotationValues", cv2.Rodrigues(POSE[:3, :3])[0])
    storage.write("TranslationValues", POSE[:3, 3:])
    storage.release()


def video_per_folder(root: Path, make: SimpleNamespace) -> None:
    room = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    actor = room.copy()
    actor[MASK > 0] = 250
    for name in ("cam1", "cam2"):
        make.video(root / name / "video.avi", [actor] * 3, codec="mpeg4", options={"q": "2"})
        make.video(root / name / "background.avi", [room, room, actor, room, room], codec="mpeg4", options={"q": "2"})
        make.video(root / name / "checkerboard.avi", [room] * 2, codec="mpeg4", options={"q": "2"})
        opencv_xml(root / name / "config.xml")


def actorshq(root: Path, make: SimpleNamespace) -> None:
    vector = cv2.Rodrigues(POSE[:3, :3].T)[0].ravel()
    center = -POSE[:3, :3].T @ POSE[:3, 3]
    rows = ["name,w,h,rx,ry,rz,tx,ty,tz,fx,fy,px,py"]
    for name in ("Cam001", "Cam002"):
        values = [*vector, *center, 90 / WIDTH, 91 / HEIGHT, 0.5, 0.5]
        rows.append(",".join([name, str(WIDTH), str(HEIGHT), *map(repr, map(float, values))]))
    images, masks = root / "rgbs/{c}/{c}_rgb{f:06d}.jpg", root / "masks/{c}/{c}_mask{f:06d}.png"
    write_images(make, images, masks, "Cam001", "Cam002")
    (root / "calibration.csv").write_text("\n".join(rows))


def zju_mocap(root: Path, make: SimpleNamespace) -> None:
    camera = {"K": K, "D": np.zeros((5, 1)), "R": POSE[:3, :3].tolist(), "T": POSE[:3, 3:] * 1000}
    cameras = {key: [value, value] for key, value in camera.items()}
    names, labels = ("Camera_B1", "Camera_B2"), MASK // 255 * 13  # of body parts
    write_images(make, root / "{c}/{f:06d}.jpg", root / "mask_cihp/{c}/{f:06d}.png", *names, mask=labels)
    frames = [{"ims": [f"{name}/{frame:06d}.jpg" for name in names]} for frame in range(2)]
    np.save(root / "annots.npy", {"cams": cameras, "ims": np.array(frames, dtype=object).tolist()}, allow_pickle=True)


def easymocap(root: Path, make: SimpleNamespace) -> None:
    write_cameras(root / "intri.yml", "01", "02")
    write_images(make, root / "images/{c}/{f:06d}.jpg", root / "mask/{c}/{f:06d}.png", "01", "02")


def n3dv(root: Path, make: SimpleNamespace) -> None:
    right, down, forward = POSE[0, :3], POSE[1, :3], POSE[2, :3]
    center = -POSE[:3, :3].T @ POSE[:3, 3]
    matrix = np.column_stack([down, right, -forward, center, [HEIGHT, WIDTH, 90.5]])
    np.save(root / "poses_bounds.npy", np.tile([*matrix.ravel(), 1.0, 9.0], (2, 1)))
    for name in ("cam00", "cam01"):
        make.video(root / f"{name}.mp4", [make.numbered(frame) for frame in range(3)])


def thuman(root: Path, make: SimpleNamespace) -> None:
    entry = {"K": K.tolist(), "R": POSE[:3, :3].ravel().tolist(), "T": POSE[:3, 3:].tolist()}
    (root / "calibration.json").write_text(json.dumps({"cam00": entry, "cam01": entry}))
    images, masks = root / "images/{c}/{f:08d}.jpg", root / "masks/{c}/{f:08d}.png"
    write_images(make, images, masks, "cam00", "cam01", frames=1)


def nhr(root: Path, make: SimpleNamespace) -> None:
    pose = np.linalg.inv(POSE)
    line = " ".join(str(float(value)) for value in [*pose[:3, 2], *pose[:3, 0], *pose[:3, 1], *pose[:3, 3]])
    (root / "CamPose.inf").write_text(f"{line}\n{line}\n")
    rows = "\n".join(" ".join(map(str, row)) for row in K)
    (root / "Intrinsic.inf").write_text(f"0\n{rows}\n\n1\n{rows}\n")
    write_images(make, root / "img/{f}/img_{c}.jpg", root / "img/{f}/mask/img_{c}.png", "0000", "0001")


def pose2sim(root: Path, make: SimpleNamespace) -> None:
    write_cameras(root / "calibration" / "Calib_scene.toml", "cam01", "cam02")
    for name in ("cam01", "cam02"):
        make.video(root / "videos" / f"{name}.mp4", [make.numbered(frame) for frame in range(2)])


def pku_dymvhumans(root: Path, make: SimpleNamespace) -> None:
    pose = "\n".join(" ".join(map(str, row)) for row in POSE)
    intrinsics = f"90.0 0.0 {WIDTH / 2}\n0.0 91.0 {HEIGHT / 2}\n0.0 0.0 1.0"
    (root / "cams").mkdir()
    for index in range(2):
        text = f"extrinsic\n{pose}\n\nintrinsic\n{intrinsics}\n\n1 2 3 4\n"
        (root / "cams" / f"{index:08d}_cam.txt").write_text(text)
    images, masks = root / "per_view/cam_{c}/images/{f:06d}.png", root / "per_view/cam_{c}/pha/{f:06d}.png"
    write_images(make, images, masks, "0", "1")


def folder_per_frame(root: Path, make: SimpleNamespace) -> None:
    cameras = [
        {"name": name, "width": WIDTH, "height": HEIGHT, "K": [[90, 0, 48], [0, 91, 32], [0, 0, 1]],
         "R": POSE[:3, :3].tolist(), "t": POSE[:3, 3].tolist()}
        for name in ("left", "right")
    ]  # fmt: skip
    (root / "cameras.json").write_text(json.dumps({"cameras": cameras}))
    write_images(make, root / "frame{f:06d}/{c}.png", None, "left", "right")


@pytest.mark.parametrize(
    ("build", "pattern", "masks", "cameras"),
    [
        (hifi4g, "example/{camera}.png", "", ("0", "1", "2")),
        (video_per_folder, "{camera}/video.avi", "{camera}/background.avi", ("cam1", "cam2")),
        (actorshq, "rgbs/{camera}/{camera}_rgb{frame}.jpg", "masks/{camera}/{camera}_mask{frame}.png", None),
        (zju_mocap, "{camera}/{frame}.jpg", "mask_cihp/{camera}/{frame}.png", ("Camera_B1", "Camera_B2")),
        (easymocap, "images/{camera}/{frame}.jpg", "mask/{camera}/{frame}.png", ("01", "02")),
        (n3dv, "{camera}.mp4", "", ("cam00", "cam01")),
        (thuman, "images/{camera}/{frame}.jpg", "masks/{camera}/{frame}.png", ("cam00", "cam01")),
        (nhr, "img/{frame}/img_{camera}.jpg", "img/{frame}/mask/img_{camera}.png", ("0000", "0001")),
        (pose2sim, "videos/{camera}.mp4", "", ("cam01", "cam02")),
        (pku_dymvhumans, "per_view/{camera}/images/{frame}.png", "per_view/{camera}/pha/{frame}.png", None),
        (folder_per_frame, "frame{frame}/{camera}.png", "", ("left", "right")),
    ],
)
@pytest.mark.parametrize("level", [0, 1])
def test_data_sets_are_found_without_settings(
    tmp_path: Path,
    make: SimpleNamespace,
    build: Callable[[Path, SimpleNamespace], object],
    pattern: str,
    masks: str,
    cameras: tuple[str, ...] | None,
    level: int,
) -> None:
    """They are found if the capture's folder is set one level too high, too."""
    inner = tmp_path / "take" if level else tmp_path
    inner.mkdir(exist_ok=True)
    build(inner, make)
    settings = CaptureSettings(root=tmp_path, masks="auto" if masks else "none")
    path = camera_file(settings)
    assert path is not None
    footage = open_footage(settings, read_rig(path))
    prefix = "take/" if level else ""
    assert f"'{prefix}{pattern}'" in footage.description
    if cameras is not None:
        assert footage.camera_names == cameras
    for camera in footage.rig:
        np.testing.assert_allclose(camera.world_to_camera, POSE, atol=1e-6)
        np.testing.assert_allclose([camera.cx, camera.cy], [48, 32], atol=1e-6)
        np.testing.assert_allclose([camera.fx, camera.fy], [90, 91], atol=0.6)
        assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    if masks:
        assert f"'{prefix}{masks}'" in footage.description
        mask = footage.mask(footage.camera_names[0], footage.frames[0])
        inside, outside = mask[24:36, 34:56], np.concatenate([mask[:14].ravel(), mask[46:].ravel()])
        assert inside.min() > 250
        assert outside.max() < 10


def test_containers_that_cannot_be_read_say_how_to_unpack_them(tmp_path: Path) -> None:
    (tmp_path / "0012_11_main.smc").write_bytes(b"\x89HDF\r\n")
    with refuses("footage.container", file=tmp_path / "0012_11_main.smc"):
        open_footage(CaptureSettings(root=tmp_path))


def test_a_file_of_one_camera_names_the_pattern(tmp_path: Path, make: SimpleNamespace) -> None:
    video_per_folder(tmp_path, make)
    with refuses("camera_file.one_camera", file=tmp_path / "cam1" / "config.xml", setting="capture.rig") as caught:
        read_rig(tmp_path / "cam1" / "config.xml")
    assert "'{camera}/config.xml'" in str(caught.value)
    assert camera_file(CaptureSettings(root=tmp_path, rig="{camera}/config.xml")) == tmp_path / "{camera}/config.xml"
    with refuses("settings.file_not_found"):
        camera_file(CaptureSettings(root=tmp_path, rig="{camera}/other.xml"))
    takes = tmp_path / "takes"
    touch(takes, *(f"{name}/{file}" for name in ("first", "second") for file in ("config.yaml", "take.json")))
    assert camera_file(CaptureSettings(root=takes)) is None, "these are settings of takes"
    (tmp_path / "cam2" / "config.xml").write_text('<?xml version="1.0"?><opencv_storage><a>1</a></opencv_storage>')
    with refuses("camera.unknown_key", camera="cam2", key="a"):
        read_rig(tmp_path / "{camera}/config.xml")


def test_cameras_of_the_capture_come_before_those_of_videogs_frames(tmp_path: Path) -> None:
    touch(tmp_path, "10/transforms.json", "2/transforms.json")
    assert camera_file(CaptureSettings(root=tmp_path)) == tmp_path / "2" / "transforms.json"
    touch(tmp_path, "calibration/cameras.txt")
    assert camera_file(CaptureSettings(root=tmp_path)) == tmp_path / "calibration"


def test_pickles_run_no_code(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.mkdir, (str(tmp_path / "made"),)

    np.save(tmp_path / "annots.npy", np.array({"cams": Evil()}, dtype=object), allow_pickle=True)
    with refuses("camera_file.syntax", file=tmp_path / "annots.npy"):
        read_rig(tmp_path / "annots.npy")
    assert not (tmp_path / "made").exists()


def test_rows_without_their_video_are_refused(tmp_path: Path, make: SimpleNamespace) -> None:
    n3dv(tmp_path, make)
    (tmp_path / "cam01.mp4").unlink()
    with refuses("camera_file.camera_count", value=2, setting="capture.rig"):
        read_rig(tmp_path / "poses_bounds.npy")


def test_a_damaged_head_of_a_numpy_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "poses_bounds.npy"
    np.save(path, np.zeros((2, 17)))
    path.write_bytes(path.read_bytes().replace(b"}", b"("))
    with refuses("camera_file.syntax", file=path):
        read_rig(path)


def test_numbers_match_names_only_if_unambiguous(make: SimpleNamespace) -> None:
    rig = Rig((make.camera("00000000"), make.camera("00000007")))
    assert match_rig(rig, ("cam_7", "cam_0"))["cam_7"].name == "cam_7"
    with refuses("calibration.camera_missing"):
        match_rig(rig, ("cam_7", "cam_8"))
    with refuses("calibration.camera_missing"):  # the rig may count from 0
        match_rig(Rig(tuple(make.camera(name) for name in ("c0", "c1", "c2"))), ("cam_1", "cam_2"))
    panoptic = Rig(tuple(make.camera(name) for name in ("00_00", "00_01", "01_01", "50_01")))
    assert set(match_rig(panoptic, ("hd_00_01", "hd_00_00"))) == {"hd_00_00", "hd_00_01"}


def test_footage_of_a_camera_without_a_pose_is_not_used(tmp_path: Path, make: SimpleNamespace) -> None:
    """The file is as Caliscope writes it: by number, with an empty rotation, and one that it ignores."""
    for number in range(4):
        make.image(tmp_path / "images" / f"cam_{number}" / "000.png", make.numbered(0))
    rig = Rig(tuple(make.camera(f"cam_{number}") for number in range(4)))
    write_rig(rig, tmp_path / "camera_array.toml")
    text = (tmp_path / "camera_array.toml").read_text()
    *_, third, last = text.split("[cameras.")
    poseless = re.sub(r"rotation = .*|translation = .*", "", third)
    text = text.replace(third, poseless).replace(last, last.replace("ignore = false", "ignore = true"))
    (tmp_path / "camera_array.toml").write_text(text)
    given = read_rig(tmp_path / "camera_array.toml")
    write_rig(given, tmp_path / "rig.json")
    spec = CaptureSettings(root=tmp_path, masks="none", held_out=("cam_1", "cam_3"))
    for opened in (open_footage(spec, given), open_footage(spec, read_rig(tmp_path / "rig.json"))):
        assert opened.camera_names == ("cam_0", "cam_1")
        assert opened.held_out_cameras == ("cam_1",)
        assert all(name in opened.description for name in ("'cam_2'", "'cam_3'"))
