"""NumPy images in Open3D's image widget."""

from collections.abc import Callable

import numpy as np
import open3d as o3d
from open3d.visualization import gui

from v3studio.gui.drawing.canvas import glyph_height, text_width
from v3studio.gui.drawing.palette import GROUND, LINE, RAISED, RGB

DRAWS_BEFORE_EXACT = 2  # draws of the window after which the texture of a new image exists

FIELD_PADDING = 3
"""Pixels between the top of a field and that of its text, at any font size (`FramePadding` of Dear ImGui); the toolkit
draws a label's text at its top."""

NOTHING = gui.Color(0, 0, 0, 0)
"""Background of what needs none: the toolkit's default covers the widget, at a software renderer's cost of an image."""

_random = np.random.default_rng()  # Flips lowest bits, so that no two new images are equal. Never part of a result


def as_image(pixels: np.ndarray) -> o3d.geometry.Image:
    """An Open3D image of (H, W, 3) uint8 RGB. With four channels, the widget would blend with what is below it."""
    return o3d.geometry.Image(np.ascontiguousarray(pixels))


def color(value: RGB) -> gui.Color:
    return gui.Color(value[0] / 255, value[1] / 255, value[2] / 255)


def put(widget: gui.Widget, **values: object) -> bool:
    """Set attributes of a widget that have other values; returns whether any had."""
    others = {name: value for name, value in values.items() if getattr(widget, name) != value}
    for name, value in others.items():
        setattr(widget, name, value)
    return bool(others)


def make_label(text: str, text_color: RGB, ground: RGB | None = None) -> gui.Label:
    """A label, with an opaque background if one is given."""
    label = gui.Label(text)
    label.text_color = color(text_color)
    if ground is not None:
        label.background_color = color(ground)
    return label


def make_button(text: str, *actions: Callable[[], object], pad: float = 0.7, pad_y: float = 0.1) -> gui.Button:
    """A button that does these, one after the other. `pad`: beside its text; `pad_y`: above and below it; em."""
    button = gui.Button(text)
    button.horizontal_padding_em, button.vertical_padding_em = pad, pad_y
    button.background_color = color(RAISED)

    def clicked() -> None:
        for action in actions:
            action()

    button.set_on_clicked(clicked)
    return button


def make_card(em: float) -> tuple[gui.Vert, gui.WidgetProxy]:
    """A hidden container over the view, and what is to be given its content. It must not overlap other containers."""
    card, content = gui.Vert(0, gui.Margins(*(round(side * em) for side in (0.7, 0.6, 0.7, 0.6)))), gui.WidgetProxy()
    card.background_color = color(LINE)
    card.add_child(content)
    card.visible = False
    return card, content


def holds(widget: gui.Widget, x: int, y: int) -> bool:
    """Whether a position in the window, pixels, is on a widget."""
    frame = widget.frame
    return bool(frame.x <= x < frame.x + frame.width and frame.y <= y < frame.y + frame.height)


def text_room(text: str, em: float) -> float:
    """Width of a text in a label or a menu, pixels. The toolkit's font size is the height of a line, not of the em."""
    return text_width(text, 100) * em / glyph_height(100)


def lowered(label: gui.Label, down: int = FIELD_PADDING, room: float = 0.0) -> gui.Vert:
    """A label of one line on the baseline of the text beside it, `down` pixels below its top, a field's unless given,
    in a row that is no higher, and `room` pixels wide at least. A label that gets exactly the width that it asks for is
    broken, since the toolkit rounds that down; its row is then two lines high."""
    row = gui.Vert(0, gui.Margins(0, down, 0, -down))
    row.add_child(label)
    if room:
        row.add_child(gui.Horiz(0, gui.Margins(round(room), 0, 0, 0)))
    return row


class ImagePanel:
    """An image widget that shows images pixel for pixel and forwards mouse events.

    Open3D keeps the texture of every image that it has drawn and finds it again by the content that the image had at
    first, whatever it was updated to since. So an image that begins with the content of an earlier one would show what
    that one showed last, and every new image stays in memory. Therefore each starts with content of its own, exact
    pixels follow once it has been drawn (`settle`), and the images of all sizes are kept and reused: dropping one would
    not free its texture, and its size would need another when it comes again.

    `on_mouse`: receives events with the position in the widget (x, y, pixels) and returns whether it handled them.
    `images`: those of an earlier widget, by shape, for one that is made again each time that its dialog opens: the
    toolkit deletes the widgets of a closed dialog, while the textures of their images stay. New ones are added.
    """

    def __init__(
        self,
        on_mouse: Callable[[gui.MouseEvent, float, float], bool] | None = None,
        images: dict[tuple[int, ...], gui.UIImage] | None = None,
    ) -> None:
        self.widget = gui.ImageWidget()
        self.widget.background_color = NOTHING
        self._on_mouse = on_mouse
        self._shape: tuple[int, ...] = ()
        self._images = {} if images is None else images
        self._exact: np.ndarray | None = None
        self._draws = 0
        self._of: object = None
        self.show(np.full((16, 16, 3), GROUND, np.uint8))
        if on_mouse is not None:
            self.widget.set_on_mouse(self._mouse)

    def show(self, pixels: np.ndarray) -> None:
        """Show an image, stretched to the widget if their sizes differ."""
        if self._exact is not None and pixels.shape == self._shape:
            self._exact = pixels  # the texture does not exist yet
            return
        self._exact = None
        if pixels.shape != self._shape:  # another size needs another texture
            self._shape = pixels.shape
            image = self._images.get(pixels.shape)
            if image is None:
                image = gui.UIImage(as_image(pixels ^ _random.integers(0, 2, pixels.shape, np.uint8)))
                image.scaling = gui.UIImage.Scaling.ANY
                self._exact, self._draws = pixels, DRAWS_BEFORE_EXACT
                self._images[pixels.shape] = image
            self.widget.ui_image = image
        if self._exact is None:
            self.widget.update_image(as_image(pixels))

    def update(self, state: object, draw: Callable[[], np.ndarray]) -> bool:
        """Show what `draw` returns if `state`, on which it depends, has changed; returns whether it has."""
        if state == self._of:
            return False
        self._of = state
        self.show(draw())
        return True

    def settle(self) -> bool:
        """Show the exact pixels of an image of a new size, at each draw of the window; whether to draw once more."""
        if self._exact is None:
            return False
        self._draws -= 1
        if self._draws <= 0:
            pixels, self._exact = self._exact, None
            self.widget.update_image(as_image(pixels))
        return True

    def place(self, x: float, y: float, width: float, height: float) -> None:
        """Set the widget's rectangle in window pixels."""
        self.widget.frame = gui.Rect(int(x), int(y), max(int(width), 1), max(int(height), 1))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the widget in pixels."""
        return max(int(self.widget.frame.width), 1), max(int(self.widget.frame.height), 1)

    def _mouse(self, event: gui.MouseEvent) -> gui.Widget.EventCallbackResult:
        assert self._on_mouse is not None
        taken = self._on_mouse(event, event.x - self.widget.frame.x, event.y - self.widget.frame.y)
        result = gui.Widget.EventCallbackResult
        return result.CONSUMED if taken else result.IGNORED
