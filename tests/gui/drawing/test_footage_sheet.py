import numpy as np

from v3studio.gui.drawing.footage_sheet import FootageSheet
from v3studio.gui.drawing.palette import HELD_OUT
from v3studio.pipelines.inspection import Inspection

CAMERAS = ("a", "b", "c", "d")
WHITE = np.full((30, 40, 3), 240, np.uint8)
FOUND = Inspection(
    cameras=CAMERAS,
    unmasked=("d",),
    frames=tuple(range(60, 70)),
    thumbnails=dict.fromkeys(CAMERAS[:3], WHITE),
    strip=dict.fromkeys((60, 65, 69), WHITE),
)
USES = {"a": "training", "b": "held out", "c": "not used", "d": "not used"}


def test_cameras_and_frames_are_where_they_are_drawn() -> None:
    sheet = FootageSheet((600, 240), 16.0, FOUND, USES, (60, 65))
    pixels = sheet.draw()
    assert pixels.shape == (240, 600, 3)
    levels = {}
    for name, box in sheet.cameras.items():
        x, y = box.x + box.width // 2, box.y + box.height // 2
        assert sheet.camera_at(x, y) == name
        assert sheet.frame_at(x, y) is None
        levels[name] = int(pixels[y, x, 0])
    assert levels["a"] == levels["b"] == 240
    assert levels["c"] < 100
    corner = sheet.cameras["b"]
    assert tuple(pixels[corner.y + corner.height - 1, corner.x]) == HELD_OUT
    assert sheet.camera_at(2, 239) == ""
    assert [sheet.frame_at(x, 239) for x in (0, 299, 599)] == [60, 64, 69], "every frame, not only those shown"
    bright = {frame: pixels[box.y + box.height // 2, box.x + box.width // 2, 0] for frame, box in sheet.frames.items()}
    assert bright[60] == bright[65] == 240
    assert bright[69] < 100
