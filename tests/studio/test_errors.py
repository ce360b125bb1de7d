import json
import pickle
from pathlib import Path

from v3studio.studio.errors import Message, StudioError


def test_errors_survive_pickling_with_their_fields() -> None:
    error = pickle.loads(pickle.dumps(StudioError("a.b", "wrong", file="f", value=3, camera="c1")))
    assert str(error) == "f: wrong."
    assert (error.code, error.value, error.fields) == ("a.b", 3, {"camera": "c1"})


def test_to_dict_is_json() -> None:
    message = Message("a.b", "wrong", Path("f"), value=(1, Path("g")), fields={"camera": "c1", "frames": [1, 2]})
    assert json.loads(json.dumps(message.to_dict())) == {
        "code": "a.b", "message": "f: wrong.", "file": "f", "value": [1, "g"], "camera": "c1", "frames": [1, 2],
    }  # fmt: skip
