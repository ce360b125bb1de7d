"""Values that are no numbers, in each form: a sentence with file, camera and value, none of Python's own words."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from studio.camera_files import read_rig, write_rig
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.validation import array, number, whole

K = np.array([[200.0, 0, 81], [0, 201, 60], [0, 0, 1]])
BENT = Rig(tuple(Camera(name, 160, 120, K, np.eye(4), np.array([0.1, 0.01, 0, 0])) for name in "ab"))
STRAIGHT = Rig(tuple(Camera(name, 160, 120, K, np.eye(4)) for name in "ab"))
FORMS = [
    (BENT, "rig.json", ("rig.json",)),
    (BENT, "transforms.json", ("transforms.json",)),
    (STRAIGHT, "calibration.csv", ("calibration.csv",)),
    (BENT, "camera_array.toml", ("camera_array.toml",)),
    (BENT, "Calib.toml", ("Calib.toml",)),
    (BENT, "intri.yml", ("intri.yml", "extri.yml")),
    (BENT, "model", ("model/cameras.txt", "model/images.txt")),
]
PYTHONS = re.compile(r"literal|convert|sequence|inhomogeneous|argument|NoneType|'(list|dict|str)'|unpack|Error")


@pytest.mark.parametrize(("rig", "name", "files"), FORMS, ids=[name for _, name, _ in FORMS])
def test_every_number_in_turn_replaced_by_something_else(tmp_path: Path, rig: Rig, name: str, files: tuple) -> None:
    write_rig(rig, tmp_path / name)
    refused = 0
    for file in (tmp_path / part for part in files):
        text = file.read_text()
        for place in re.finditer(r"-?\d+\.?\d*(?:e-?\d+)?", text):
            for wrong in ("abc", '"abc"', "[]", "{}", "null", '"²"', "1e999", ""):
                file.write_text(text[: place.start()] + wrong + text[place.end() :])
                try:
                    read_rig(tmp_path / name)
                except StudioError as error:
                    refused += 1
                    said = str(error)
                    assert said.startswith(str(tmp_path))
                    assert "\n" not in said
                    assert not PYTHONS.search(said.replace(str(tmp_path), "")), said
        file.write_text(text)
    assert refused > 100


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("width", "abc", "'width' is 'abc', which is not a number"),
        ("width", [], r"'width' is \[\], which is not a number"),
        ("height", 120.5, r"'height' is 120\.5, which is not a whole number"),
        ("height", None, "the key 'height' is missing"),
        ("K", [[1, 2, 3], [1, "x", 3], [0, 0, 1]], r"K\[1\]\[1\] is 'x', which is not a number"),
        ("K", [[1, 2, 3], [1, 3], [0, 0, 1]], "the rows of 'K' are not of one length"),
        ("K", {"fx": 3}, r"K is {'fx': 3}, which is not a number"),
        ("world_to_camera", [[{}]], r"world_to_camera\[0\]\[0\] is {}, which is not a number"),
        ("distortion", ["0.1", "y", 0, 0], r"distortion\[1\] is 'y', which is not a number"),
    ],
)
def test_rig_json_names_the_value(tmp_path: Path, key: str, value: object, said: str) -> None:
    write_rig(BENT, tmp_path / "rig.json")
    values = json.loads((tmp_path / "rig.json").read_text())
    values["cameras"][1][key] = value
    (tmp_path / "rig.json").write_text(json.dumps(values))
    with pytest.raises(StudioError, match=rf"rig\.json: Camera 'b': {said}"):
        read_rig(tmp_path / "rig.json")


def test_other_forms_name_the_value(tmp_path: Path) -> None:
    for rig, name, file, old, new, said in (
        (BENT, "Calib.toml", "Calib.toml", "201.0", '"x"', r"matrix\[1\]\[1\] is 'x', which is not a number"),
        (STRAIGHT, "calibration.csv", "calibration.csv", "160", "wide", "'w' is 'wide', which is not a number"),
        (BENT, "intri.yml", "intri.yml", "W_a: 160", "W_a: wide", "'W_a' is 'wide', which is not a number"),
        (BENT, "model", "model/cameras.txt", "160", "160.5", "line 2 has '160.5' where a number is needed"),
    ):
        write_rig(rig, tmp_path / name)
        path = tmp_path / file
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new, 1))
        with pytest.raises(StudioError, match=said):
            read_rig(tmp_path / name)


def test_numbers_as_text_count() -> None:
    assert number({"f": "2.5"}, "f", "x") == 2.5
    assert number({}, "f", "x", 1.0) == 1.0
    assert whole({"w": 640.0}, "w", "x") == 640
    assert array([["1", 2], [3, 4]], "K", "x").tolist() == [[1, 2], [3, 4]]
    with pytest.raises(StudioError, match=r"'f' is 'a{36}\.\.\., which"):
        number({"f": "a" * 99}, "f", "x")
