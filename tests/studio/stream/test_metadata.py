"""A manifest's metadata: written and read alike; whatever else stands there is left out."""

from __future__ import annotations

import json

import numpy as np

from studio.cameras import Camera
from studio.stream import StreamMetadata
from tests.support.errors import refuses

CAMERA = Camera("cam00", 80, 60, np.array([[100.0, 0, 40], [0, 100, 30], [0, 0, 1]]), np.eye(4))


def test_what_is_written_is_read() -> None:
    values = StreamMetadata(CAMERA, (1.0, 0.5, 0.0), (0.0, -1.0, 0.0)).to_json()
    assert list(values) == ["suggested_camera", "background", "up"]
    found = StreamMetadata.from_json(json.loads(json.dumps(values)))
    assert (found.background, found.up) == ((1.0, 0.5, 0.0), (0.0, -1.0, 0.0))
    assert found.suggested_camera is not None
    np.testing.assert_array_equal(found.suggested_camera.K, CAMERA.K)
    assert StreamMetadata().to_json() == {}


def test_malformed_entries_count_as_not_given() -> None:
    found = StreamMetadata.from_json(
        {"suggested_camera": 7, "background": [1, 2], "up": [0, float("nan"), 1], "title": "x"}
    )
    assert (found.suggested_camera, found.background, found.up) == (None, None, None)
    assert StreamMetadata.from_json({"up": [0, 0, 0]}).up is None, "no direction"
    with refuses("camera.missing_key"):
        StreamMetadata.from_json({"suggested_camera": {"name": "cam00"}})
