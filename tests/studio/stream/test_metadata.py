"""A manifest's metadata: written and read alike; whatever else stands there is left out."""

import json

import numpy as np
import pytest

from tests.support.errors import refuses
from v3studio.studio.cameras import Camera
from v3studio.studio.stream import StreamMetadata
from v3studio.studio.stream.metadata import plain_text, with_plain_texts

CAMERA = Camera("cam00", 80, 60, np.array([[100.0, 0, 40], [0, 100, 30], [0, 0, 1]]), np.eye(4))


def test_what_is_written_is_read() -> None:
    values = StreamMetadata(CAMERA, (1.0, 0.5, 0.0), (0.0, -1.0, 0.0)).to_json()
    assert list(values) == ["suggested_camera", "background", "up"]
    found = StreamMetadata.from_json(json.loads(json.dumps(values)))
    assert (found.background, found.up) == ((1.0, 0.5, 0.0), (0.0, -1.0, 0.0))
    np.testing.assert_array_equal(found.suggested_camera.K, CAMERA.K)
    assert StreamMetadata().to_json() == {}


def test_malformed_entries_count_as_not_given() -> None:
    values = {"suggested_camera": 7, "background": [1, 2], "up": [0, float("nan"), 1], "title": "x"}
    found = StreamMetadata.from_json(values)
    assert (found.suggested_camera, found.background, found.up) == (None, None, None)
    assert StreamMetadata.from_json({"up": [0, 0, 0]}).up is None, "no direction"
    for color in ([2, 0, 0], [-1, 0, 0], [True, 0, 0]):
        assert StreamMetadata.from_json({"background": color}).background is None
    with refuses("camera.missing_key"):
        StreamMetadata.from_json({"suggested_camera": {"name": "cam00"}})


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("\u202eevil\u202c \u2066walk\u2069\u200f", "evil walk"),
        (" a\x00b\x1b[31m\x7f\x9b\u061c ", "ab[31m"),
        ("one\ntwo\t three\u2028four", "one two three four"),
        ("\U0001f468\u200d\U0001f469 \u0645\u06cc\u200c\u062e", "\U0001f468\u200d\U0001f469 \u0645\u06cc\u200c\u062e"),
        (" \u202e ", ""),
    ],
)
def test_shown_texts_are_plain(text: str, plain: str) -> None:
    assert plain_text(text) == plain
    values = {"title": text, "credits": 7, "other": text}
    assert with_plain_texts(values) == values | {"title": plain}
