"""Camera files compared with COLMAP's reader and writer and with files written by hand; damaged files."""

import json
from pathlib import Path

import numpy as np
import pytest

from studio.camera_files import read_rig, write_rig
from studio.cameras import Camera, Rig
from tests.support.errors import refuses
from tests.support.rigs import on_circle, pose

POINTS = np.random.default_rng(1).uniform(-0.5, 0.5, (40, 3))


def looking_at_origin(angle: float, height: float, distance: float = 3.0) -> np.ndarray:
    return pose(on_circle(angle, distance, height))


@pytest.fixture
def rig() -> Rig:
    distortions = [np.zeros(0), np.array([-0.1, 0.05, 0.001, -0.002]), np.array([-0.2, 0.1, 0.001, 0.002, -0.03])]
    cameras = []
    for index, distortion in enumerate(distortions):
        K = np.array([[510.0 + index, 0, 331.25], [0, 505.5, 177.75 - index], [0, 0, 1]])
        cameras.append(Camera(f"cam{index:02d}", 640, 360, K, looking_at_origin(index * 1.3, 0.4 * index), distortion))
    return Rig(tuple(cameras))


def assert_same_images(found: Rig, wanted: Rig) -> None:
    """Assert that every camera projects every point to the same pixel."""
    assert set(found.names) == set(wanted.names)
    for camera in wanted:
        twin = found[camera.name]
        assert (twin.width, twin.height) == (camera.width, camera.height)
        np.testing.assert_allclose(twin.project(POINTS)[0], camera.project(POINTS)[0], atol=1e-6)
        np.testing.assert_allclose(twin.project(POINTS)[1], camera.project(POINTS)[1], atol=1e-9)


@pytest.mark.parametrize("name", ["rig.json", "transforms.json", "sparse"])
def test_what_is_written_is_read_again(rig: Rig, tmp_path: Path, name: str) -> None:
    write_rig(rig, tmp_path / name)
    assert_same_images(read_rig(tmp_path / name), rig)
    assert not [path for path in tmp_path.rglob("*") if ".partial" in path.name]


def test_transforms_json_by_hand(tmp_path: Path) -> None:
    """A camera at (0, 0, 2) whose OpenGL axes equal the world axes looks along -z; the field of view is 90 degrees."""
    matrix = np.eye(4)
    matrix[2, 3] = 2.0
    frame = {"file_path": "images/a.png", "transform_matrix": matrix.tolist()}
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"camera_angle_x": np.pi / 2, "w": 200, "h": 100, "frames": [frame]}))
    camera = read_rig(path)["a"]
    pixels, depth = camera.project(np.array([[0.0, 0, 0], [0.5, 0.25, 0]]))
    # right is +x; up is +y, toward smaller rows; 45 degrees correspond to half the width
    np.testing.assert_allclose(pixels, [[100, 50], [125, 37.5]], atol=1e-9)
    np.testing.assert_allclose(depth, [2, 2])


def test_transforms_json_with_opencv_axes_and_matrix(rig: Rig, tmp_path: Path) -> None:
    """NeuS2's flavor: from_na, and an intrinsic matrix in each frame."""
    camera = rig["cam00"]
    matrix = np.eye(4)
    matrix[:3, :3] = camera.K
    frame = {
        "file_path": "images/cam00.png",
        "transform_matrix": np.linalg.inv(camera.world_to_camera).tolist(),
        "intrinsic_matrix": matrix.tolist(),
    }
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"from_na": True, "w": 640, "h": 360, "frames": [frame]}))
    assert_same_images(read_rig(path), rig.subset(["cam00"]))


def test_transforms_size_from_the_image(tmp_path: Path) -> None:
    from PIL import Image

    (tmp_path / "train").mkdir()
    Image.new("RGB", (64, 48)).save(tmp_path / "train" / "r_0.png")
    frame = {"file_path": "./train/r_0", "transform_matrix": np.eye(4).tolist()}
    path = tmp_path / "transforms_train.json"
    path.write_text(json.dumps({"camera_angle_x": 0.6, "frames": [frame]}))
    camera = read_rig(path)["r_0"]
    assert (camera.width, camera.height) == (64, 48)
    assert camera.fx == pytest.approx(32 / np.tan(0.3))


@pytest.mark.parametrize("form", ["bin", "txt"])
def test_colmap_models_as_colmap_writes_them(tmp_path: Path, form: str) -> None:
    """A synthetic reconstruction written by COLMAP: our cameras project its points like COLMAP's."""
    pycolmap = pytest.importorskip("pycolmap")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 3, 2
    options.num_points3D = 50
    options.camera_model_id = pycolmap.CameraModelId.SIMPLE_RADIAL
    options.camera_params = [1280.0, 512.0, 384.0, 0.05]
    model = pycolmap.synthesize_dataset(options)
    (model.write_binary if form == "bin" else model.write_text)(tmp_path)
    found = read_rig(tmp_path)
    assert len(found) == model.num_reg_images() == 6
    points = np.array([point.xyz for point in model.points3D.values()])
    for image in model.images.values():
        camera = next(c for c in found if np.allclose(c.center, image.projection_center(), atol=1e-9))
        expected = np.array([image.project_point(point) for point in points])
        np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-6)


def test_colmap_reads_what_we_write(rig: Rig, tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    write_rig(rig, tmp_path / "model")
    model = pycolmap.Reconstruction(tmp_path / "model")
    for image in model.images.values():
        camera = rig[Path(image.name).stem]
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
    ],
)
def test_every_colmap_camera_model_distorts_as_colmap_does(tmp_path: Path, model: str, parameters: list[float]) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    (tmp_path / "cameras.txt").write_text(f"# c\n7 {model} 640 360 {' '.join(map(str, parameters))}\n")
    (tmp_path / "images.txt").write_text("# i\n3 1 0 0 0 0 0 2.0 7 sub folder/a b.png\n\n")
    camera = read_rig(tmp_path)["a b"]
    distortion = pycolmap.Camera(model=model, width=640, height=360, params=parameters)
    local = POINTS + np.array([0, 0, 2.0])
    rays = local[:, :2] / local[:, 2:]
    expected = np.array(distortion.img_from_cam(np.column_stack([rays, np.ones(len(rays))])))
    np.testing.assert_allclose(camera.project(POINTS)[0], expected, atol=1e-6)


def test_names_from_folders(tmp_path: Path) -> None:
    """With one image per camera in a folder, the cameras are named after the folders."""
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 64 48 50 50 32 24\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 left/0001.png\n\n2 1 0 0 0 1 0 0 1 right/0001.png\n\n")
    assert read_rig(tmp_path).names == ("left", "right")


def qualisys(rig: Rig) -> str:
    """Qualisys Track Manager's file for a rig: millimeters, y up, z back, units of 1/64 pixel, inclusive bounds."""
    cameras = []
    for camera in rig:
        r = np.diag([1.0, -1.0, -1.0]) @ camera.rotation
        turn = " ".join(f'r{i + 1}{j + 1}="{r[i, j]!r}"' for i in range(3) for j in range(3))
        turn = turn.replace("np.float64(", "").replace(")", "")
        x, y, z = (camera.center * 1000).tolist()
        k1, k2, p1, p2, k3 = np.pad(camera.distortion, (0, 5 - camera.distortion.size)).tolist()
        cameras.append(
            f'<camera active="1" model="Miqus Video" serial="{camera.name}">'
            f'<fov_video left="0" top="0" right="{camera.width - 1}" bottom="{camera.height - 1}"/>'
            f'<transform x="{x!r}" y="{y!r}" z="{z!r}" {turn}/>'
            f'<intrinsic focalLengthU="{camera.fx * 64!r}" focalLengthV="{camera.fy * 64!r}" skew="0" '
            f'centerPointU="{(camera.cx - 0.5) * 64!r}" centerPointV="{(camera.cy - 0.5) * 64!r}" '
            f'radialDistortion1="{k1!r}" radialDistortion2="{k2!r}" radialDistortion3="{k3!r}" '
            f'tangentalDistortion1="{p1!r}" tangentalDistortion2="{p2!r}"/></camera>'
        )
    marker = '<camera active="1" model="Oqus 7" serial="marker only"/>'
    return f'<?xml version="1.0"?><calibration><cameras>{"".join(cameras)}{marker}</cameras></calibration>'


def test_qualisys(rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "Calib.qca.txt"
    path.write_text(qualisys(rig))
    assert_same_images(read_rig(path), rig)


# Bad input ------------------------------------------------------------------------------------------------------------


def write_all(rig: Rig, folder: Path) -> dict[str, Path]:
    """One file in every text format."""
    for name in ("rig.json", "transforms.json", "model"):
        write_rig(rig, folder / name)
    (folder / "Calib.qca.txt").write_text(qualisys(rig))
    return {name: folder / name for name in ("rig.json", "transforms.json", "Calib.qca.txt")}


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_binary_cut_short_anywhere(rig: Rig, tmp_path: Path, name: str) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    write_rig(rig, tmp_path / "model")
    pycolmap.Reconstruction(tmp_path / "model").write_binary(tmp_path / "model")
    path = tmp_path / "model" / name
    whole = path.read_bytes()
    assert len(read_rig(tmp_path / "model")) == 3
    for length in range(0, len(whole) - 1, max(1, len(whole) // 40)):
        path.write_bytes(whole[:length])
        with refuses("camera_file.truncated", file=path, value=length):
            read_rig(tmp_path / "model")


def test_two_cameras_of_one_name(rig: Rig, tmp_path: Path) -> None:
    files = write_all(rig, tmp_path)
    for name in ("rig.json", "transforms.json", "Calib.qca.txt"):
        files[name].write_text(files[name].read_text().replace("cam01", "cam00"))
        with refuses("camera.duplicate_name", file=files[name], value="cam00"):
            read_rig(files[name])


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("transforms.json", "transform_matrix"),
        ("transforms.json", "fl_x"),
        ("transforms.json", "file_path"),
        ("Calib.qca.txt", "transform"),
        ("Calib.qca.txt", "focalLengthV"),
        ("Calib.qca.txt", "r23"),
    ],
)
def test_missing_key_is_named(rig: Rig, tmp_path: Path, name: str, key: str) -> None:
    path = write_all(rig, tmp_path)[name]
    text = path.read_text()
    path.write_text(text.replace(f'"{key}"', '"_x"') if name.endswith("json") else text.replace(key, "_x"))
    with refuses("camera.missing_key", file=path, key=key):
        read_rig(path)


def test_unknown_things_are_refused(rig: Rig, tmp_path: Path) -> None:
    with refuses("camera_file.missing", file=tmp_path / "nothing.json"):
        read_rig(tmp_path / "nothing.json")
    with refuses("camera_file.no_model", file=tmp_path):
        read_rig(tmp_path)
    path = tmp_path / "x.json"
    for text, code in (("hello", "syntax"), ("[1, 2]", "not_an_object"), ('{"a": 1}', "unknown_format")):
        path.write_text(text)
        with refuses(f"camera_file.{code}", file=path):
            read_rig(path)
    path.write_bytes(b"\xff\xfe\x00\x01")
    with refuses("camera_file.not_text", file=path):
        read_rig(path)
    path.write_text(json.dumps({"format": "v3studio-rig", "version": 99, "cameras": []}))
    with refuses("camera_file.wrong_version", file=path, value=99, expected=1):
        read_rig(path)
    with refuses("camera_file.unknown_extension", file=tmp_path / "rig.xyz", value=".xyz"):
        write_rig(rig, tmp_path / "rig.xyz")


def test_transforms_cannot_express_the_rational_model(rig: Rig, tmp_path: Path) -> None:
    from dataclasses import replace

    camera = replace(rig["cam00"], distortion=np.array([0.1, 0.1, 0, 0, 0.1, 0.2, 0, 0]))
    with refuses("camera_file.not_expressible", file=tmp_path / "transforms.json", value=8, camera="cam00"):
        write_rig(Rig((camera,)), tmp_path / "transforms.json")
    write_rig(Rig((camera,)), tmp_path / "model")
    assert_same_images(read_rig(tmp_path / "model"), Rig((camera,)))
