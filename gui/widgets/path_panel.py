"""The panel of the camera path: its views as a list, instead of the inspector."""

from collections.abc import Callable, Sequence

import numpy as np
from open3d.visualization import gui

from gui.models.camera_path import PathEditor
from gui.widgets.path_list import HINTS, PathList
from gui.widgets.picture import ImagePanel


class PathPanel:
    """See the module. `act`: called with what was clicked, a key of `drawing.path_list.HINTS`, and the view or -1."""

    def __init__(
        self, em: float, editor: PathEditor, act: Callable[[str, int], None], changed: Callable[[], None]
    ) -> None:
        self._em, self._editor, self._act, self._changed = em, editor, act, changed
        self.shown = False
        self.picture = ImagePanel(self._on_mouse)
        self.picture.widget.visible = False
        self._down = 0.0
        self._list = PathList(16, 16, em)
        self._drawn: object = None

    @property
    def thumbnail_size(self) -> tuple[int, int]:
        """(width, height) of a thumbnail, pixels."""
        return self._list.thumbnail_size

    @property
    def places(self) -> dict[str, list[float]]:
        """The middle of what can be clicked, 0 to 1 across and down the panel, by name and row."""
        middles = self._list.areas.middles(self.picture.size)
        return {f"{name} {row}" if row >= 0 else name: at for (name, row), at in middles.items()}

    def update(self, thumbnails: Sequence[np.ndarray | None], previewing: bool) -> bool:
        """Draw what has changed; returns whether anything did. `thumbnails`: None while one is being drawn."""
        if not self.picture.widget.visible:
            return False
        editor, size = self._editor, self.picture.size
        state = (
            size, editor.keys, editor.selected, editor.error, previewing, self._down,
            [id(one) for one in thumbnails],
        )  # fmt: skip
        if state == self._drawn:
            return False
        self._drawn = state
        self._list = PathList(*size, self._em, self._down)
        self._down = self._list.down = min(self._down, self._list.most_down(len(editor.keys)))
        self.picture.show(self._list.draw(editor.keys, thumbnails, editor.selected, previewing, editor.error))
        return True

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        if event.type == kind.WHEEL:
            most = self._list.most_down(len(self._editor.keys))
            self._down = min(max(self._down - 2 * self._em * event.wheel_dy, 0.0), most)
            self._changed()
            return True
        found = self._list.areas.at(x, y)
        if event.type == kind.MOVE:
            self.picture.widget.tooltip = HINTS[found[0]] if found is not None else ""
        if event.type != kind.BUTTON_DOWN or found is None:
            return False
        self._act(*found)
        self._changed()
        return True
