"""The row of buttons under the timeline."""

from collections.abc import Callable, Iterable

from open3d.visualization import gui

from v3studio.gui.drawing.icons import icon
from v3studio.gui.drawing.palette import PANEL
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.widgets.flow import Flow
from v3studio.gui.widgets.hints import Hints
from v3studio.gui.widgets.picture import color, make_button, put

FREE = "free view"
SPEEDS = {"0.25x": 0.25, "0.5x": 0.5, "1x": 1.0, "2x": 2.0}
VOLUMES = {"sound off": 0.0, "sound 25%": 0.25, "sound 50%": 0.5, "sound 100%": 1.0}
SOUND = "Volume of the stream's sound (V: off or on). It plays at speed 1x only."


class ControlsPanel:
    """Buttons by key: start, back, play, forward, end; loop, speed, sound, capture camera, reset; `lists` open a list.
    Sound and cameras are shown if the open take or stream has them."""

    def __init__(
        self,
        player: PlayerPresenter,
        em: float,
        reset: Callable[[], None],
        fit: Callable[[], None],
        changed: Callable[[], None],
        hints: Hints,
    ) -> None:
        self._player, self._hints = player, hints
        self._changed = changed
        self.flow = Flow(0.3 * em, 1.5 * em)
        self.widget = self.flow.widget
        self.widget.background_color = color(PANEL)
        self.buttons: dict[str, gui.Widget] = {}
        for key, tooltip, action in (
            ("start", "First frame (Home)", lambda: player.transport.seek(0)),
            ("back", "Previous frame (Left)", lambda: player.transport.step(-1)),
            ("play", "Play or pause (Space)", lambda: player.transport.toggle()),
            ("forward", "Next frame (Right)", lambda: player.transport.step(1)),
            ("end", "Last frame (End)", lambda: player.transport.seek(player.transport.last)),
        ):
            self._button("", tooltip, action, key)
        self._loop = gui.Checkbox("Loop")
        self._hint(self._loop, "Loop playback (L)")
        self._loop.set_on_checked(lambda on: self._did(lambda: player.transport.set_loop(on)))
        self._add("loop", self._loop)
        self.lists: list[gui.Widget] = []
        self._speed = self._list("speed", SPEEDS, "Playback speed", self._set_speed)
        self._volume = self._list("volume", VOLUMES, SOUND, self._set_volume)
        hint = "Free view or a capture camera (C: next camera)"
        self._camera = self._list("camera", (), hint, self._look_through, right=True)
        self._cameras: dict[str, str] = {}  # labels in the list by camera
        for widget in (self._volume, self._camera):
            widget.visible = False  # until there is something to choose
        self._button("Fit timeline", "Show all frames on the timeline", fit, "fit")
        self._button("Reset view", "Show everybody, at eye level (R)", reset, "reset view")

    def _hint(self, widget: gui.Widget, text: str) -> None:
        self._hints.give(widget, text, self.widget)

    def _add(self, key: str, widget: gui.Widget, right: bool = False) -> None:
        self.buttons[key] = widget
        self.flow.add(widget, right=right)

    def _list(
        self, key: str, names: Iterable[str], tooltip: str, chosen: Callable[[str], None], right: bool = False
    ) -> gui.Combobox:
        box = gui.Combobox()
        for name in names:
            box.add_item(name)
        self._hint(box, tooltip)
        box.set_on_selection_changed(lambda name, _: self._did(lambda: chosen(name)))
        self._add(key, box, right)
        self.lists.append(box)
        return box

    def _button(self, text: str, tooltip: str, action: Callable[[], object], key: str) -> None:
        button = make_button(f"{icon(key)} {text}".strip(), action, self._changed, pad=0.42, pad_y=0.05)
        self._hint(button, tooltip)
        self._add(key, button)

    def _did(self, action: Callable[[], object]) -> None:
        action()
        self._changed()

    def _look_through(self, name: str) -> None:
        self._player.look_through(next((camera for camera, label in self._cameras.items() if label == name), ""))

    def _set_speed(self, name: str) -> None:
        self._player.transport.speed = SPEEDS[name]

    def _set_volume(self, name: str) -> None:
        if self._player.audio is not None:
            self._player.audio.volume = VOLUMES[name]

    def update(self, free: bool) -> tuple[bool, bool]:
        """Show the state of the player; return (whether a widget changed, whether a layout is due). `free`: what is on
        screen has a free view, also if it begins where a camera is."""
        player, transport = self._player, self._player.transport
        speed = next((name for name, value in SPEEDS.items() if value == transport.speed), "1x")
        held_out = player.held_out
        labels = {name: f"{name}, held out" if name in held_out else name for name in player.camera_names}
        layout = list(labels.items()) != list(self._cameras.items())
        if layout:
            self._cameras = labels
            self._camera.clear_items()
            for label in (FREE, *labels.values()):
                self._camera.add_item(label)
        changed = put(self.buttons["play"], text=icon("pause" if transport.playing else "play"))
        changed |= put(self._loop, checked=transport.loop) | put(self._speed, selected_text=speed)
        if self._camera.number_of_items:
            changed |= put(self._camera, selected_text=labels.get("" if free else player.camera, FREE))
        volume = player.audio.volume if player.audio is not None else 0.0
        changed |= put(self._volume, selected_text=min(VOLUMES, key=lambda name: abs(VOLUMES[name] - volume)))
        # what cannot be used takes no room: in a narrow window it would cost a line
        layout |= put(self._volume, visible=player.audio is not None) | put(self._camera, visible=bool(labels))
        for widget in self.buttons.values():
            changed |= put(widget, enabled=player.opened is not None)
        return changed or layout, layout
