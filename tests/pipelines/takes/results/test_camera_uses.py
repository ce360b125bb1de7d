from pathlib import Path

from tests.support.errors import refuses
from tests.support.tiny_capture import write_project
from v3studio.pipelines.config import load_config
from v3studio.pipelines.takes.results.camera_uses import camera_uses, settings_of_uses
from v3studio.studio.capture import CaptureSettings


def test_uses_of_cameras_become_settings(tmp_path: Path) -> None:
    write_project(tmp_path)
    root = tmp_path / "capture"
    spec = CaptureSettings(root=root, held_out=("every 3",), offsets={"cam1": 2, "cam2": 0})
    uses = camera_uses(spec)
    assert uses == {f"cam{number}": "held out" if number in (2, 5) else "training" for number in range(6)}
    changed = settings_of_uses({**uses, "cam1": "not used"}, spec)
    assert changed == {
        "capture.cameras": ["cam0", "cam2", "cam3", "cam4", "cam5"],
        "capture.held_out": ["cam2", "cam5"],
        "capture.offsets": {"cam2": 0},
    }
    config = load_config(None, [("capture.root", str(root)), *changed.items()])
    assert camera_uses(config.capture) == {**uses, "cam1": "not used"}
    assert settings_of_uses(uses, spec)["capture.cameras"] == [], "all of them"
    with refuses("settings.no_training_camera"):
        settings_of_uses(dict.fromkeys(uses, "held out"), spec)
