"""The row of buttons under the timeline."""

from __future__ import annotations

from collections.abc import Callable

from open3d.visualization import gui

from gui.drawing.icons import icon
from gui.drawing.palette import ACCENT_DARK, BORDER, FAINT, PANEL, RAISED, TEXT
from gui.drawing.symbols import framed, symbol
from gui.models.playback.player import PlayerPresenter
from gui.models.playback.transport import Transport
from gui.widgets.flow import Flow
from gui.widgets.hints import Hints
from gui.widgets.picture import PictureWidget, color

FREE = "free view"
SPEEDS = {"0.25x": 0.25, "0.5x": 0.5, "1x": 1.0, "2x": 2.0}


VOLUMES = {"sound off": 0.0, "sound 25%": 0.25, "sound 50%": 0.5, "sound 100%": 1.0}
SYMBOL_WIDTH = 2.2
"""Width of a button with a symbol, em."""

SOUND = "Volume of the stream's sound (V: off or on). It plays at speed 1x only."


class SymbolButton(PictureWidget):
    """A button with a symbol: an image of its size on the screen, so that it is sharp. Call `update` at each draw.

    Args:
        name: key of `SYMBOLS`.
        action: called when it is pressed and released.

    Attributes:
        name: the symbol; may be changed.
    """

    def __init__(self, name: str, action: Callable[[], object]) -> None:
        super().__init__(self._clicked)
        self.name = name
        self._action = action
        self._pressed = False
        self._drawn: object = None

    def update(self) -> bool:
        """Draw what has changed; returns whether anything did."""
        state = (self.name, self.size, self._pressed, self.widget.enabled)
        if state == self._drawn:
            return False
        self._drawn = state
        ground = ACCENT_DARK if self._pressed else RAISED
        enabled = self.widget.enabled
        drawn = symbol(self.name, self.size, TEXT if enabled else FAINT, ground)
        self.show(framed(drawn, BORDER if enabled else FAINT, PANEL))
        return True

    def _clicked(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        if event.type not in (kind.BUTTON_DOWN, kind.BUTTON_UP) or not self.widget.enabled:
            return False
        pressed, self._pressed = self._pressed, event.type == kind.BUTTON_DOWN
        width, height = self.size
        if pressed and event.type == kind.BUTTON_UP and 0 <= x < width and 0 <= y < height:
            self._action()
        return True


class ControlsPanel:
    """Buttons: start, back, play, forward, end; loop, speed, sound, capture camera, background, reset. Sound and
    cameras are shown if the open take or stream has them.

    Args:
        player: what the buttons act on.
        em: the theme's font size, pixels.
        reset: called to reset the view.
        changed: called after each click.
        hints: what the buttons do.

    Attributes:
        buttons: all of them, by key.
        symbols: those with a symbol.
        lists: those that open a list.
    """

    def __init__(
        self, player: PlayerPresenter, em: float, reset: Callable[[], None], changed: Callable[[], None], hints: Hints
    ) -> None:
        self._player, self._hints = player, hints
        self._changed = changed
        self.flow = Flow(0.3 * em, 1.5 * em)
        self.widget = self.flow.widget
        self.widget.background_color = color(PANEL)
        self.buttons: dict[str, gui.Widget] = {}
        transport = self._transport
        self.symbols: dict[str, SymbolButton] = {}
        self._symbol("start", "First frame (Home)", lambda: transport().seek(0), em)
        self._symbol("back", "Previous frame (Left)", lambda: transport().step(-1), em)
        self._symbol("play", "Play or pause (Space)", lambda: transport().toggle(), em)
        self._symbol("forward", "Next frame (Right)", lambda: transport().step(1), em)
        self._symbol("end", "Last frame (End)", lambda: transport().seek(transport().last), em)
        self._loop = gui.Checkbox("Loop")
        self._hint(self._loop, "Loop playback (L)")
        self._loop.set_on_checked(lambda on: self._did(lambda: transport().set_loop(on)))
        self._add("loop", self._loop)
        self._speed = gui.Combobox()
        for name in SPEEDS:
            self._speed.add_item(name)
        self._speed.selected_text = "1x"
        self._hint(self._speed, "Playback speed")
        self._speed.set_on_selection_changed(lambda name, _: self._did(lambda: self._set_speed(name)))
        self._add("speed", self._speed)
        self._volume = gui.Combobox()
        for name in VOLUMES:
            self._volume.add_item(name)
        self._volume.set_on_selection_changed(lambda name, _: self._did(lambda: self._set_volume(name)))
        self._add("volume", self._volume)
        self._camera = gui.Combobox()
        self._hint(self._camera, "Free view or a capture camera (C: next camera)")
        self._camera.set_on_selection_changed(lambda name, _: self._did(lambda: self._look_through(name)))
        self._add("camera", self._camera, right=True)
        self._cameras: dict[str, str] = {}  # labels in the list by camera
        self.lists: list[gui.Widget] = [self._speed, self._volume, self._camera]
        self._sound_hint = ""
        for widget in (self._volume, self._camera):
            widget.visible = False  # until there is something to choose
        self._button("Background", "Next background: dark, black, white (B)", player.next_background)
        self._button("Reset", "Reset the view (R)", reset, key="reset view")

    def _transport(self) -> Transport:
        """The current transport; replaced whenever something is opened."""
        return self._player.transport

    def _hint(self, widget: gui.Widget, text: str) -> None:
        self._hints.give(widget, text, self.widget)

    def _add(self, key: str, widget: gui.Widget, right: bool = False) -> None:
        self.buttons[key] = widget
        self.flow.add(widget, right=right)

    def _symbol(self, name: str, tooltip: str, action: Callable[[], object], em: float) -> None:
        button = SymbolButton(name, lambda: self._did(action))
        self._hint(button.widget, tooltip)
        self.symbols[name] = button
        self.buttons[name] = button.widget
        self.flow.add(button.widget, width=round(SYMBOL_WIDTH * em))

    def _button(self, text: str, tooltip: str, action: Callable[[], object], key: str = "") -> gui.Button:
        button = gui.Button(f"{icon(key or text.lower())} {text}".strip())
        self._hint(button, tooltip)
        button.vertical_padding_em = 0.05
        button.horizontal_padding_em = 0.42
        button.background_color = color(RAISED)
        button.set_on_clicked(lambda: self._did(action))
        self._add(key or text.lower(), button)
        return button

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

    def _update_volume(self) -> bool:
        audio = self._player.audio
        tooltip = SOUND if audio is None else audio.message or SOUND
        volume = 0.0 if audio is None else audio.volume
        name = min(VOLUMES, key=lambda one: abs(VOLUMES[one] - volume))
        changed = self._volume.selected_text != name or self._sound_hint != tooltip
        if changed:
            self._volume.selected_text, self._sound_hint = name, tooltip
            self._hint(self._volume, tooltip)
        return changed

    def _labels(self) -> dict[str, str]:
        """What the list says of each camera."""
        held_out = self._player.held_out
        return {name: f"{name}, held out" if name in held_out else name for name in self._player.camera_names}

    def update(self) -> tuple[bool, bool]:
        """Show the state of the player; return (whether a widget changed, whether a layout is due)."""
        changed = layout = False
        transport = self._player.transport
        self.symbols["play"].name = "pause" if transport.playing else "play"
        if self._loop.checked != transport.loop:
            self._loop.checked = transport.loop
            changed = True
        speed = next((name for name, value in SPEEDS.items() if value == transport.speed), "1x")
        if self._speed.selected_text != speed:
            self._speed.selected_text = speed
            changed = True
        labels = self._labels()
        if list(labels.items()) != list(self._cameras.items()):
            self._cameras = labels
            self._camera.clear_items()
            for label in (FREE, *labels.values()):
                self._camera.add_item(label)
            changed = layout = True
        camera = labels.get(self._player.camera, FREE)
        if self._camera.selected_text != camera and self._camera.number_of_items:
            self._camera.selected_text = camera
            changed = True
        enabled = self._player.opened is not None
        changed |= self._update_volume()
        # what cannot be used takes no room: in a narrow window it would cost a line
        for widget, there in ((self._volume, self._player.audio is not None), (self._camera, bool(labels))):
            if widget.visible != there:
                widget.visible = there
                changed = layout = True
        for widget in self.buttons.values():
            if widget.enabled != enabled:
                widget.enabled = enabled
                changed = True
        for button in self.symbols.values():
            changed |= button.update()
        return changed, layout
