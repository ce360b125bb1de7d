"""Camera files of many programs, in which keys are renamed, added and dropped: the same cameras, or an error."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.errors import refuses
from tests.support.rigs import on_circle, pose
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject

BEND = [-0.3, 0.1, 0.001, -0.002, 0.02]
POINTS = np.random.default_rng(5).uniform(-0.3, 0.3, (20, 3))
K = [[700.0, 0, 320.0], [0, 710.0, 180.0], [0, 0, 1]]
NAMES = ("cam0", "cam1", "cam2")
POSES = [pose(on_circle(0.3 + 1.7 * index, 3.0, 0.4)) for index in range(3)]


def projected(world: np.ndarray, bend: list[float], corner: bool) -> np.ndarray:
    """The pixels that OpenCV computes, with the origin at the image corner."""
    pixels = cv2.projectPoints(POINTS, cv2.Rodrigues(world[:3, :3])[0], world[:3, 3], np.array(K), np.array(bend))[0]
    return pixels.reshape(-1, 2) + (0 if corner else 0.5)


def assert_projects(rig: Rig, bend: list[float], corner: bool, names: tuple[str, ...] = NAMES) -> None:
    assert rig.names == names
    for camera, world in zip(rig, POSES, strict=False):
        assert (camera.width, camera.height) == (640, 360)
        np.testing.assert_allclose(camera.project(POINTS)[0], projected(world, bend, corner), atol=1e-5)


def entry(world: np.ndarray) -> JsonObject:
    return {"width": 640, "height": 360, "K": K, "R": world[:3, :3].tolist(), "t": world[:3, 3].tolist()}


def cameras_json(folder: Path, change: Callable[[JsonObject], JsonObject]) -> Path:
    entries = [change({"name": name, **entry(world), "dist": BEND}) for name, world in zip(NAMES, POSES, strict=True)]
    (folder / "cameras.json").write_text(json.dumps({"cameras": entries}))
    return folder / "cameras.json"


def per_camera(folder: Path, change: Callable[[JsonObject], JsonObject]) -> Path:
    cameras = {}
    for name, world in zip(NAMES, POSES, strict=True):
        values = {"K": K, "R": world[:3, :3].tolist(), "T": world[:3, 3].tolist(), "imgSize": [640, 360]}
        cameras[name] = change({**values, "distCoeff": BEND})
    (folder / "calibration.json").write_text(json.dumps(cameras))
    return folder / "calibration.json"


def toml(folder: Path, change: Callable[[JsonObject], JsonObject]) -> Path:
    text = ""
    for name, world in zip(NAMES, POSES, strict=True):
        vector = cv2.Rodrigues(world[:3, :3])[0].ravel().tolist()
        table = {
            "name": name, "size": [640, 360], "matrix": K, "distortions": BEND, "rotation": vector,
            "translation": world[:3, 3].tolist(), "fisheye": False,
        }  # fmt: skip
        text += f"[{name}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in change(table).items())
    (folder / "Calib.toml").write_text(text)
    return folder / "Calib.toml"


def panoptic(folder: Path, change: Callable[[JsonObject], JsonObject]) -> Path:
    """Centimeters, and a column for t."""
    entries = []
    for index, (name, world) in enumerate(zip(NAMES, POSES, strict=True)):
        camera = {
            "name": name, "type": "hd", "resolution": [640, 360], "panel": 0, "node": index, "K": K, "distCoef": BEND,
            "R": world[:3, :3].tolist(), "t": (100 * world[:3, 3:]).tolist(),
        }  # fmt: skip
        entries.append(change(camera))
    (folder / "calibration_170407.json").write_text(json.dumps({"calibDataSource": "x", "cameras": entries}))
    return folder / "calibration_170407.json"


def opencv(folder: Path, change: Callable[[JsonObject], JsonObject]) -> Path:
    for name, world in zip(NAMES, POSES, strict=True):
        (folder / name).mkdir(exist_ok=True)
        values = {
            "image_width": 640, "image_height": 360, "camera_matrix": K, "distortion_coefficients": [BEND],
            "rotation": world[:3, :3].tolist(), "translation": world[:3, 3:].tolist(),
        }  # fmt: skip
        storage = cv2.FileStorage(str(folder / name / "c.yml"), cv2.FILE_STORAGE_WRITE)
        for key, value in change(values).items():
            storage.write(key, np.array(value, np.float64) if isinstance(value, list) else value)
        storage.release()
    return folder / "{camera}" / "c.yml"


def transforms(folder: Path, change: Callable[[JsonObject], JsonObject]) -> Path:
    frames = []
    for name, world in zip(NAMES, POSES, strict=True):
        back = np.linalg.inv(world) @ np.diag([1, -1, -1, 1])
        frames.append({"file_path": f"images/{name}.png", "transform_matrix": back.tolist()})
    top = {"fl_x": 700.0, "fl_y": 710.0, "cx": 320.0, "cy": 180.0, "w": 640, "h": 360}
    top |= dict(zip(("k1", "k2", "p1", "p2", "k3"), BEND, strict=True))
    (folder / "transforms.json").write_text(json.dumps(change({**top, "frames": frames})))
    return folder / "transforms.json"


FORMS = {
    "cameras.json": (cameras_json, True), "calibration.json": (per_camera, False), "toml": (toml, False),
    "panoptic": (panoptic, False), "opencv": (opencv, False), "transforms": (transforms, True),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_read_as_opencv_projects(tmp_path: Path, form: str) -> None:
    make, corner = FORMS[form]
    assert_projects(read_rig(make(tmp_path, lambda values: values)), BEND, corner)


@pytest.mark.parametrize(
    "key",
    ["dist", "D", "distCoef", "distCoeff", "distortion", "dist_coeffs", "distortion_vector", "kc", "Dist-Coeffs",
     "distortions", "distortion_coefficients", "DistortionCoeffs"],
)  # fmt: skip
def test_names_of_the_distortion(tmp_path: Path, key: str) -> None:
    def rename(values: JsonObject) -> JsonObject:
        return {key if name in ("dist", "distCoeff", "distortions") else name: value for name, value in values.items()}

    assert_projects(read_rig(cameras_json(tmp_path, rename)), BEND, corner=True)
    assert_projects(read_rig(per_camera(tmp_path, rename)), BEND, corner=False)
    assert_projects(read_rig(toml(tmp_path, rename)), BEND, corner=False)


MEANING = {
    "R": "rotation", "t": "translation", "T": "translation", "matrix": "K", "camera_matrix": "K", "fl_x": "fx",
    "distortions": "distortion", "distCoeff": "distortion", "dist": "distortion",
    "image_width": "width", "image_height": "height", "w": "width", "h": "height", "distCoef": "distortion",
    "distortion_coefficients": "distortion",
}  # fmt: skip
"""Errors about missing keys use these names."""


@pytest.mark.parametrize("form", FORMS)
@given(data=st.data())
@settings(max_examples=12, deadline=None)
def test_changed_keys_are_read_or_named(
    tmp_path_factory: pytest.TempPathFactory, form: str, data: st.DataObject
) -> None:
    make, corner = FORMS[form]
    words = st.from_regex("[a-z_][a-z_0-9]{0,7}", fullmatch=True) | st.sampled_from(["D", "R", "size", "k1", "w2c"])
    way, word = data.draw(st.sampled_from(["rename", "add", "drop"])), data.draw(words)
    number = data.draw(st.sampled_from([0, 0.25, [0.1, 0.2, 0.0, 0.0], "text"]))
    changed: list[str] = []

    def change(values: JsonObject) -> JsonObject:
        key = data.draw(st.sampled_from(sorted(values))) if not changed else changed[0]
        changed[:] = [key]
        if way == "add":
            return values if word in values else {**values, word: number}
        rest = {name: value for name, value in values.items() if name != key}
        return rest if way == "drop" else {**rest, word: values[key]}

    try:
        rig = read_rig(make(tmp_path_factory.mktemp("form"), change))
    except StudioError as error:
        problem = str(error).split(": ", 1)[1]
        named = "|".join((word, changed[0], MEANING.get(changed[0], changed[0])))
        assert way == "drop" or re.search(rf"\b({named})\b", problem), problem
        return
    if way == "drop" and MEANING.get(changed[0]) == "distortion":
        assert any("no lens distortion" in note for note in rig.notes)
    elif way == "add" or changed[0] not in ("fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "name"):
        # transforms.json has default values for the others, and in TOML the table's name is the default
        assert_projects(rig, BEND, corner)


def test_unknown_keys_are_named_in_the_notes(tmp_path: Path) -> None:
    rig = read_rig(cameras_json(tmp_path, lambda values: {**values, "operator": "Ann", "serial": 3}))
    assert any("'operator'" in note for note in rig.notes)
    assert not any("serial" in note for note in rig.notes)


@pytest.mark.parametrize(
    ("form", "code", "changes"),
    [
        ("cameras.json", "camera.lens_model",
         [{"model": "equirectangular"}, {"type": "omnidirectional"}, {"rdist": [0.1, 0.0, 0.0, 0.0]}]),
        ("cameras.json", "camera.unknown_key",
         [{"xi": 1.2}, {"fisheye_coefficients": [0.1, 0, 0, 0]}, {"pose": [[1.0, 0, 0, 0]]}]),
        ("cameras.json", "camera.conflict",
         [{"distortion": [0.5, 0, 0, 0]}, {"world_to_camera": np.eye(4).tolist()}]),
        ("cameras.json", "camera.focal_length_unit", [{"K": [[1.1, 0, 0.5], [0, 1.5, 0.5], [0, 0, 1]]}]),
        ("cameras.json", "camera.not_rigid", [{"w2c": POSES[0].T.tolist()}]),
        ("toml", "camera.rotation", [{"rotation": [0.0, 45.0, 120.0]}]),  # degrees
        ("transforms", "camera.focal_length_unit", [{"fl_x": 35.0, "fl_y": 35.0}]),  # millimeters
        ("transforms", "camera.lens_model",
         [{"camera_model": "EQUIRECTANGULAR"}, {"camera_model": "FISHEYE624"}, {"camera_model": "ORTHOPHOTO"},
          {"k4": 0.1}]),
        ("transforms", "camera.unknown_key", [{"lens_shift": 3}]),
        ("transforms", "camera.conflict", [{"dist": [0.1, 0, 0, 0]}]),
    ],
)  # fmt: skip
def test_other_lenses_or_units_are_refused(tmp_path: Path, form: str, code: str, changes: list[dict[str, Any]]) -> None:
    for change in changes:
        path = FORMS[form][0](tmp_path, lambda values, change=change: {**values, **change})
        with refuses(code, file=path, camera="cam0"):
            read_rig(path)


@pytest.mark.parametrize("change", [{"ftheta_p0": 0.1}, {"latlong": True}])
def test_unknown_keys_where_no_distortion_is_given_are_refused(tmp_path: Path, change: JsonObject) -> None:
    path = transforms(tmp_path, lambda values: {key: values[key] for key in values if key[0] not in "kp"} | change)
    with refuses("camera.unknown_key", file=path, camera="cam0"):
        read_rig(path)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ({"K": K}, {"K": [[1400.0, 0, 640], [0, 1420, 360], [0, 0, 1]]}),
        ({"intrinsic_matrix": K}, {"intrinsic_matrix": [[700.0, 0, 340], [0, 710, 180], [0, 0, 1]]}),
        ({"width": 640}, {"width": 1280}),
        ({"distortion_params": [-0.3, 0.1, 0.02, 0, 0.001, -0.002]}, {"distortion_params": [0.3, 0.1, 0, 0, 0, 0]}),
    ],
)
def test_transforms_that_say_two_things(tmp_path: Path, right: JsonObject, wrong: JsonObject) -> None:
    assert_projects(read_rig(transforms(tmp_path, lambda values: {**values, **right})), BEND, corner=True)
    path = transforms(tmp_path, lambda values: {**values, **wrong})
    (key,) = wrong
    with refuses("camera.conflict", file=path, camera="cam0") as caught:
        read_rig(path)
    assert key in (caught.value.fields["key"], caught.value.fields["other"])


@pytest.mark.parametrize("change", [{"version": "1.0"}, {"is_bad": False}, {"blur_score": 12.3}, {"steps": [0, 1]}])
def test_keys_that_cannot_be_a_lens_are_ignored(tmp_path: Path, change: JsonObject) -> None:
    path = transforms(tmp_path, lambda values: {key: values[key] for key in values if key[0] not in "kp"} | change)
    rig = read_rig(path)
    assert_projects(rig, [0.0] * 5, corner=True)
    assert any(repr(next(iter(change))) in note for note in rig.notes)


@pytest.mark.parametrize(("width", "height"), [(960, 540), (800, 800), (540, 960)])
@pytest.mark.parametrize("with_focal_lengths", [True, False])
def test_angles_of_a_sensor_of_another_shape(tmp_path: Path, width: int, height: int, with_focal_lengths: bool) -> None:
    """Blender: 50 mm on a sensor of 36 x 24 mm, whose longer side is that of the image."""
    focal = 50 / 36 * max(width, height)
    angles = {"camera_angle_x": 2 * np.arctan(18 / 50), "camera_angle_y": 2 * np.arctan(12 / 50)}
    given = {"w": width, "h": height, **angles, **({"fl_x": focal, "fl_y": focal} if with_focal_lengths else {})}
    frames = [{"file_path": f"cam{index}.png", "transform_matrix": np.eye(4).tolist()} for index in range(2)]
    (tmp_path / "transforms.json").write_text(json.dumps({**given, "frames": frames}))
    rig = read_rig(tmp_path / "transforms.json")
    assert [(camera.fx, camera.fy) for camera in rig] == [pytest.approx((focal, focal))] * 2
    assert any("'camera_angle_x'" in note or "3:2" in note for note in rig.notes)


def test_entries_of_transforms_replace_what_is_beside_them(tmp_path: Path) -> None:
    own = {"fl_x": 700.0, "fl_y": 710.0}

    def change(values: JsonObject) -> JsonObject:
        frames = [{**frame, **own} for frame in values["frames"]]
        return {**values, "fl_x": 500.0, "camera_angle_x": 1.2, "frames": frames}

    rig = read_rig(transforms(tmp_path, change))
    assert_projects(rig, BEND, corner=True)
    assert any("'fl_x'" in note for note in rig.notes)
    assert not any("'fl_y'" in note for note in rig.notes)


def test_a_wrong_key_is_named_before_the_size_that_it_replaced(tmp_path: Path) -> None:
    def change(values: JsonObject) -> JsonObject:
        rest = {key: value for key, value in values.items() if key != "resolution"}
        return {**rest, "k": values["resolution"]}

    with refuses("camera.wrong_shape", camera="cam0", key="k"):
        read_rig(FORMS["panoptic"][0](tmp_path, change))


def test_transposed_matrices_of_transforms(tmp_path: Path) -> None:
    def change(values: JsonObject) -> JsonObject:
        key = "transform_matrix"
        return {**values, "frames": [{**frame, key: np.transpose(frame[key]).tolist()} for frame in values["frames"]]}

    with refuses("camera.not_rigid", camera="cam0", key="transform_matrix"):
        read_rig(transforms(tmp_path, change))


def test_a_principal_point_outside_of_the_image(tmp_path: Path) -> None:
    rig = read_rig(transforms(tmp_path, lambda values: {**values, "cx": 1920.0, "cy": 1080.0}))
    assert any("principal point is outside" in note for note in rig.notes)


def test_a_key_twice_in_an_object(tmp_path: Path) -> None:
    path = cameras_json(tmp_path, lambda values: values)
    path.write_text(path.read_text().replace('"width": 640', '"width": 320, "width": 640', 1))
    with refuses("camera_file.syntax", file=path):
        read_rig(path)


@pytest.mark.parametrize("empty", ["missing", "[]", '"null"'])
def test_a_camera_without_pose_is_left_out(tmp_path: Path, empty: str) -> None:
    def change(values: JsonObject) -> JsonObject:
        if values["name"] != "cam2":
            return values
        kept = {key: value for key, value in values.items() if key not in ("rotation", "translation")}
        return kept if empty == "missing" else kept | dict.fromkeys(("rotation", "translation"), json.loads(empty))

    rig = read_rig(toml(tmp_path, change))
    assert_projects(rig, BEND, corner=False, names=NAMES[:2])
    assert rig.left_out == ("cam2",)


@pytest.mark.parametrize("master", [None, "cam1"])
def test_multical(tmp_path: Path, master: str | None) -> None:
    """With a master, the world is its camera: poses differ by that of the master."""
    base = POSES[1] if master else np.eye(4)
    poses, cameras = {}, {}
    for name, world in zip(NAMES, POSES, strict=True):
        own = world @ np.linalg.inv(base)
        key = name if master in (None, name) else f"{name}_to_{master}"
        poses[key] = {"R": own[:3, :3].tolist(), "T": own[:3, 3].tolist()}
        cameras[name] = {"model": "standard", "image_size": [640, 360], "K": K, "dist": [BEND]}
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps({"cameras": cameras, "camera_poses": poses, "image_sets": {"rgb": []}}))
    rig = read_rig(path)
    for camera, world in zip(rig, POSES, strict=True):
        np.testing.assert_allclose(camera.world_to_camera @ base, world, atol=1e-9)
        np.testing.assert_allclose(camera.distortion, BEND)
    poses["cam0_to_board"] = poses.pop("cam0" if master is None else "cam0_to_cam1")
    path.write_text(json.dumps({"cameras": cameras, "camera_poses": poses}))
    with refuses("camera.unknown", file=path, value="board"):
        read_rig(path)


def test_mc_calib(tmp_path: Path) -> None:
    """The program writes the inverse of its world-to-camera matrices; groups have no common world."""
    path = tmp_path / "calibrated_cameras_data.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("nb_camera", 4)
    for index, world in enumerate([*POSES, np.eye(4)]):
        values = {
            "camera_matrix": np.array(K), "distortion_vector": np.array([BEND]), "distortion_type": 0,
            "camera_group": int(index == 3), "img_width": 640, "img_height": 360,
            "camera_pose_matrix": np.linalg.inv(world),
        }  # fmt: skip
        storage.startWriteStruct(f"camera_{index}", cv2.FileNode_MAP)
        for key, value in values.items():
            storage.write(key, value)
        storage.endWriteStruct()
    storage.release()
    rig = read_rig(path)
    assert_projects(rig, BEND, corner=False, names=("camera_0", "camera_1", "camera_2"))
    assert any("'camera_3'" in note for note in rig.notes)
    path.write_text(path.read_text().replace("distortion_type: 0", "distortion_type: 2"))
    with refuses("camera.lens_model", camera="camera_0"):
        read_rig(path)


def test_cameras_json_of_3dgs(tmp_path: Path) -> None:
    entries = []
    for index, world in enumerate(POSES):
        back = np.linalg.inv(world)
        values = {"id": index, "img_name": f"cam{index}", "width": 640, "height": 360, "fx": 700.0, "fy": 710.0}
        entries.append({**values, "position": back[:3, 3].tolist(), "rotation": back[:3, :3].tolist()})
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps(entries))
    rig = read_rig(path)
    assert_projects(rig, [0.0] * 4, corner=True)
    assert any("principal point" in note for note in rig.notes)


def test_meta_of_dynamic_gaussians(tmp_path: Path) -> None:
    def write(name: str, cameras: tuple[int, ...], turn: float = 0.0) -> Path:
        values = {"w": 640, "h": 360, "k": [], "w2c": [], "fn": [], "cam_id": []}
        for frame in range(2):
            worlds = [POSES[index].copy() for index in cameras]
            worlds[0][0, 3] += turn * frame
            values["k"].append([K] * len(cameras))
            values["w2c"].append([world.tolist() for world in worlds])
            values["fn"].append([f"cam{index}/{frame:06d}.jpg" for index in cameras])
            values["cam_id"].append(list(cameras))
        (tmp_path / name).write_text(json.dumps(values))
        return tmp_path / name

    path = write("train_meta.json", (0, 1))
    write("test_meta.json", (2,))
    for given_path in (path, tmp_path):
        rig = read_rig(given_path)
        assert_projects(rig, [0.0] * 4, corner=True)
        assert rig.for_evaluation == ("cam2",)
    write("train_meta.json", (0, 1), turn=0.1)
    with refuses("camera.moves", file=path, camera="cam0"):
        read_rig(path)


@pytest.mark.parametrize(
    ("key", "value", "taken"),
    [
        ("convention", "OpenCV", True), ("unit", "mm", True), ("coordinate_system", "opengl", False),
        ("convention", "opengl", False), ("axes", "RUB", False), ("distortion_model", "kannala_brandt", False),
        ("operator", "me", True),
    ],
)  # fmt: skip
def test_keys_beside_the_cameras(tmp_path: Path, key: str, value: str, taken: bool) -> None:
    path = cameras_json(tmp_path, lambda values: values)
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))
    if taken:
        rig = read_rig(path)
        assert any(f"'{key}'" in note for note in rig.notes) == (key == "operator")
    else:
        with refuses("camera.unknown_key", file=path, key=key):
            read_rig(path)


BOW = [0.03, -0.008, 0.001, 0.002]
BOWS = dict(zip(("k1", "k2", "k3", "k4"), BOW, strict=True))


def assert_bows(rig: Rig, corner: bool) -> None:
    """The rig's cameras are fisheyes that project as OpenCV's `fisheye` does."""
    for camera, world in zip(rig, POSES, strict=True):
        vector = cv2.Rodrigues(world[:3, :3])[0]
        expected, _ = cv2.fisheye.projectPoints(POINTS[:, None], vector, world[:3, 3], np.array(K), np.array(BOW))
        np.testing.assert_allclose(
            camera.project(POINTS)[0], expected.reshape(-1, 2) + (0 if corner else 0.5), atol=1e-5
        )


@pytest.mark.parametrize(
    ("form", "told"),
    [
        ("cameras.json", {"model": "fisheye", "dist": BOW}),
        ("cameras.json", {"camera_model": "OPENCV_FISHEYE", **BOWS}),
        ("cameras.json", {"distortion_model": "equidistant", "dist": [[value] for value in BOW]}),
        ("toml", {"fisheye": True, "distortions": BOW}),
        ("opencv", {"fisheye_model": 1, "distortion_coefficients": [BOW]}),
    ],
)  # fmt: skip
def test_fisheyes_project_as_in_opencv(tmp_path: Path, form: str, told: JsonObject) -> None:
    make, corner = FORMS[form][0], FORMS[form][1]
    assert_bows(
        read_rig(make(tmp_path, lambda values: {k: v for k, v in values.items() if k != "dist"} | told)), corner
    )


@pytest.mark.parametrize(
    "told",
    [
        {"camera_model": "OPENCV_FISHEYE", **BOWS},
        {"is_fisheye": True, **BOWS},
        {"camera_model": "THIN_PRISM_FISHEYE", **BOWS, "sx1": 0.0},
        {"camera_model": "OPENCV_FISHEYE", "distortion_params": [*BOW, 0, 0]},
    ],
)
def test_fisheyes_of_nerfstudio(tmp_path: Path, told: JsonObject) -> None:
    path = transforms(
        tmp_path, lambda values: {k: v for k, v in values.items() if k not in ("k1", "k2", "k3", "p1", "p2")} | told
    )
    assert_bows(read_rig(path), corner=True)


def test_kalibr(tmp_path: Path) -> None:
    text = ""
    for index, world in enumerate(POSES):
        text += f"cam{index}:\n  cam_overlaps: [1]\n  camera_model: pinhole\n  distortion_model: equidistant\n"
        text += f"  distortion_coeffs: {BOW}\n  intrinsics: [700.0, 710.0, 320.0, 180.0]\n  resolution: [640, 360]\n"
        text += f"  rostopic: /cam{index}/image_raw\n"
        if index:
            text += f"  T_cn_cnm1: {(world @ np.linalg.inv(POSES[index - 1])).tolist()}\n"
    path = tmp_path / "camchain-rig.yaml"
    path.write_text(text)
    rig = read_rig(path)
    moved = [replace(camera, world_to_camera=camera.world_to_camera @ POSES[0]) for camera in rig]
    assert_bows(Rig(tuple(moved)), corner=False)
    path.write_text(text.replace("pinhole", "omni"))
    with refuses("camera.lens_model", camera="cam0"):
        read_rig(path)


@pytest.mark.parametrize("name", ["rig.json", "transforms.json", "Calib.toml", "model"])
def test_fisheyes_are_read_as_written(tmp_path: Path, name: str) -> None:
    rig = Rig(
        tuple(Camera(n, 640, 360, np.array(K), w, np.array(BOW), True) for n, w in zip(NAMES, POSES, strict=True))
    )
    write_rig(rig, tmp_path / name)
    assert_bows(read_rig(tmp_path / name), corner=True)
    mixed = Rig((*rig.cameras[:2], replace(rig.cameras[2], distortion=np.zeros(0), fisheye=False)))
    if name == "transforms.json":
        with refuses("camera_file.not_expressible", value="fisheye"):
            write_rig(mixed, tmp_path / name)
