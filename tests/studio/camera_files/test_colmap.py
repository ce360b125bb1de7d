"""COLMAP's models, against COLMAP's own reader and writer; damaged and contradictory ones."""

import struct
from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.rigs import BENT, POINTS, STRAIGHT
from v3studio.studio.camera_files import read_rig, write_rig

pycolmap = pytest.importorskip("pycolmap")


@pytest.mark.parametrize("form", ["bin", "txt"])
def test_colmap_models_as_colmap_writes_them(tmp_path: Path, form: str) -> None:
    """A synthetic reconstruction written by COLMAP: our cameras project its points like COLMAP's."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 3, 2
    options.num_points3D = 50
    options.camera_model_id = pycolmap.CameraModelId.SIMPLE_RADIAL
    options.camera_params = [1280.0, 512.0, 384.0, 0.05]
    model = pycolmap.synthesize_dataset(options)
    (model.write_binary if form == "bin" else model.write_text)(tmp_path)
    rig = read_rig(tmp_path)
    assert len(rig) == model.num_reg_images() == 6
    points = np.array([point.xyz for point in model.points3D.values()])
    for image in model.images.values():
        camera = next(c for c in rig if np.allclose(c.center, image.projection_center(), atol=1e-9))
        expected = np.array([image.project_point(point) for point in points])
        np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-6)


def test_colmap_reads_what_we_write(tmp_path: Path) -> None:
    write_rig(BENT, tmp_path / "model")
    for image in pycolmap.Reconstruction(tmp_path / "model").images.values():
        camera = BENT[Path(image.name).stem]
        expected = np.array([image.project_point(point) for point in POINTS])
        np.testing.assert_allclose(camera.project(POINTS)[0], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("model", "parameters"),
    [
        ("SIMPLE_PINHOLE", [500, 320, 180]),
        ("PINHOLE", [500, 510, 321, 181]),
        ("SIMPLE_RADIAL", [500, 320, 180, -0.1]),
        ("RADIAL", [500, 320, 180, -0.1, 0.05]),
        ("OPENCV", [500, 510, 320, 180, -0.1, 0.05, 0.002, -0.003]),
        ("FULL_OPENCV", [500, 510, 320, 180, -0.1, 0.05, 0.002, -0.003, 0.01, 0.02, -0.01, 0.005]),
        ("OPENCV_FISHEYE", [300, 310, 320, 180, 0.03, -0.01, 0.002, 0.001]),
        ("SIMPLE_RADIAL_FISHEYE", [300, 320, 180, 0.03]),
        ("RADIAL_FISHEYE", [300, 320, 180, 0.03, -0.01]),
        ("THIN_PRISM_FISHEYE", [300, 310, 320, 180, 0.03, -0.01, 0.002, 0.001, 0.004, 0.003, -0.002, 0.001]),
    ],
)
def test_every_colmap_camera_model_distorts_as_colmap_does(tmp_path: Path, model: str, parameters: list[float]) -> None:
    (tmp_path / "cameras.txt").write_text(f"# c\n7 {model} 640 360 {' '.join(map(str, parameters))}\n")
    (tmp_path / "images.txt").write_text("# i\n3 1 0 0 0 0 0 2.0 7 sub folder/a b.png\n\n")
    camera = read_rig(tmp_path)["a b"]
    distortion = pycolmap.Camera(model=model, width=640, height=360, params=parameters)
    local = POINTS + np.array([0, 0, 2.0])
    rays = local[:, :2] / local[:, 2:]
    expected = np.array(distortion.img_from_cam(np.column_stack([rays, np.ones(len(rays))])))
    np.testing.assert_allclose(camera.project(POINTS)[0], expected, atol=1e-6)


def test_names_from_folders(tmp_path: Path) -> None:
    """With one image per camera in a folder, cameras are named after the folders. Others have no images."""
    lenses = "1 PINHOLE 64 48 50 50 32 24\n2 OPENCV_FISHEYE 64 48 50 50 32 24 0 0 0 0\n3 PINHOLE 64 48 0 0 32 24\n"
    (tmp_path / "cameras.txt").write_text(lenses)
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 left/0001.png\n\n2 1 0 0 0 1 0 0 1 right/0001.png\n\n")
    assert read_rig(tmp_path).names == ("left", "right")


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_binary_cut_short_anywhere(tmp_path: Path, name: str) -> None:
    write_rig(BENT, tmp_path / "model")
    pycolmap.Reconstruction(tmp_path / "model").write_binary(tmp_path / "model")
    path = tmp_path / "model" / name
    whole = path.read_bytes()
    assert len(read_rig(tmp_path / "model")) == 3
    for length in range(0, len(whole) - 1, max(1, len(whole) // 40)):
        path.write_bytes(whole[:length])
        with refuses("camera_file.truncated", file=path, value=length):
            read_rig(tmp_path / "model")


def colmap_text(folder: Path, between: str, count: int = 4) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text("1 PINHOLE 640 360 500 500 320 180\n")
    lines = [f"{index + 1} 1 0 0 0 {index} 0 0 1 cam{index}.png" for index in range(count)]
    (folder / "images.txt").write_text("# images\n" + between.join(lines) + between)
    (folder / "points3D.txt").write_text("")
    return folder


@pytest.mark.parametrize("between", ["\n\n", "\n\n\n", "\n1.5 2.5 -1 3 4 7\n", "\n\n# a comment\n"])
def test_lines_of_images_txt_as_colmap_reads_them(tmp_path: Path, between: str) -> None:
    folder = colmap_text(tmp_path, between)
    wanted = {image.name.removesuffix(".png") for image in pycolmap.Reconstruction(folder).images.values()}
    assert set(read_rig(folder).names) == wanted
    assert len(wanted) == 4


@pytest.mark.parametrize("between", ["\n", "\n1 2\n", "\n1 2 x\n", "\n1 2 1e400\n"])
def test_images_txt_without_lines_of_points(tmp_path: Path, between: str) -> None:
    with refuses("camera_file.no_points_line", file=tmp_path / "images.txt", line=3):
        read_rig(colmap_text(tmp_path, between))


def test_the_largest_model_of_colmap_is_used(tmp_path: Path) -> None:
    colmap_text(tmp_path / "sparse" / "0", "\n\n", 2)
    colmap_text(tmp_path / "sparse" / "1", "\n\n", 4)
    for path in (tmp_path, tmp_path / "sparse"):
        rig = read_rig(path)
        assert len(rig) == 4
        assert any("2 models" in note for note in rig.notes)
    assert len(read_rig(tmp_path / "sparse" / "0")) == 2


def test_colmap_models_that_say_two_things(tmp_path: Path) -> None:
    write_rig(STRAIGHT, tmp_path)
    model = tmp_path / "cameras.txt"
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", 1, 1, 1, 640, 480, 700, 700, 320, 240))
    pose = struct.pack("<i7di", 1, 1, 0, 0, 0, 0, 0, 3, 1)
    (tmp_path / "images.bin").write_bytes(struct.pack("<Q", 1) + pose + b"a.png\0" + struct.pack("<Q", 0))
    rig = read_rig(tmp_path)
    assert rig.names == ("a",)
    assert any("images.txt" in note for note in rig.notes)
    (tmp_path / "cameras.bin").unlink()
    assert read_rig(tmp_path).names == STRAIGHT.names
    model.write_text(model.read_text() + "1 PINHOLE 640 480 700 700 320 240\n")
    with refuses("camera_file.camera_twice", file=model, value=1):
        read_rig(tmp_path)
