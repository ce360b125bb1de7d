import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import center_of_mass

from tests.support.errors import refuses
from tests.support.settings import refuses_setting
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.settings import MaskKind
from v3studio.studio.footage import Footage, find_cameras, open_footage


def test_videos_are_found_and_read(three_videos: Path, make: SimpleNamespace) -> None:
    footage = open_footage(CaptureSettings(root=three_videos, masks="none", held_out=("cam10",)))
    assert footage.camera_names == ("cam1", "cam2", "cam10")
    assert (footage.train_cameras, footage.held_out_cameras) == (("cam1", "cam2"), ("cam10",))
    assert footage.frames == tuple(range(12))
    assert footage.fps == 25
    assert "videos/{camera}.mp4" in footage.description
    for frame in (11, 0, 5):
        assert make.number_of(footage.image("cam2", frame)) == frame
    assert (footage.mask("cam1", 3) == 255).all()
    with refuses("footage.not_calibrated"):
        _ = footage.rig


def test_images_keep_their_frame_numbers(image_folders: Path, make: SimpleNamespace) -> None:
    footage = open_footage(CaptureSettings(root=image_folders))
    assert footage.frames == (5, 6, 7, 8)
    assert make.number_of(footage.image("right", 7)) == 7
    assert (footage.mask("left", 5)[[32, 0], [48, 0]] == [255, 0]).all()
    assert open_footage(CaptureSettings(root=image_folders, frames="6::2")).frames == (6, 8)
    assert open_footage(CaptureSettings(root=image_folders, frames=":7")).frames == (5, 6)
    with refuses("footage.no_frames", file=image_folders, available=(5, 8), setting="capture.frames"):
        open_footage(CaptureSettings(root=image_folders, frames="20:"))


def test_single_images_are_frame_zero_and_masks_may_have_another_format(tmp_path: Path, make: SimpleNamespace) -> None:
    for name in ("a", "b"):
        make.image(tmp_path / "images" / f"{name}.jpg", make.numbered(3))
        make.image(tmp_path / "masks" / f"{name}.png", np.full((32, 48), 255, np.uint8))  # half the size
    footage = open_footage(CaptureSettings(root=tmp_path))
    assert footage.frames == (0,)
    assert footage.mask("a", 0).shape == (64, 96)


def test_alpha_channel_is_the_mask(tmp_path: Path, make: SimpleNamespace) -> None:
    rgba = np.dstack([make.numbered(1), np.arange(96, dtype=np.uint8)[None].repeat(64, 0)])
    make.image(tmp_path / "images" / "a" / "0.png", rgba)
    footage = open_footage(CaptureSettings(root=tmp_path))
    assert np.array_equal(footage.mask("a", 0), rgba[:, :, 3])
    assert np.array_equal(footage.image("a", 0), rgba[:, :, :3])


def test_scale_averages_areas_and_scales_the_cameras(tmp_path: Path, make: SimpleNamespace) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (64, 96, 3), dtype=np.uint8)
    make.image(tmp_path / "images" / "a.png", image)
    footage = open_footage(CaptureSettings(root=tmp_path, masks="none", scale=0.5), Rig((make.camera("a"),)))
    expected = image.reshape(32, 2, 48, 2, 3).mean((1, 3))
    assert np.abs(footage.image("a", 0) - expected).max() <= 0.5 + 1e-6
    camera = footage.rig["a"]
    assert (camera.width, camera.height, camera.fx, camera.cx) == (48, 32, 48.0, 24.0)
    assert footage.raw_image("a", 0).shape == (64, 96, 3)
    larger = open_footage(CaptureSettings(root=tmp_path, masks="none"), Rig((make.camera("a", 192, 128),)))
    assert (larger.rig["a"].fx, larger.rig["a"].cx) == (96, 48), "the footage is half as large as the calibration"


def blob(center: np.ndarray, width: int, height: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.exp(-((x - center[0]) ** 2 + (y - center[1]) ** 2) / (2 * 2.5**2))


def centroid(image: np.ndarray) -> np.ndarray:
    return np.array(center_of_mass(image.astype(float))[::-1]) + 0.5


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_undistorted_pixels_are_where_the_pinhole_projects(tmp_path: Path, make: SimpleNamespace, scale: float) -> None:
    """Dots drawn at distorted projections must end up at the pinhole projections, within a fraction of a pixel."""
    distortion = np.array([-0.25, 0.08, 0.002, -0.003, 0.01])
    K = np.array([[300.0, 0, 172.3], [0, 296.0, 113.8], [0, 0, 1]])
    camera = Camera("a", 320, 240, K, np.eye(4), distortion)
    for point in ([0.3, 0.2, 1.0], [-0.35, -0.25, 1.0], [0.0, 0.28, 1.0]):
        dot = np.rint(255 * blob(camera.project(np.array([point]))[0][0], 320, 240)).astype(np.uint8)
        make.image(tmp_path / "images" / "a.png", np.repeat(dot[:, :, None], 3, 2))
        make.image(tmp_path / "masks" / "a.png", dot)
        footage = open_footage(CaptureSettings(root=tmp_path, scale=scale), Rig((camera,)))
        assert footage.rig["a"].is_pinhole
        expected = footage.rig["a"].project(np.array([point]))[0][0]
        np.testing.assert_allclose(centroid(footage.image("a", 0)[:, :, 0]), expected, atol=0.06)
        np.testing.assert_allclose(centroid(footage.mask("a", 0)), expected, atol=0.06)


def test_a_view_at_full_size_is_that_of_footage_without_a_scale(tmp_path: Path, make: SimpleNamespace) -> None:
    rng = np.random.default_rng(0)
    camera = Camera("a", 96, 64, make.camera("a").K, np.eye(4), np.array([-0.25, 0.08, 0.002, -0.003, 0.01]))
    plate = rng.integers(0, 100, (64, 96, 3), dtype=np.uint8)
    filmed = plate.copy()
    filmed[20:50, 30:60] = rng.integers(150, 255, (30, 30, 3), dtype=np.uint8)
    make.image(tmp_path / "images" / "a.png", filmed)
    make.image(tmp_path / "clean_plates" / "a.png", plate)
    small, large = (
        open_footage(CaptureSettings(root=tmp_path, masks="clean_plate", scale=scale), Rig((camera,)))
        for scale in (0.5, 1.0)
    )
    view, expected = small.full_size_view("a", 0), large.view("a", 0)
    for name in ("image", "mask", "plate"):
        assert np.array_equal(getattr(view, name), getattr(expected, name)), name
    assert view.mask.any()
    assert view.camera.to_dict() == expected.camera.to_dict()
    assert small.view("a", 0).image.shape == (32, 48, 3)


def test_letterboxed_footage_is_detected_by_its_bars(tmp_path: Path, make: SimpleNamespace) -> None:
    """A 96x64 calibration, and footage scaled to 90x60 with bars at the top and bottom."""
    image = np.full((64, 90, 3), 180, np.uint8)
    image[:2] = image[62:] = 0
    make.image(tmp_path / "images" / "a.png", image)

    def opened(**values: str) -> Footage:
        return open_footage(CaptureSettings(root=tmp_path, masks="none", **values), Rig((make.camera("a"),)))

    camera = opened().rig["a"]
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], [90, 90, 45, 32])
    assert "black bars" in opened().description
    image[:] = 180
    make.image(tmp_path / "images" / "a.png", image)
    with refuses("footage.aspect_ratio", value=(90, 64), camera="a", expected=(96, 64), setting="capture.size_rule"):
        opened()
    cropped, stretched = opened(size_rule="crop").rig["a"], opened(size_rule="stretch").rig["a"]
    assert (cropped.fx, cropped.cx, cropped.cy) == (96, 45, 32)
    assert (stretched.fx, stretched.fy) == (90, 96)


def test_rig_and_footage_must_have_the_same_cameras(three_videos: Path, make: SimpleNamespace) -> None:
    spec = CaptureSettings(root=three_videos, masks="none")
    rig = Rig(tuple(make.camera(name) for name in ("cam10", "cam1", "cam2")))
    assert open_footage(spec, rig).rig.names == ("cam1", "cam2", "cam10")
    with_extension = Rig(tuple(make.camera(f"{name}.png") for name in ("cam1", "cam2", "cam10")))
    assert open_footage(spec, with_extension).rig.names == ("cam1", "cam2", "cam10")
    fewer = open_footage(spec, rig.subset(["cam1", "cam2"]))
    assert fewer.camera_names == ("cam1", "cam2")
    assert "'cam10'" in fewer.description
    with refuses("calibration.camera_missing", cameras=("cam2", "cam10"), known=("cam1",)):  # a single one remains
        open_footage(spec, rig.subset(["cam1"]))
    shifted = Rig(tuple(make.camera(name) for name in ("cam0", "cam1", "cam2")))
    with refuses("calibration.camera_missing", value="cam10", cameras=("cam10",), known=("cam0", "cam1", "cam2")):
        open_footage(spec, shifted)
    assert open_footage(spec.replace(cameras=("cam1", "cam2")), rig).rig.names == ("cam1", "cam2")
    larger = Rig((*rig.cameras, make.camera("cam11")))
    more = open_footage(spec, larger)
    assert more.rig.names == ("cam1", "cam2", "cam10")
    assert "'cam11'" in more.description
    with refuses("footage.camera_missing", value="cam11", cameras=("cam11",)):
        open_footage(spec, larger, every_camera=True)


def test_held_out_cameras(three_videos: Path) -> None:
    assert open_footage(CaptureSettings(root=three_videos, held_out=("every 2",))).held_out_cameras == ("cam2",)
    with refuses("footage.unknown_camera", value="cam02", setting="capture.held_out", suggestion="cam2"):
        open_footage(CaptureSettings(root=three_videos, held_out=("cam02",)))
    with refuses("footage.all_held_out", setting="capture.held_out"):
        open_footage(CaptureSettings(root=three_videos, held_out=("cam1", "cam2", "cam10")))


def test_threads_read_right_frames(three_videos: Path, make: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    """With fewer decoders than cameras: they open and close while threads read."""
    monkeypatch.setattr(sys.modules["v3studio.studio.footage.open_footage"], "decoder_limit", lambda width, height: 2)
    footage = open_footage(CaptureSettings(root=three_videos, masks="none"), most_cached=5 * 64 * 96 * 3)

    def read(seed: int) -> list[tuple[int, int]]:
        rng = np.random.default_rng(seed)
        places = [(str(rng.choice(footage.camera_names)), int(rng.integers(12))) for _ in range(25)]
        return [(make.number_of(footage.image(*place)), place[1]) for place in places]

    with ThreadPoolExecutor(6) as pool:
        for pairs in pool.map(read, range(6)):
            assert all(number == frame for number, frame in pairs)


def test_digest_depends_on_names_and_contents_not_on_times(image_folders: Path) -> None:
    def digest() -> str:
        return open_footage(CaptureSettings(root=image_folders)).digest()

    first = digest()
    picture, mask = (image_folders / kind / "left" / "000006.png" for kind in ("images", "masks"))
    os.utime(picture, (1, 1))
    assert digest() == first
    data = mask.read_bytes()
    mask.write_bytes(data + b"\0")
    assert digest() != first
    mask.write_bytes(data)
    assert digest() == first
    picture.write_bytes(picture.read_bytes()[:-1] + b"\1")  # same size, other contents
    assert digest() != first


def test_spec_refuses_impossible_values(tmp_path: Path) -> None:
    impossible = {"scale": 0.0, "frames": "::0", "masks": "magic", "mask_components": 0, "held_out": ("every 1",)}
    for name, value in impossible.items():
        with refuses_setting(name):
            CaptureSettings(root=tmp_path, **{name: value})
    for read in (open_footage, find_cameras):
        with refuses("footage.folder_missing", file=tmp_path / "none", setting="capture.root"):
            read(CaptureSettings(root=tmp_path / "none"))


def test_only_selected_frames_need_masks(image_folders: Path) -> None:
    for name in ("left", "right"):
        for index in (7, 8):
            (image_folders / "masks" / name / f"{index:06d}.png").unlink()
    spec = CaptureSettings(root=image_folders, masks="files", mask_files="masks/{camera}/{frame}.png")
    with refuses("mask.missing", camera="left", frames=(7, 8)):
        open_footage(spec)
    assert open_footage(spec.replace(frames=":7")).frames == (5, 6)
    assert open_footage(spec, strict=False).digest(), "the files have a digest without all masks"


@pytest.mark.parametrize("masks", ["files", "auto"])
def test_clean_plates_are_known_whatever_masks_are_from(tmp_path: Path, make: SimpleNamespace, masks: MaskKind) -> None:
    rng = np.random.default_rng(0)
    plate, filmed = (rng.integers(0, 255, (64, 96, 3), dtype=np.uint8) for _ in range(2))
    mask = np.zeros((64, 96), np.uint8)
    mask[20:50, 30:60] = 255
    make.image(tmp_path / "images" / "a.png", filmed)
    make.image(tmp_path / "masks" / "a.png", mask)
    camera = Camera("a", 96, 64, make.camera("a").K, np.eye(4))
    spec = CaptureSettings(root=tmp_path, masks=masks)
    without = open_footage(spec, Rig((camera,)))
    assert without.plate("a") is None
    make.image(tmp_path / "clean_plates" / "a.png", plate)
    footage = open_footage(spec, Rig((camera,)))
    assert np.array_equal(footage.view("a", 0).plate, plate)
    assert np.array_equal(footage.mask("a", 0), mask)
    assert footage.digest() != without.digest()
    make.image(tmp_path / "clean_plates" / "a.png", plate[::2])
    with refuses("mask.plate_size", camera="a", expected=(96, 64)):
        open_footage(spec, Rig((camera,))).plate("a")
