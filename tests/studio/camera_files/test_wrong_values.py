"""Values that are not numbers, in every format: one error with file, camera and value, without Python's messages."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.errors import refuses
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import StudioError

K = np.array([[200.0, 0, 81], [0, 201, 60], [0, 0, 1]])
BENT = Rig(tuple(Camera(name, 160, 120, K, np.eye(4), np.array([0.1, 0.01, 0, 0])) for name in "ab"))
STRAIGHT = Rig(tuple(Camera(name, 160, 120, K, np.eye(4)) for name in "ab"))
FORMS = [
    ("rig.json", ("rig.json",)), ("transforms.json", ("transforms.json",)), ("calibration.csv", ("calibration.csv",)),
    ("camera_array.toml", ("camera_array.toml",)), ("Calib.toml", ("Calib.toml",)),
    ("intri.yml", ("intri.yml", "extri.yml")), ("model", ("model/cameras.txt", "model/images.txt")),
]  # fmt: skip
WRONG = ("abc", '"abc"', "[]", "{}", "null", '"²"', "1e999", "")
PYTHONS = re.compile(r"literal|convert|sequence|inhomogeneous|argument|NoneType|'(list|dict|str)'|unpack|Error")


@pytest.mark.parametrize(("name", "files"), FORMS)
def test_every_number_in_turn_replaced_by_something_else(tmp_path: Path, name: str, files: tuple[str, ...]) -> None:
    write_rig(STRAIGHT if name == "calibration.csv" else BENT, tmp_path / name)
    refused, areas = 0, set()
    for file in (tmp_path / part for part in files):
        text = file.read_text()
        for number_of_place, place in enumerate(re.finditer(r"-?\d+\.?\d*(?:e-?\d+)?", text)):
            for wrong in (WRONG[number_of_place % len(WRONG)], WRONG[(number_of_place + 3) % len(WRONG)]):
                file.write_text(text[: place.start()] + wrong + text[place.end() :])
                try:
                    read_rig(tmp_path / name)
                except StudioError as error:
                    refused += 1
                    areas.add(error.code.split(".")[0])
                    said = str(error)
                    assert said.startswith(str(tmp_path))
                    assert "\n" not in said
                    assert not PYTHONS.search(said.replace(str(tmp_path), "")), said
        file.write_text(text)
    assert refused > 20
    assert areas <= {"camera", "camera_file"}


def test_transposed_intrinsics_are_refused_and_lists_are_read(tmp_path: Path) -> None:
    camera = {"name": "a", "width": 160, "height": 120, "K": K.tolist(), "R": np.eye(3).tolist(), "t": [0, 0, 1]}
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps([camera, {**camera, "name": "b"}]))
    assert [(each.name, each.fx, each.cx) for each in read_rig(path)] == [("a", 200.0, 81.0), ("b", 200.0, 81.0)]
    path.write_text(json.dumps([{**camera, "K": K.T.tolist()}]))
    with refuses("camera.intrinsics", camera="a"):
        read_rig(path)


@pytest.mark.parametrize(
    ("key", "value", "code", "wrong", "index"),
    [
        ("width", "abc", "camera.not_a_number", "abc", ""),
        ("width", [1], "camera.not_a_number", [1], ""),
        ("width", True, "camera.not_a_number", True, ""),
        ("height", 120.5, "camera.not_an_integer", 120.5, None),
        ("K", [[1, 2, 3], [1, "x", 3], [0, 0, 1]], "camera.not_a_number", "x", "[1][1]"),
        ("K", [[1, 2, 3], [1, 3], [0, 0, 1]], "camera.ragged", None, None),
        ("K", {"fx": 3}, "camera.not_a_number", {"fx": 3}, ""),
        ("world_to_camera", [[{}]], "camera.not_a_number", {}, "[0][0]"),
        ("distortion", ["0.1", "y", 0, 0], "camera.not_a_number", "y", "[1]"),
    ],
)
def test_rig_json_names_values(tmp_path: Path, key: str, value: Any, code: str, wrong: Any, index: str | None) -> None:
    path = tmp_path / "rig.json"
    write_rig(BENT, path)
    values = json.loads(path.read_text())
    values["cameras"][1][key] = value
    path.write_text(json.dumps(values))
    with refuses(code, file=path, value=wrong, camera="b", key=key, index=index):
        read_rig(path)
