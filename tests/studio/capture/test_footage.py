import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from studio.cameras import Camera, Rig
from studio.capture import CaptureSpec, open_footage
from studio.capture.lru_cache import ByteCache
from studio.errors import StudioError


def test_videos_are_found_and_read(three_videos: Path, make: SimpleNamespace) -> None:
    footage = open_footage(CaptureSpec(three_videos, masks="none", held_out=("cam10",)))
    assert footage.camera_names == ("cam1", "cam2", "cam10")
    assert (footage.train_cameras, footage.held_out_cameras) == (("cam1", "cam2"), ("cam10",))
    assert footage.frames == tuple(range(12))
    assert footage.fps == 25
    assert "videos/{camera}.mp4" in footage.description
    assert "12 frames" in footage.description
    for frame in (11, 0, 5):
        assert make.number_of(footage.image("cam2", frame)) == frame
    assert (footage.matte("cam1", 3) == 255).all()
    with pytest.raises(StudioError, match="no calibrated cameras"):
        _ = footage.rig


def test_images_keep_their_frame_numbers(image_folders: Path, make: SimpleNamespace) -> None:
    footage = open_footage(CaptureSpec(image_folders))
    assert footage.frames == (5, 6, 7, 8)
    assert make.number_of(footage.image("right", 7)) == 7
    assert footage.matte("left", 5)[32, 48] == 255
    assert footage.matte("left", 5)[0, 0] == 0
    assert open_footage(CaptureSpec(image_folders, start=6, step=2)).frames == (6, 8)
    assert open_footage(CaptureSpec(image_folders, stop=7)).frames == (5, 6)
    with pytest.raises(StudioError, match="frames 5 to 8, none of which"):
        open_footage(CaptureSpec(image_folders, start=20))


def test_single_images_are_frame_zero_and_masks_may_be_of_another_kind(tmp_path: Path, make: SimpleNamespace) -> None:
    for name in ("a", "b"):
        make.image(tmp_path / "images" / f"{name}.jpg", make.numbered(3))
        make.image(tmp_path / "masks" / f"{name}.png", np.full((32, 48), 255, np.uint8))  # half the size
    footage = open_footage(CaptureSpec(tmp_path))
    assert footage.frames == (0,)
    assert footage.matte("a", 0).shape == (64, 96)


def test_alpha_channel_is_the_matte(tmp_path: Path, make: SimpleNamespace) -> None:
    rgba = np.dstack([make.numbered(1), np.arange(96, dtype=np.uint8)[None].repeat(64, 0)])
    make.image(tmp_path / "images" / "a" / "0.png", rgba)
    footage = open_footage(CaptureSpec(tmp_path))
    assert np.array_equal(footage.matte("a", 0), rgba[:, :, 3])
    assert np.array_equal(footage.image("a", 0), rgba[:, :, :3])


def test_scale_averages_areas_and_scales_the_cameras(tmp_path: Path, make: SimpleNamespace) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (64, 96, 3), dtype=np.uint8)
    make.image(tmp_path / "images" / "a.png", image)
    footage = open_footage(CaptureSpec(tmp_path, masks="none", scale=0.5), Rig((make.camera("a"),)))
    expected = image.reshape(32, 2, 48, 2, 3).mean((1, 3))
    assert np.abs(footage.image("a", 0) - expected).max() <= 0.5 + 1e-6
    camera = footage.rig["a"]
    assert (camera.width, camera.height, camera.fx, camera.cx) == (48, 32, 48.0, 24.0)
    assert footage.raw_image("a", 0).shape == (64, 96, 3)


def blob(center: np.ndarray, width: int, height: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.exp(-((x - center[0]) ** 2 + (y - center[1]) ** 2) / (2 * 2.5**2))


def centroid(image: np.ndarray) -> np.ndarray:
    weights = image.astype(float)
    x, y = np.meshgrid(np.arange(image.shape[1]) + 0.5, np.arange(image.shape[0]) + 0.5)
    return np.array([(weights * x).sum(), (weights * y).sum()]) / weights.sum()


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_undistorted_pixels_lie_where_the_pinhole_camera_projects(
    tmp_path: Path, make: SimpleNamespace, scale: float
) -> None:
    """Dots drawn at distorted projections must come out at the pinhole projections, to a fraction of a pixel."""
    distortion = np.array([-0.25, 0.08, 0.002, -0.003, 0.01])
    K = np.array([[300.0, 0, 172.3], [0, 296.0, 113.8], [0, 0, 1]])
    camera = Camera("a", 320, 240, K, np.eye(4), distortion)
    for point in ([0.3, 0.2, 1.0], [-0.35, -0.25, 1.0], [0.0, 0.28, 1.0]):
        pixel = camera.project(np.array([point]))[0][0]
        dot = np.rint(255 * blob(pixel, 320, 240)).astype(np.uint8)
        make.image(tmp_path / "images" / "a.png", np.repeat(dot[:, :, None], 3, 2))
        make.image(tmp_path / "masks" / "a.png", dot)
        footage = open_footage(CaptureSpec(tmp_path, scale=scale), Rig((camera,)))
        assert footage.rig["a"].is_pinhole
        expected = footage.rig["a"].project(np.array([point]))[0][0]
        np.testing.assert_allclose(centroid(footage.image("a", 0)[:, :, 0]), expected, atol=0.06)
        np.testing.assert_allclose(centroid(footage.matte("a", 0)), expected, atol=0.06)


def test_half_size_footage_takes_the_calibration_along(tmp_path: Path, make: SimpleNamespace) -> None:
    make.image(tmp_path / "images" / "a.png", make.numbered(1))
    footage = open_footage(CaptureSpec(tmp_path, masks="none"), Rig((make.camera("a", 192, 128),)))
    assert footage.rig["a"].fx == 96
    assert footage.rig["a"].cx == 48


def test_letterboxed_footage_is_seen_by_its_bars(tmp_path: Path, make: SimpleNamespace) -> None:
    """A 96x64 calibration of footage that was scaled to 90x60 with bars above and below."""
    image = np.zeros((64, 90, 3), np.uint8)
    image[2:62] = 180
    make.image(tmp_path / "images" / "a.png", image)
    footage = open_footage(CaptureSpec(tmp_path, masks="none"), Rig((make.camera("a"),)))
    camera = footage.rig["a"]
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], [90, 90, 45, 32])
    assert "black bars" in footage.description
    image[:] = 180
    make.image(tmp_path / "images" / "a.png", image)
    with pytest.raises(StudioError, match=r"footage is 90x64, but it was calibrated at 96x64.*size_rule"):
        open_footage(CaptureSpec(tmp_path, masks="none"), Rig((make.camera("a"),)))
    cropped = open_footage(CaptureSpec(tmp_path, masks="none", size_rule="crop"), Rig((make.camera("a"),))).rig["a"]
    assert (cropped.fx, cropped.cx, cropped.cy) == (96, 45, 32)
    stretched = open_footage(CaptureSpec(tmp_path, masks="none", size_rule="stretch"), Rig((make.camera("a"),))).rig[
        "a"
    ]
    assert (stretched.fx, stretched.fy) == (90, 96)


def test_rig_and_footage_must_be_of_the_same_cameras(three_videos: Path, make: SimpleNamespace) -> None:
    spec = CaptureSpec(three_videos, masks="none")
    rig = Rig(tuple(make.camera(name) for name in ("cam10", "cam1", "cam2")))
    assert open_footage(spec, rig).rig.names == ("cam1", "cam2", "cam10")
    with_extension = Rig(tuple(make.camera(f"{name}.png") for name in ("cam1", "cam2", "cam10")))
    assert open_footage(spec, with_extension).rig.names == ("cam1", "cam2", "cam10")
    with pytest.raises(StudioError, match=r"footage has camera 'cam10' that the calibration does not know"):
        open_footage(spec, rig.subset(["cam1", "cam2"]))
    assert open_footage(replace(spec, cameras=("cam1", "cam2")), rig).rig.names == ("cam1", "cam2")
    more = Rig((*rig.cameras, make.camera("cam11")))
    with pytest.raises(StudioError, match=r"calibration has camera 'cam11' of which there is no footage"):
        open_footage(spec, more)


def test_held_out_cameras(three_videos: Path) -> None:
    assert open_footage(CaptureSpec(three_videos, held_out_every=2)).held_out_cameras == ("cam2",)
    with pytest.raises(
        StudioError, match="held_out names camera 'cam02', which the footage has not; did you mean 'cam2'"
    ):
        open_footage(CaptureSpec(three_videos, held_out=("cam02",)))
    with pytest.raises(StudioError, match="All 3 cameras are held out"):
        open_footage(CaptureSpec(three_videos, held_out=("cam1", "cam2", "cam10")))


def test_many_threads_get_the_right_frames_within_the_memory_bound(three_videos: Path, make: SimpleNamespace) -> None:
    size = 64 * 96 * 3
    footage = open_footage(CaptureSpec(three_videos, masks="none", cache_bytes=5 * size))
    footage._pool.limit = 2  # fewer decoders than cameras: they open and close under the threads' hands
    wrong: list[tuple[str, int]] = []
    largest = 0

    def read(seed: int) -> None:
        nonlocal largest
        rng = np.random.default_rng(seed)
        for _ in range(25):
            name, frame = str(rng.choice(footage.camera_names)), int(rng.integers(12))
            if make.number_of(footage.image(name, frame)) != frame:
                wrong.append((name, frame))
            largest = max(largest, footage._cache.used)

    threads = [threading.Thread(target=read, args=(seed,)) for seed in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert 0 < largest <= 5 * size


def test_what_a_caller_does_to_an_image_stays_with_the_caller(three_videos: Path) -> None:
    footage = open_footage(CaptureSpec(three_videos, masks="none"))
    first = footage.image("cam1", 0)
    before = first.copy()
    first[:] = 7
    footage.raw_image("cam1", 0)[:] = 9
    assert np.array_equal(footage.image("cam1", 0), before)


def test_cache_forgets_the_least_recently_used() -> None:
    cache = ByteCache(30)
    one = np.zeros(10, np.uint8)
    for key in "abc":
        cache.put(key, one)
    assert cache.get("a") is not None
    cache.put("d", one)
    assert cache.get("b") is None
    assert cache.get("a") is not None
    cache.put("huge", np.zeros(31, np.uint8))
    assert cache.get("huge") is None
    assert cache.used == 30


def test_cache_drops_what_it_is_told_to() -> None:
    cache = ByteCache(30)
    cache.put("a", np.zeros(10, np.uint8), np.zeros(5, np.uint8))
    assert cache.holds("a")
    cache.drop("a")
    cache.drop("never there")
    assert not cache.holds("a")
    assert cache.used == 0


def test_decoded_frames_make_room_for_what_is_made_of_them(image_folders: Path) -> None:
    footage = open_footage(CaptureSpec(image_folders, masks="none", scale=0.5))
    camera, frame = footage.camera_names[0], footage.frames[0]
    first, _ = footage.image(camera, frame), footage.matte(camera, frame)
    height, width = first.shape[:2]
    assert footage._cache.used == 4 * height * width  # the small image and its matte, not the frame
    assert np.array_equal(footage.image(camera, frame), first)


def test_digest_is_of_names_and_contents_not_of_times(image_folders: Path, tmp_path: Path) -> None:
    import os

    first = open_footage(CaptureSpec(image_folders)).digest()
    picture = image_folders / "images" / "left" / "000006.png"
    os.utime(picture, (1, 1))
    assert open_footage(CaptureSpec(image_folders)).digest() == first
    mask = image_folders / "masks" / "left" / "000006.png"
    data = mask.read_bytes()
    mask.write_bytes((image_folders / "masks" / "left" / "000007.png").read_bytes() + b"\0")
    changed = open_footage(CaptureSpec(image_folders)).digest()
    assert changed != first
    mask.write_bytes(data)
    assert open_footage(CaptureSpec(image_folders)).digest() == first
    picture.write_bytes(picture.read_bytes()[:-1] + b"\1")  # same size, other contents
    assert open_footage(CaptureSpec(image_folders)).digest() != first
    assert len(first) == 64


def test_spec_refuses_impossible_values(tmp_path: Path) -> None:
    for values in ({"scale": 0.0}, {"step": 0}, {"masks": "magic"}, {"background": (2, 0, 0)}, {"held_out_every": 1}):
        with pytest.raises(StudioError, match=next(iter(values))):
            CaptureSpec(tmp_path, **values)  # type: ignore[arg-type]
    with pytest.raises(StudioError, match="is not there"):
        open_footage(CaptureSpec(tmp_path / "none"))


def test_masks_are_needed_for_the_frames_in_use_only(image_folders: Path) -> None:
    for name in ("left", "right"):
        for index in (7, 8):
            (image_folders / "masks" / name / f"{index:06d}.png").unlink()
    spec = CaptureSpec(image_folders, masks="files", mask_files="masks/{camera}/{frame}.png")
    with pytest.raises(StudioError, match=r"Camera 'left' has no mask for frames? 7-8"):
        open_footage(spec)
    assert open_footage(replace(spec, stop=7)).frames == (5, 6)
    assert open_footage(spec, strict=False).digest(), "what the files are can be told all the same"
