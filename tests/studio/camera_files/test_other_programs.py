"""Camera files of other programs, as written by them or as documented; then damaged in many ways."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.support.errors import refuses
from tests.support.rigs import BENT, POINTS, STRAIGHT, assert_same_images, on_circle, pose
from v3studio.studio.camera_files import CAMERA_FORMATS, CameraFormat, find_camera_files, read_rig, write_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.storage.mirror import DESCRIBING


@pytest.mark.parametrize("form", CAMERA_FORMATS, ids=lambda form: form.name)
def test_every_format_has_what_its_row_says(form: CameraFormat) -> None:
    wanted = {"read": True, "matches": not form.named, "write": bool(form.written), "is_in": form.is_folder}
    assert {name: hasattr(form.module, name) for name in wanted} == wanted
    assert {Path(name).suffix for name in (*form.usual, *form.per_camera)} <= DESCRIBING  # fetched from object storage


def easymocap(folder: Path) -> dict[str, np.ndarray]:
    """Files written with OpenCV's FileStorage, as in EasyMocap, and cv2.projectPoints's result in OpenCV's pixels."""
    intrinsics = cv2.FileStorage(str(folder / "intri.yml"), cv2.FILE_STORAGE_WRITE)
    extrinsics = cv2.FileStorage(str(folder / "extri.yml"), cv2.FILE_STORAGE_WRITE)
    expected = {}
    for storage in (intrinsics, extrinsics):
        storage.startWriteStruct("names", cv2.FileNode_SEQ)
        for name in ("01", "cam_b"):
            storage.write("", name)
        storage.endWriteStruct()
    for index, name in enumerate(("01", "cam_b")):
        K = np.array([[900.0 + index, 0, 311.5], [0, 905.0, 170.25], [0, 0, 1]])
        distortion = np.array([[-0.2, 0.1, 0.001, 0.002, -0.03]]) * index
        world = pose(on_circle(1.0 + index, 3.0, 0.3))
        vector = cv2.Rodrigues(world[:3, :3])[0]
        intrinsics.write(f"K_{name}", K)
        intrinsics.write(f"dist_{name}", distortion)
        extrinsics.write(f"R_{name}", vector)
        extrinsics.write(f"Rot_{name}", world[:3, :3])
        extrinsics.write(f"T_{name}", world[:3, 3:])
        expected[name] = cv2.projectPoints(POINTS, vector, world[:3, 3], K, distortion)[0].reshape(-1, 2) + 0.5
        (folder / "images" / name).mkdir(parents=True)
        Image.new("RGB", (640, 360)).save(folder / "images" / name / "000000.jpg")
    intrinsics.release()
    extrinsics.release()
    return expected


def test_easymocap_as_opencv_writes_it(tmp_path: Path) -> None:
    expected = easymocap(tmp_path)
    for path in (tmp_path / "intri.yml", tmp_path / "extri.yml", tmp_path):
        rig = read_rig(path)
        assert rig.names == ("01", "cam_b")
        for camera in rig:
            assert (camera.width, camera.height) == (640, 360)
            np.testing.assert_allclose(camera.project(POINTS)[0], expected[camera.name], atol=1e-6)


def test_what_we_write_opencv_reads(tmp_path: Path) -> None:
    write_rig(BENT, tmp_path / "intri.yml")
    intrinsics = cv2.FileStorage(str(tmp_path / "intri.yml"), cv2.FILE_STORAGE_READ)
    extrinsics = cv2.FileStorage(str(tmp_path / "extri.yml"), cv2.FILE_STORAGE_READ)
    for camera in BENT:
        stored = [extrinsics.getNode(f"{key}_{camera.name}").mat() for key in "RT"]
        stored += [intrinsics.getNode(f"{key}_{camera.name}").mat() for key in ("K", "dist")]
        pixels, _ = cv2.projectPoints(POINTS, *stored)
        np.testing.assert_allclose(pixels.reshape(-1, 2) + 0.5, camera.project(POINTS)[0], atol=1e-6)


# Two cameras of the calibration in Pose2Sim's demonstration, as written by the program (BSD-3-Clause)
POSE2SIM = """[cam_01]
name = "cam_01"
size = [ 1088.0, 1920.0]
matrix = [ [ 1681.244873046875, 0.0, 532.97369384375], [ 0.0, 1681.075439453125, 948.137390140625], [ 0.0, 0.0, 1.0]]
distortions = [ -0.000721609375, 0.002187234375, 9.5e-06, 1.078125e-05]
rotation = [ 1.6882754799999993, 1.0483220499999997, -0.41955852000000016]
translation = [ 0.3211048899999996, 0.9563320600000009, 2.8907130499999996]
fisheye = false

[cam_03]
name = "cam_03"
size = [ 1088.0, 1920.0]
matrix = [ [ 1681.598388671875, 0.0, 513.20837403125], [ 0.0, 1681.509887703125, 955.005126953125], [ 0.0, 0.0, 1.0]]
distortions = [ -0.000729765625, 0.00215034375, -8.46875e-06, -8.078125e-06]
rotation = [ 0.8109654899999995, -2.1972129299999996, 1.3760277799999996]
translation = [ -0.7934803899999995, 0.32283594000000126, 4.353514870000001]
fisheye = false

[metadata]
adjusted = false
error = 0.0
"""

# Two cameras of a sample session of Caliscope, as written by the program (BSD-2-Clause)
CALISCOPE = """[cameras.0]
cam_id =0
rotation_count = 0
error = 0.541
exposure = -7
grid_count = 39
ignore = false
size = [1280, 720]
matrix = [[903.550124089999, 0.0, 618.3086297620227], [0.0, 907.8788668762852, 394.213230569746], [0.0, 0.0, 1.0]]
distortions = [-0.3320992998866297, 0.04641968621160267, -0.004295771569519648, 0.004113240100199701, 0.0665682301495769]
translation = [0.17125994082321383, -0.03234536459937444, 1.208386461814154]
rotation = [[-0.7070716153979968, 0.5639880775931625, -0.42657611165094056], [0.2085224389078015, -0.4101235314731174, -0.8878722213268985], [-0.6756982486068828, -0.716739936981879, 0.17238253845677978]]

[cameras.2]
cam_id =2
ignore = false
size = [1280, 720]
matrix = [[650.801908585405, 0.0, 647.3391995946636], [0.0, 654.4652152401134, 392.19105369229516], [0.0, 0.0, 1.0]]
distortions = [0.18039827881295703, -0.25603810782846814, 0.003209768150056599, 0.0022377311012611876, 0.12402327219756225]
translation = [-0.23847883889454596, 0.18461082840729343, 1.1682943900670697]
rotation = [[-0.23474520574867236, 0.8701987696136831, -0.43318447541531985], [0.39180150339004355, -0.32313146123239816, -0.861439284397407], [-0.8895989379036572, -0.3719410707688081, -0.26509162483193865]]

[cameras.3]
ignore = true
"""  # noqa: E501


@pytest.mark.parametrize(("text", "names"), [(POSE2SIM, ("cam_01", "cam_03")), (CALISCOPE, ("cam_0", "cam_2"))])
def test_toml_projects_as_the_programs_do(tmp_path: Path, text: str, names: tuple[str, ...]) -> None:
    """Both programs pass the numbers to cv2.projectPoints, whose pixel coordinates are smaller than ours by 0.5."""
    import tomllib

    path = tmp_path / "Calib_scene.toml"
    path.write_text(text)
    rig = read_rig(path)
    assert rig.names == names
    tables = tomllib.loads(text)
    tables = tables.get("cameras", tables)
    used = [table for table in tables.values() if "matrix" in table]
    for camera, table in zip(rig, used, strict=True):
        vector = np.array(table["rotation"])
        vector = cv2.Rodrigues(vector)[0] if vector.shape == (3, 3) else vector
        arguments = (np.array(table[key]) for key in ("translation", "matrix", "distortions"))
        pixels, _ = cv2.projectPoints(0.3 * POINTS, vector, *arguments)
        np.testing.assert_allclose(camera.project(0.3 * POINTS)[0], pixels.reshape(-1, 2) + 0.5, atol=1e-6)


# One row of the sample that comes with RealityScan, and the angles as interpreted by importers of other programs
REALITYSCAN = """#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2
a.jpg,{c0!r},{c1!r},{c2!r},{heading!r},{pitch!r},{roll!r},{f!r},{px!r},{py!r},{k1!r},{k2!r},{k3!r},{k4!r},0,0
"""


@pytest.mark.parametrize("k4", [0.0, 0.01])
def test_realityscan(tmp_path: Path, k4: float) -> None:
    """The published camera model, implemented here and applied to points."""
    heading, pitch, roll, f = 170.35, 85.19, -22.75, 24.0
    center = np.array([0.4, 3.1, 0.2])
    k = np.array([0.003, -0.02, 0.004, k4])
    px, py = -9.48e-4, 2.4e-3
    text = REALITYSCAN.format(
        c0=0.4, c1=3.1, c2=0.2, heading=heading, pitch=pitch, roll=roll, f=f, px=px, py=py,
        k1=0.003, k2=-0.02, k3=0.004, k4=k4,
    )  # fmt: skip
    (tmp_path / "export.csv").write_text(text)
    Image.new("RGB", (800, 600)).save(tmp_path / "a.jpg")
    # heading rotates clockwise about the up axis, pitch raises the view from straight down, roll is about the view axis
    turns = [
        cv2.Rodrigues(np.radians(angle) * axis)[0]
        for angle, axis in zip((-heading, pitch, roll), np.eye(3)[[2, 0, 1]], strict=True)
    ]
    local = (POINTS - center) @ (turns[0] @ turns[1] @ turns[2])
    x, y = local[:, 0] / -local[:, 2], -local[:, 1] / -local[:, 2]  # x right, y up, looking along -z
    s = x * x + y * y
    factor = 1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))
    expected = np.column_stack([x * factor, y * factor]) * f * 800 / 36 + [400 + px * 800, 300 + py * 800]
    camera = read_rig(tmp_path / "export.csv")["a"]
    inside = (local[:, 2] < -1) & ((expected > 0) & (expected < [800, 600])).all(1)
    assert inside.sum() > 30
    np.testing.assert_allclose(camera.project(POINTS)[0][inside], expected[inside], atol=0.05 if k4 else 1e-6)


METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1">
      <sensor id="0" label="M3M (12.29mm)" type="frame">
        <resolution width="5280" height="3956"/>
        <property name="pixel_width" value="0.00335820"/>
        <property name="focal_length" value="12.28999999"/>
        <calibration type="frame" class="adjusted">
          <resolution width="5280" height="3956"/>
          <f>3705.4728792737214</f>
          <cx>11.6738523909</cx>
          <cy>-27.7497969199</cy>
          <b1>0.5262024073</b1>
          <k1>-0.0919367147</k1>
          <k2>-0.0762807468</k2>
          <k3>0.1162639394</k3>
          {k4}
          <p1>-0.0003134847</p1>
          <p2>0.0001164035</p2>
        </calibration>
      </sensor>
    </sensors>
    <components next_id="1" active_id="0">
      <component id="0" label="Component 1">
        <transform>
          <rotation locked="true">0.8710699454 0.3070967021 -0.3833128821 -0.4909742007 0.5658364395 -0.6623997719 0.0134716110 0.7651932691 0.6436596744</rotation>
          <translation locked="true">-24.4 -42.5 40.2</translation>
          <scale locked="true">12.354192447331316</scale>
        </transform>
      </component>
    </components>
    <cameras next_id="816" next_group_id="2">
      <group id="0" label="Group 1" type="folder">
        <camera id="0" sensor_id="0" component_id="0" label="nadir/000001-01_00001.JPG">
          <transform>-0.99988146 -0.00872749 0.01268391 7.04224697 -0.00842932 0.99969124 0.02337453 7.05403071 -0.01288400 0.02326485 -0.99964631 0.43561421 0 0 0 1</transform>
          <orientation>1</orientation>
        </camera>
        <camera id="1" sensor_id="0" label="not aligned"/>
      </group>
    </cameras>
  </chunk>
</document>
"""  # noqa: E501


@pytest.mark.parametrize(("k4", "kind"), [(0.0, "frame"), (-0.0761413904, "frame"), (-0.0761413904, "fisheye")])
def test_metashape(tmp_path: Path, k4: float, kind: str) -> None:
    """A file written by the program (shortened); the manual's equations are implemented here."""
    path = metashape_file(tmp_path, f"<k4>{k4}</k4>" if k4 else "")
    path.write_text(path.read_text().replace('type="frame"', f'type="{kind}"'))
    rig = read_rig(path)
    assert rig.names == ("000001-01_00001",)
    camera = rig["000001-01_00001"]
    places = METASHAPE.split("<components")[1]
    matched = [re.search(rf"<{tag}[^>]*>([-\d. e]+)</", places) for tag in ("rotation", "translation", "transform")]
    words = [np.array(part[1].split(), float) for part in matched if part is not None]
    turn, shift, pose = words[0].reshape(3, 3), words[1], words[2].reshape(4, 4)
    rng = np.random.default_rng(0)
    local = np.column_stack([rng.uniform(-0.7, 0.7, (200, 1)), rng.uniform(-0.5, 0.5, (200, 1)), np.ones(200)]) * 6
    chunk = local @ pose[:3, :3].T + pose[:3, 3]
    world = 12.354192447331316 * chunk @ turn.T + shift
    x, y = local[:, 0] / 6, local[:, 1] / 6
    if kind == "fisheye":
        x, y = (np.arctan(np.hypot(x, y)) / np.hypot(x, y) * part for part in (x, y))
    s = x * x + y * y
    k = (-0.0919367147, -0.0762807468, 0.1162639394, k4)
    p1, p2 = -0.0003134847, 0.0001164035
    factor = 1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))
    bent_x = x * factor + p1 * (s + 2 * x * x) + 2 * p2 * x * y
    bent_y = y * factor + p2 * (s + 2 * y * y) + 2 * p1 * x * y
    f, b1 = 3705.4728792737214, 0.5262024073
    expected = np.column_stack([5280 / 2 + 11.6738523909 + bent_x * (f + b1), 3956 / 2 - 27.7497969199 + bent_y * f])
    # rotations in the file have eight digits
    np.testing.assert_allclose(camera.project(world)[0], expected, atol=0.2 if k4 and kind == "frame" else 5e-4)


def test_folders_of_frames_with_transforms(tmp_path: Path) -> None:
    """VideoGS: 0/transforms.json, 1/transforms.json, ...; the cameras of the first frame are used."""
    for frame in (0, 1, 10):
        write_rig(STRAIGHT, tmp_path / str(frame) / "transforms.json")
    assert_same_images(read_rig(tmp_path), STRAIGHT)


@pytest.mark.parametrize(
    "name",
    ["Calib_scene.toml", "camera_array.toml", "intri.yml", "calibration.csv", "rig.json", "transforms.json", "sparse"],
)
def test_what_is_written_is_read_again(tmp_path: Path, name: str) -> None:
    rig = STRAIGHT if name == "calibration.csv" else BENT
    write_rig(rig, tmp_path / name)
    assert_same_images(read_rig(tmp_path / name), rig)
    assert not [path for path in tmp_path.rglob("*") if ".partial" in path.name]


def test_actorshq_cannot_express_distortion(tmp_path: Path) -> None:
    path = tmp_path / "calibration.csv"
    with refuses("camera_file.not_expressible", file=path, camera="cam01"):
        write_rig(BENT, path)
    assert not path.exists()


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


def test_transforms_json_with_opencv_axes_and_matrix(tmp_path: Path) -> None:
    """NeuS2's flavor: from_na, and an intrinsic matrix in each frame."""
    camera = BENT["cam00"]
    matrix = np.eye(4)
    matrix[:3, :3] = camera.K
    back = np.linalg.inv(camera.world_to_camera).tolist()
    frame = {"file_path": "images/cam00.png", "transform_matrix": back, "intrinsic_matrix": matrix.tolist()}
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"from_na": True, "w": 640, "h": 360, "frames": [frame]}))
    assert_same_images(read_rig(path), BENT.subset(["cam00"]))


def test_transforms_size_from_the_image(tmp_path: Path) -> None:
    (tmp_path / "train").mkdir()
    Image.new("RGB", (64, 48)).save(tmp_path / "train" / "r_0.png")
    frame = {"file_path": "./train/r_0", "transform_matrix": np.eye(4).tolist()}
    path = tmp_path / "transforms_train.json"
    path.write_text(json.dumps({"camera_angle_x": 0.6, "frames": [frame]}))
    camera = read_rig(path)["r_0"]
    assert (camera.width, camera.height) == (64, 48)
    assert camera.fx == pytest.approx(32 / np.tan(0.3))


def qualisys_file(folder: Path) -> Path:
    """Qualisys Track Manager's file of BENT: millimeters, y up, z back, units of 1/64 pixel, inclusive bounds."""
    cameras = []
    for camera in BENT:
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
    text = f'<?xml version="1.0"?><calibration><cameras>{"".join(cameras)}{marker}</cameras></calibration>'
    (folder / "Calib.qca.txt").write_text(text)
    return folder / "Calib.qca.txt"


def test_qualisys(tmp_path: Path) -> None:
    path = qualisys_file(tmp_path)
    assert_same_images(read_rig(path), BENT)
    path.write_text(path.read_text().replace("Miqus Video", "Miqus Hybrid", 2))  # which track markers, too
    rig = read_rig(path)
    assert_same_images(rig, BENT)
    assert any("marker only" in note for note in rig.notes)


def test_distortion_of_nerfstudio_in_a_list(tmp_path: Path) -> None:
    top = {"distortion_params": [0.1, 0.02, 0.003, 0.0, 0.004, 0.005]}
    rig = read_rig(transforms_entries(tmp_path, "transforms.json", {"cam00": ["cam00.png"]}, **top))
    np.testing.assert_allclose(rig["cam00"].distortion, [0.1, 0.02, 0.004, 0.005, 0.003])


def metashape_file(folder: Path, k4: str = "") -> Path:
    (folder / "cameras.xml").write_text(METASHAPE.format(k4=k4))
    return folder / "cameras.xml"


def realityscan_file(folder: Path) -> Path:
    values = {"c0": 0.5, "c1": 1.5, "c2": 2.5, "heading": 7.5, "pitch": 8.5, "roll": 9.5, "f": 24.5, "px": 0.5}
    values |= {"py": 0.25, "k1": 0.125, "k2": 0.0, "k3": 0.0, "k4": 0.0}
    (folder / "export.csv").write_text(REALITYSCAN.format(**values))
    Image.new("RGB", (80, 60)).save(folder / "a.jpg")
    return folder / "export.csv"


def written(name: str, rig: Rig) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        write_rig(rig, folder / name)
        return folder / name

    return make


TOML, YML, CSV = written("Calib.toml", BENT), written("intri.yml", BENT), written("calibration.csv", STRAIGHT)


@pytest.mark.parametrize(
    ("make", "old", "new", "code", "fields"),
    [
        (TOML, "330.75", "nan", "camera.not_finite", {"camera": "cam00", "key": "matrix", "index": "[0][2]"}),
        (TOML, "translation", "x", "camera.unknown_key", {"camera": "cam00", "key": "x"}),
        (TOML, '["cam01"]', '["cam00"]', "camera_file.syntax", {}),
        (TOML, 'name = "cam01"', 'name = "cam00"', "camera.duplicate_name", {"camera": "cam00"}),
        (TOML, "size = [640.0, 360.0]", "size = [640.0]", "camera.wrong_shape",
         {"camera": "cam00", "key": "size", "value": [1], "expected": [[2]]}),
        (YML, "330.75", ".Nan", "camera.not_finite", {"camera": "cam00", "key": "K_cam00", "index": "[0][2]"}),
        (YML, "K_cam01", "x", "camera.missing_key", {"camera": "cam01", "key": "K"}),
        (YML, "dist_cam01", "bend_cam01", "camera.unknown_key", {"camera": "cam01", "key": "bend_cam01"}),
        (YML, '"cam01"', '"cam00"', "camera.duplicate_name", {"camera": "cam00"}),
        (YML, "W_cam02: 640", "", "camera.missing_key", {"camera": "cam02", "key": "width"}),
        (CSV, "fx,", "gx,", "camera_file.missing_column", {"key": "fx"}),
        (CSV, "cam01", "cam00", "camera.duplicate_name", {"camera": "cam00"}),
        (CSV, ",640,", ",many,", "camera.not_a_number", {"camera": "cam00", "key": "w", "value": "many"}),
        (written("transforms.json", BENT), '"file_path"', '"_x"', "camera.missing_key", {"key": "file_path"}),
        *((written("transforms.json", BENT), f'"{key}"', '"_x"', "camera.unknown_key", {"camera": "cam00", "key": "_x"})
          for key in ("transform_matrix", "fl_x")),
        *((qualisys_file, key, "_x", "camera.missing_key", {"key": key})
          for key in ("transform", "focalLengthV", "r23")),
        *((make, "cam01", "cam00", "camera.duplicate_name", {"value": "cam00"})
          for make in (written("rig.json", BENT), written("transforms.json", BENT), qualisys_file)),
        (metashape_file, "3705.4728792737214", "nan", "camera.not_finite", {"camera": "000001-01_00001", "key": "f"}),
        (metashape_file, "<p1>", "<k5>0.1</k5><p1>", "camera.unknown_key", {"key": "k5"}),
        (metashape_file, "<cx>11.6738523909</cx>", "<cx/>", "camera.missing_key", {"key": "cx"}),
        (metashape_file, "7.04224697", "", "camera.wrong_shape",
         {"key": "transform", "value": [15], "expected": [[16]]}),
        (metashape_file, 'sensor_id="0" component', 'sensor_id="7" component', "camera.unknown_sensor", {"value": "7"}),
        (metashape_file, 'type="frame">\n        <res', 'type="spherical">\n        <res', "camera.lens_model",
         {"value": "spherical"}),
        (metashape_file, "</cameras>", "", "camera_file.syntax", {}),
        (realityscan_file, "24.5", "nan", "camera.not_finite", {"camera": "a", "key": "f"}),
        (realityscan_file, "heading", "h", "camera_file.missing_column", {"key": "heading"}),
        (realityscan_file, "0.0,0,0\n", "0.0,0\n", "camera_file.truncated", {"row": 1, "value": 15, "expected": 16}),
        (realityscan_file, "a.jpg", "b.jpg", "camera.size_unknown", {"camera": "b", "value": "b.jpg"}),
        (realityscan_file, "0.0,0,0\n", "0.0,0.1,0\n", "camera.lens_model", {"value": [0.1, 0.0]}),
    ],
)  # fmt: skip
def test_broken_files_name_file_camera_and_value(
    tmp_path: Path, make: Callable[[Path], Path], old: str, new: str, code: str, fields: dict[str, Any]
) -> None:
    path = make(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with refuses(code, file=tmp_path if make is YML else path, **fields) as caught:
        read_rig(path)
    assert "\n" not in str(caught.value)


def test_broken_files_of_easymocap(tmp_path: Path) -> None:
    write_rig(BENT, tmp_path / "intri.yml")
    path, intrinsics = tmp_path / "extri.yml", tmp_path / "intri.yml"
    whole = path.read_text()
    for change, fields in (
        (whole.replace("T_cam01", "x"), {"camera": "cam01", "key": "translation"}),
        (whole.replace("R_cam02", "x").replace("Rot_cam02", "y"), {"camera": "cam02", "key": "rotation"}),
    ):
        path.write_text(change)
        with refuses("camera.missing_key", file=tmp_path, **fields):
            read_rig(tmp_path)
    intrinsics.write_text(intrinsics.read_text().replace("names:", "x:", 1))
    with refuses("camera_file.no_cameras", file=intrinsics):
        read_rig(intrinsics)
    path.unlink()
    with refuses("camera_file.missing", file=path):
        read_rig(tmp_path)


def test_broken_rerf(tmp_path: Path) -> None:
    """Its intact files are read in tests/studio/capture/test_layouts.py."""
    pose_file, intrinsics_file = tmp_path / "CamPose.inf", tmp_path / "Intrinsic.inf"
    poses = "".join(f"0 0 1 1 0 0 0 1 0 {number}.5 0 3\n" for number in range(3))
    intrinsics = "".join(f"{number}\n500.5 0 320.25\n0 510.5 178.5\n0 0 1\n\n" for number in range(3))
    intrinsics_file.write_text(intrinsics)
    pose_file.write_text(poses.replace("1.5", "nan"))
    with refuses("camera.not_finite", file=pose_file, camera="1", key="line 2", index="[9]"):
        read_rig(tmp_path)
    pose_file.write_text(poses.splitlines()[0])
    with refuses("camera_file.camera_count", file=intrinsics_file, value=3, expected=1):
        read_rig(tmp_path)
    pose_file.write_text(poses)
    intrinsics_file.write_text(intrinsics.rsplit("0 0 1", 1)[0])
    with refuses("camera_file.truncated", file=intrinsics_file, value=6, expected=9):
        read_rig(tmp_path)


def test_metashape_slaves_are_placed_from_their_master(tmp_path: Path) -> None:
    """The offset is in the master's axes and in units of the chunk, whose scale is 12.35; dots are no extensions."""
    turn = cv2.Rodrigues(np.array([0.1, -0.2, 0.05]))[0]
    slave = METASHAPE.format(k4="").split('<sensors next_id="1">')[1].split("</sensors>")[0]
    offset = f"<rotation>{' '.join(map(str, turn.ravel()))}</rotation><location>0.2 0.01 -0.03</location></sensor>"
    slave = slave.replace('sensor id="0"', 'sensor id="1" master_id="0"').replace("</sensor>", offset)
    text = METASHAPE.format(k4="").replace("</sensors>", f"{slave}</sensors>")
    text = text.replace("nadir/000001-01_00001.JPG", "rig.0.left")
    entry = '<camera id="2" sensor_id="1" component_id="0" master_id="0" label="rig.0.right"/>'
    (tmp_path / "cameras.xml").write_text(text.replace("</group>", f"{entry}</group>"))
    rig = read_rig(tmp_path / "cameras.xml")
    assert rig.names == ("rig.0.left", "rig.0.right")
    assert rig.left_out == ("not aligned",)
    assert any("'rig.0.right'" in note for note in rig.notes)
    assert any("12.35" in note for note in rig.notes)
    left, right = rig
    inside = (right.center - left.center) @ left.rotation.T
    np.testing.assert_allclose(inside, 12.354192447331316 * np.array([0.2, 0.01, -0.03]), atol=1e-6)
    np.testing.assert_allclose(left.rotation.T @ turn, right.rotation.T, atol=1e-6)


def test_metashape_with_a_disabled_camera_and_two_chunks(tmp_path: Path) -> None:
    path = metashape_file(tmp_path)
    text = path.read_text()
    path.write_text(re.sub(r"<chunk.*</chunk>", r"\g<0>\g<0>", text, flags=re.DOTALL))
    assert any("2 chunks" in note for note in read_rig(path).notes)
    path.write_text(text.replace('label="nadir', 'enabled="false" label="nadir'))
    with refuses("camera_file.no_cameras", file=path):
        read_rig(path)


def test_realityscan_with_semicolons_and_rows_without_images(tmp_path: Path) -> None:
    path = realityscan_file(tmp_path)
    expected = read_rig(path)
    text = path.read_text()
    row = text.splitlines()[1]
    path.write_text(text + row.replace("a.jpg", "missing.jpg") + "\n")
    rig = read_rig(path)
    assert_same_images(rig, expected)
    assert any("'missing'" in note for note in rig.notes)
    path.write_text(text.replace(",", ";").replace(".", ",").replace("a,jpg", "a.jpg"))
    assert_same_images(read_rig(path), expected)


@pytest.mark.parametrize("value", ["0.3", "x"])
def test_columns_that_are_not_known(tmp_path: Path, value: str) -> None:
    write_rig(STRAIGHT, tmp_path / "calibration.csv")
    path = tmp_path / "calibration.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([f"{lines[0]},k1", *(f"{line},{value}" for line in lines[1:])]))
    with refuses("camera_file.unknown_column", file=path, key="k1"):
        read_rig(path)
    path.write_text("\n".join([f"{lines[0]},k1", *(f"{line},0.0" for line in lines[1:])]))
    assert_same_images(read_rig(path), STRAIGHT)


def transforms_entries(folder: Path, name: str, paths: dict[str, list[str]], **top: object) -> Path:
    """A file with the given paths for each camera of STRAIGHT."""
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    frames = []
    for camera, files in paths.items():
        back = (np.linalg.inv(STRAIGHT[camera].world_to_camera) @ flip).tolist()
        own = STRAIGHT[camera]
        values = {"fl_x": own.fx, "fl_y": own.fy, "cx": own.cx, "cy": own.cy, "w": 640, "h": 360}
        frames += [{"file_path": file, "transform_matrix": back, "time": t, **values} for t, file in enumerate(files)]
    (folder / name).write_text(json.dumps({**top, "frames": frames}))
    return folder / name


@pytest.mark.parametrize(
    "form",
    ["images/{c}/{t:03d}.png", "{t:04d}/{c}.png", "images/{c}_{t:04d}.png", "images/{c}_frame{t}.jpg", "{c}/rgb/{t}",
     "frame{t:04d}_{c}.png", "images/{c}.{t:04d}.png"],
)  # fmt: skip
def test_transforms_with_an_entry_per_camera_and_time(tmp_path: Path, form: str) -> None:
    paths = {name: [form.format(c=name, t=t) for t in range(3)] for name in STRAIGHT.names}
    rig = read_rig(transforms_entries(tmp_path, "transforms.json", paths))
    assert_same_images(rig, STRAIGHT)
    assert any("9 entries" in note for note in rig.notes)


def test_transforms_in_parts_for_training_and_test(tmp_path: Path) -> None:
    train = {name: [f"images/{name}/0"] for name in ("cam00", "cam01")}
    path = transforms_entries(tmp_path, "transforms_train.json", train)
    transforms_entries(tmp_path, "transforms_test.json", {"cam02": ["images/cam02/0"]})
    for part in (path, tmp_path, tmp_path / "transforms_test.json"):
        rig = read_rig(part)
        assert_same_images(rig, STRAIGHT)
        assert rig.for_evaluation == ("cam02",)


def test_what_is_unlikely_is_noted_once(tmp_path: Path) -> None:
    """A folder is given, too, of which the only camera file is read."""
    camera = STRAIGHT["cam00"]
    write_rig(Rig((replace(camera, K=camera.K + np.eye(3, k=2) * 1000.0),)), tmp_path / "rig.json")
    assert find_camera_files(tmp_path) == [tmp_path / "rig.json"]
    assert read_rig(tmp_path).notes == read_rig(tmp_path / "rig.json").notes != ()


def test_unknown_things_are_refused(tmp_path: Path) -> None:
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
        write_rig(BENT, tmp_path / "rig.xyz")


@pytest.mark.parametrize(
    "data", [b"PK\3\4" + bytes(range(256)), b"\x80\4" + bytes(range(256)), b"Kaydara FBX Binary \0" + bytes(range(256))]
)
def test_binary_files_of_other_programs_are_named(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "cameras.dat").write_bytes(data)
    with refuses("camera_file.unsupported_kind", file=tmp_path / "cameras.dat"):
        read_rig(tmp_path / "cameras.dat")


def test_json_of_other_programs_with_a_version_of_its_own(tmp_path: Path) -> None:
    """A list, and an object by name, beside keys that say nothing about cameras."""
    entries = {
        camera.name: {
            "K": camera.K.tolist(), "R": camera.rotation.tolist(), "t": camera.translation.tolist(),
            "dist": camera.distortion.tolist(), "width": camera.width, "height": camera.height,
        }
        for camera in BENT
    }  # fmt: skip
    listed = [{"name": name, **values} for name, values in entries.items()]
    for cameras in (listed, entries):
        (tmp_path / "a.json").write_text(json.dumps({"version": "2.1", "format": "opencv", "cameras": cameras}))
        assert read_rig(tmp_path / "a.json").names == BENT.names


@pytest.mark.parametrize("name", ["calibration.toml", "monday_camera_calibration.toml", "result of a program.toml"])
def test_files_of_any_name_with_cameras_are_found(tmp_path: Path, name: str) -> None:
    write_rig(BENT, tmp_path / name)
    (tmp_path / "notes.json").write_text('{"version": 3, "cameras": ["left", "right"]}')
    assert find_camera_files(tmp_path) == [tmp_path / name]


def test_sizes_of_the_capture(tmp_path: Path) -> None:
    """Where the camera file is not next to the footage, whose cameras have the same numbers."""
    write_rig(BENT, tmp_path / "intri.yml")
    text = (tmp_path / "intri.yml").read_text()
    (tmp_path / "intri.yml").write_text("\n".join(line for line in text.splitlines() if line[:2] not in ("H_", "W_")))
    with refuses("camera.size_unknown"):
        read_rig(tmp_path)
    sizes = {f"view{int(camera.name[3:])}": (camera.width, camera.height) for camera in BENT}
    assert_same_images(read_rig(tmp_path, sizes), BENT)


def test_transforms_cannot_express_the_rational_model(tmp_path: Path) -> None:
    camera = replace(BENT["cam00"], distortion=np.array([0.1, 0.1, 0, 0, 0.1, 0.2, 0, 0]))
    with refuses("camera_file.not_expressible", file=tmp_path / "transforms.json", value=8, camera="cam00"):
        write_rig(Rig((camera,)), tmp_path / "transforms.json")
    write_rig(Rig((camera,)), tmp_path / "model")
    assert_same_images(read_rig(tmp_path / "model"), Rig((camera,)))
