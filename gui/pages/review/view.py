"""EditView: the trained frame with its edits on screen; drags handles, draws strokes, picks points."""

from collections.abc import Hashable

import numpy as np

from v3studio.gui.models.scene.handles import Handle, grabbed, picked
from v3studio.gui.pages.review.editor import Editor
from v3studio.gui.pages.review.frame import EditedFrame
from v3studio.gui.pages.review.handles import DRAGGED, dragged, tool_handles
from v3studio.gui.pages.review.histogram import HistogramPlace
from v3studio.gui.pages.review.picture import Shown, draw_edits, with_circle
from v3studio.gui.pages.review.tools import PICKS, Stroke, Tool
from v3studio.gui.pages.stage_view import Size, StageView
from v3studio.studio.cameras import Camera
from v3studio.studio.edits.edit_list import EditList

NOBODY = "There are no splats under the pointer. Click on the performer."


class EditView(StageView):
    """Shows what an editor edits, from its viewpoint, but always in the free view."""

    def __init__(self, editor: Editor) -> None:
        super().__init__(editor.workspace)
        self.editor, self.viewpoint = editor, editor.viewpoint
        editor.tool_chosen.connect(self._let_go)
        self._plain: np.ndarray | None = None
        self._circle: tuple[float, float, float] | None = None
        self._stroke: Stroke | None = None
        self._handle: Handle | None = None
        self._from = (0.0, 0.0)
        self._limiting = False
        self._dragged = EditList()
        self._size: Size = (960, 540)
        self._edited = EditedFrame()
        self._measured = editor.measured

    def _let_go(self) -> None:
        self._stroke = self._handle = None

    # Gestures

    @property
    def orbits(self) -> bool:
        return True

    def drag(self, dx: float, dy: float, turn: bool, height: int) -> None:
        self.viewpoint.look_through("")
        self.viewpoint.drag(dx, dy, turn, height)

    def wheel(self, x: float, y: float, notches: float) -> None:
        self.viewpoint.look_through("")
        self.viewpoint.wheel(x, y, notches)

    def reset(self) -> None:
        self.viewpoint.look_through("")
        self.viewpoint.reset()

    def grabs(self, x: float, y: float) -> bool:
        """Whether a press at a pixel grabs a handle or begins to draw."""
        editor, view = self.editor, self._camera
        if editor.tool == Tool.FLOATERS and self._histogram.holds(x, y):
            self._limiting = True
            editor.limit_opacity(self._histogram.opacity_at(x))
            return True
        if editor.draws:
            editor.pending = None
            self._stroke = Stroke(((x, y),), None if editor.tool == Tool.LASSO else editor.brush * view.height)
            return True
        self._dragged = editor.pending or editor.edits
        self._handle, self._from = grabbed(self.handles(self._dragged), view, x, y), (x, y)
        return self._handle is not None

    def pull(self, x: float, y: float) -> None:
        """Drag what was grabbed to a pixel."""
        if self._limiting:
            self.editor.limit_opacity(self._histogram.opacity_at(x))
        elif self._stroke is not None:
            last = self._stroke.points[-1]
            if abs(x - last[0]) + abs(y - last[1]) >= 2:
                self._stroke = Stroke((*self._stroke.points, (x, y)), self._stroke.radius)
        elif self._handle is not None:
            distance = self._handle.distance(self._camera, self._from, (x, y))
            self.editor.pending = dragged(self._dragged, self._handle, distance)

    def release(self) -> None:
        """Let go: a drag is written, a drawing selects."""
        editor, stroke, handle = self.editor, self._stroke, self._handle
        self._limiting = False
        self._let_go()
        if stroke is not None:
            editor.select(stroke, self._camera)
        elif handle is not None and editor.pending is not None and editor.pending != editor.edits:
            editor.commit(editor.pending, DRAGGED[editor.tool])

    def click(self, x: float, y: float) -> None:
        if self.editor.tool not in PICKS:
            return
        point = picked(self._camera, self.editor.measured.seen, x, y)
        if point is None:
            self.editor.refuse(NOBODY)
        else:
            self.editor.pick(point, self._camera.center)

    def handles(self, edits: EditList) -> list[Handle]:
        """The handles of these edits for the current tool."""
        editor = self.editor
        number = editor.numbers.number(self.frame)
        return tool_handles(editor.tool, edits, self._camera, editor.measured.seen, number, editor.up)

    @property
    def _camera(self) -> Camera:
        return self.viewpoint.orbit.camera(*self._size)

    @property
    def _histogram(self) -> HistogramPlace:
        return HistogramPlace(self._size, self.em)

    # The image

    def poll(self, size: Size) -> np.ndarray | None:
        self._size, self.editor.frame = size, self.frame
        self.editor.suggest()
        pixels = self._newest(size)
        if self.editor.suggest():  # from what was just drawn
            again = self._newest(size)
            pixels = pixels if again is None else again
        return self._with_brush(pixels)

    def _newest(self, size: Size) -> np.ndarray | None:
        pixels = super().poll(size)
        if pixels is not None:
            self.editor.measured = self._measured
        return pixels

    def _with_brush(self, pixels: np.ndarray | None) -> np.ndarray | None:
        """The new image, or the last one if the pointer has moved, with a circle where the brush is; None if nothing
        has changed. The splats are not drawn again for it."""
        self._plain = pixels if pixels is not None else self._plain
        if self._plain is None:
            return None
        height, width = self._plain.shape[:2]
        circle, editor = None, self.editor
        if editor.tool == Tool.BRUSH and editor.pointer is not None:
            circle = (editor.pointer[0] * width, editor.pointer[1] * height, editor.brush * height)
        before, self._circle = self._circle, circle
        if pixels is None and circle == before:
            return None
        return self._plain if circle is None else with_circle(self._plain, *circle)

    def show_again(self) -> None:
        super().show_again()
        self._plain = self._circle = None

    def state(self) -> Hashable:
        editor, orbit = self.editor, self.viewpoint.orbit
        return Shown(
            frame=self.frame, view=orbit.key, orbit=orbit, tool=editor.tool, show_removed=editor.show_removed,
            edits=editor.edits, pending=editor.pending, stroke=self._stroke, clicks=editor.clicks,
            held=self._handle.name if self._handle is not None else "", up=tuple(editor.up.tolist()),
            background=self.viewpoint.background, trained=editor.group_ends[-1], em=self.em,
        )  # fmt: skip

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        assert isinstance(state, Shown)
        self._edited.read(self.workspace.take, state.frame)
        pixels, self._measured = draw_edits(self._edited, state, size)
        return pixels

    @property
    def status(self) -> str:
        return self.editor.status
