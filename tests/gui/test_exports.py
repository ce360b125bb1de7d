"""Exports from the window: child processes with progress, refusals as sentences, camera paths from collected views."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest

from gui.presenters.exports import Exports, PathKey, fitted
from gui.presenters.orbit import OrbitCamera
from studio.errors import StudioError


def finish(exports: Exports, seconds: float = 60.0) -> set[str]:
    words = set()
    end = time.monotonic() + seconds
    while exports.running and time.monotonic() < end:
        exports.poll()
        words.add(exports.words)
        time.sleep(0.02)
    assert not exports.running
    return words


def test_a_sequence_is_written_and_nothing_is_overwritten(stream_folder: Path, tmp_path: Path) -> None:
    exports = Exports()
    exports.start("ply", str(stream_folder), "", tmp_path / "out")
    with pytest.raises(StudioError, match="runs already"):
        exports.start("spz", str(stream_folder), "", tmp_path / "other")
    words = finish(exports)
    assert exports.result == f"Written: {tmp_path / 'out'}"
    assert not exports.failed
    assert len(list((tmp_path / "out").glob("*.ply"))) == 12
    assert any("of 12" in word for word in words)
    with pytest.raises(StudioError, match="is there already"):
        exports.start("ply", str(stream_folder), "", tmp_path / "out")


def test_what_fails_is_a_sentence(tmp_path: Path) -> None:
    exports = Exports()
    exports.start("ply", str(tmp_path / "nothing"), "", tmp_path / "out")
    finish(exports)
    assert exports.failed
    assert "nothing" in exports.result
    assert not (tmp_path / "out").exists()


def test_views_become_a_camera_path(tmp_path: Path) -> None:
    from studio.export import read_path_keys

    exports = Exports()
    orbit = OrbitCamera()
    exports.keys.append(PathKey(orbit.camera(700, 560), 0))
    with pytest.raises(StudioError, match="two views"):
        exports.start("camera-path", "x", "", tmp_path / "out.mp4")
    exports.keys.append(PathKey(orbit.orbit(90, 0).camera(700, 560), 9))
    path = exports._write_path(tmp_path)
    assert json.loads(path.read_text())["format"] == "v3studio-camera-path"
    keys = read_path_keys(path, 10.0)
    assert [(key.time, key.frame) for key in keys] == [(0.0, 0.0), (2.0, 9.0)]
    assert (keys[0].camera.width, keys[0].camera.height) == (1280, 720)


def test_a_view_keeps_its_height_in_another_shape() -> None:
    camera = OrbitCamera(target=np.array([0.2, 0.1, 0.3]), yaw=0.4, pitch=0.2).camera(700, 560)
    wide = fitted(camera, 1280, 720)
    points = np.random.default_rng(1).normal(0, 0.3, (50, 3))
    before, after = camera.project(points)[0], wide.project(points)[0]
    assert after[:, 1] == pytest.approx(before[:, 1] * 720 / 560)
    assert after[:, 0] - 640 == pytest.approx((before[:, 0] - 350) * 720 / 560)
