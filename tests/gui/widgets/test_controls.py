"""The buttons under the timeline."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from open3d.visualization import gui

from gui.models.playback.transport import Transport
from gui.widgets.controls import FREE, ControlsPanel
from gui.widgets.hints import Hints


def test_the_list_of_cameras_says_which_are_held_out() -> None:
    player: Any = SimpleNamespace(
        transport=Transport(4, 25.0), camera="", camera_names=["cam00", "cam01"], held_out=("cam01",), opened=object(),
        audio=None, next_background=lambda: None,
    )  # fmt: skip
    player.look_through = lambda name: setattr(player, "camera", name)
    panel = ControlsPanel(player, 16.0, lambda: None, lambda: None, Hints(True, 16.0))
    assert panel.update() == (True, True)
    box = panel.buttons["camera"]
    assert isinstance(box, gui.Combobox)
    labels = [box.get_item(number) for number in range(box.number_of_items)]
    assert labels == [FREE, "cam00", "cam01, held out"]
    for label, camera in zip(labels, ("", "cam00", "cam01"), strict=True):
        panel._look_through(label)
        assert player.camera == camera
        panel.update()
        assert box.selected_text == label
    player.held_out = ()  # a stream does not tell
    panel.update()
    assert box.get_item(2) == box.selected_text == "cam01"
