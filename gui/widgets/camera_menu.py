"""A menu at the pointer: what is known about a camera, and what can be done with it."""

from collections.abc import Callable, Sequence

from open3d.visualization import gui

from v3studio.gui.drawing.palette import TEXT
from v3studio.gui.widgets.picture import make_button, make_card, make_label

Item = tuple[str, str, Callable[[], object]]  # key, label, action


class CameraMenu:
    """A menu as a widget over the viewport: the toolkit has no context menus."""

    def __init__(self, em: float, changed: Callable[[], None]) -> None:
        self._em, self._changed = em, changed
        self._at = (0.0, 0.0)
        self.camera = ""
        self.buttons: dict[str, gui.Button] = {}
        self.widget, self._content = make_card(em)

    def open(
        self, at: tuple[float, float], camera: str, use: str, facts: Sequence[tuple[str, str]], items: Sequence[Item]
    ) -> None:
        """Show the menu at the pointer, window pixels. `facts`: (name, value). `items`: what can be done."""
        em = self._em
        self.camera, self._at, self.buttons = camera, at, {}
        column = gui.Vert(round(0.3 * em))
        for line in (f"{camera}, {use}", *(f"{name}: {value}" for name, value in facts)):
            column.add_child(make_label(line, TEXT))
        for key, label, action in items:
            self.buttons[key] = make_button(label, self.close, action, self._changed, pad=0.5)
            column.add_child(self.buttons[key])
        self._content.set_widget(column)
        self.widget.visible = True

    def close(self) -> bool:
        """Close it; returns whether it was open."""
        was_open = self.camera != ""
        self.camera, self.buttons = "", {}
        self.widget.visible = False
        return was_open

    def place(self, context: gui.LayoutContext, area: gui.Rect) -> None:
        """Place it at the pointer, inside `area` (window pixels)."""
        wanted = self.widget.calc_preferred_size(context, gui.Widget.Constraints())
        x = max(min(self._at[0], area.x + area.width - wanted.width), area.x)
        y = max(min(self._at[1], area.y + area.height - wanted.height), area.y)
        self.widget.frame = gui.Rect(int(x), int(y), int(wanted.width), int(wanted.height))
