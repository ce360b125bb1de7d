"""EditView: the trained frame with its edits; draws, drags handles, lassoes and picks points."""

from bisect import bisect_right
from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import pairwise

import numpy as np

from v3studio.gui.drawing import compare
from v3studio.gui.drawing.canvas import Canvas, wrapped
from v3studio.gui.drawing.palette import ACCENT, DIM, FAIR, TEXT
from v3studio.gui.models.history import Change
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.playback.viewpoint import BACKGROUNDS, Viewpoint
from v3studio.gui.models.scene.compose import SplatLayer, draw_layer
from v3studio.gui.models.scene.contents import Lines, axis_lines, box_lines, grid_lines
from v3studio.gui.models.scene.handles import (
    Handle,
    crop_handles,
    default_crop,
    default_ground,
    grabbed,
    ground_handle,
    moved_crop,
    picked,
    up_of,
)
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.review import picture
from v3studio.gui.pages.review.details import detail_handles, detail_lines, marked, resized
from v3studio.gui.pages.review.frame import EditedFrame
from v3studio.gui.pages.review.histogram import HistogramPlace, draw_histogram
from v3studio.gui.pages.review.picture import Stroke
from v3studio.gui.pages.review.tools import BRUSH, BRUSH_STEP, LEAST_BRUSH, MOST_BRUSH, TOOLS, hint
from v3studio.gui.pages.stage_view import Size, StageView
from v3studio.pipelines.takes.edits import change_edits, describe
from v3studio.pipelines.takes.frame_numbers import FrameNumbers
from v3studio.pipelines.takes.take import Take
from v3studio.studio.cameras import Camera
from v3studio.studio.counts import counted
from v3studio.studio.edits.edit_list import MOST_POINTS, EditList, Floaters, Region, RegionView, Trim, World
from v3studio.studio.errors import StudioError

NOBODY = "There are no splats under the pointer. Click on the performer."

_DRAGGED = {"crop": "crop box", "ground": "ground plane", "detail": "size of a detail"}
"""What a drag with a tool changes."""


@dataclass(frozen=True)
class _State:
    """What the image depends on."""

    frame: int
    view: tuple[float, ...]
    orbit: OrbitCamera = field(compare=False)  # with `view` as its key
    tool: str
    show_removed: bool
    edits: EditList
    pending: EditList | None
    stroke: Stroke | None
    clicks: tuple[tuple[float, ...], ...]
    held: str
    background: str
    trained: int
    em: float


class EditView(StageView):
    """See the module. `viewpoint`: of Review, from where the edits are seen, but always in the free view."""

    def __init__(self, workspace: Workspace, viewpoint: Viewpoint) -> None:
        super().__init__(workspace)
        self.viewpoint = viewpoint
        # emitted with the frames of the group in which splats are selected, to ask for those in which they are to be
        # removed (`remove_selected`)
        self.range_wanted: Signal[[range]] = Signal()
        self.tool, self.show_removed = "look", False
        self.pending: EditList | None = None  # the edits with what is selected or being dragged; None if nothing is
        self.clicks: tuple[tuple[float, ...], ...] = ()  # picked points, world
        # emitted with two points, whose distance gives the scale
        self.two_points: Signal[[np.ndarray, np.ndarray]] = Signal()
        self.refusal: Signal[[str]] = Signal()  # emitted with why a change is refused, or what to do
        self.numbers = FrameNumbers()
        self.brush = BRUSH  # radius of the brush, relative to the height of the image
        # where the pointer is over the image, relative to its width and height; None elsewhere
        self.pointer: tuple[float, float] | None = None
        self._plain: np.ndarray | None = None
        self._circle: tuple[float, float, float] | None = None
        self._stroke: Stroke | None = None
        self._handle: Handle | None = None
        self._from = (0.0, 0.0)
        self._limiting = False
        self._dragged: EditList | None = None
        self._size: Size = (960, 540)
        self._edited = EditedFrame()
        self._proposed: Floaters | None = None
        self._seen = np.zeros((0, 3))
        self.counts: dict[str, int] = {}

    # What is edited

    @property
    def edits(self) -> EditList:
        """The edits of the open take; none if no take is open, or they cannot be read."""
        try:
            context = self.workspace.context
            return context.edits if context is not None else EditList()
        except StudioError:
            return EditList()

    @property
    def up(self) -> np.ndarray:
        """(3,) up in the world of the capture."""
        opened = self.viewpoint.opened
        return up_of(self.edits, opened.up if opened is not None else np.array([0.0, 0.0, 1.0]))

    def choose_tool(self, tool: str) -> None:
        """Take another tool; what was selected but not removed is let go."""
        self.tool, self.clicks, self._stroke, self._handle, self.pending = tool, (), None, None, None
        self._proposed = None
        self._suggest()

    def step_brush(self, steps: int) -> None:
        """Make the brush larger, or smaller, by a number of steps."""
        self.brush = min(max(self.brush * BRUSH_STEP**steps, LEAST_BRUSH), MOST_BRUSH)

    def _suggest(self) -> bool:
        """Begin with a box around the performer, a plane under the feet, limits of floaters. Returns whether it did."""
        edits, points, opened = self.edits, self._seen, self.viewpoint.opened
        if opened is not None:
            points = np.concatenate([points, opened.reach])
        if self.pending is not None:
            return False
        if self.tool == "crop" and edits.crop is None and len(points):
            self.pending = edits.with_(crop=default_crop(points, edits, self.up))
        elif self.tool == "ground" and edits.ground is None and len(points):
            self.pending = edits.with_(ground=default_ground(points, self.up))
        elif self.tool == "floaters" and (edits.floaters or self._proposed) is not None:
            self.pending = edits.with_(floaters=edits.floaters or self._proposed)
        return self.pending is not None

    def press(self, key: str) -> None:
        """Press a button that needs no dialog."""
        if key in TOOLS:
            self.choose_tool(key)
        elif key == "removed":
            self.show_removed = not self.show_removed
        elif key in ("in", "out"):
            self._trim(key)
        elif key == "remove":
            self._remove()

    @property
    def pressed_buttons(self) -> set[str]:
        return {self.tool, *(["removed"] if self.show_removed else [])}

    @property
    def idle_buttons(self) -> set[str]:
        """Buttons that would do nothing now. Limits may select in other groups only, or bring splats back."""
        nothing = self.pending is None or self.pending == self.edits
        return {"remove"} if nothing or (self._draws and not self.counts.get("selected")) else set()

    @property
    def _draws(self) -> bool:
        return self.tool in ("lasso", "brush")

    def _remove(self) -> None:
        """Remove what is selected; ask first in which frames if it was drawn and there are several groups."""
        edits = self.pending
        if edits is None or self.idle_buttons:
            self._refuse("Nothing is selected.")
            return
        if not self._draws:
            self.commit(edits, self.tool)
            return
        *starts, count = self._group_ends()
        drawn = self.numbers.index(edits.regions[-1].drawn or 0) or 0
        group = bisect_right(starts, drawn) - 1
        if len(starts) == 1:
            self.remove_selected(None)
        else:
            self.range_wanted.emit(range(starts[group], (*starts, count)[group + 1]))

    def remove_selected(self, frames: tuple[int, int] | None) -> None:
        """Remove what a lasso or the brush has selected, in the whole groups of `frames`; None: in all."""
        if self.pending is not None:
            self.commit(self.reaching(frames), f"{self.tool} removal")

    def reaching(self, frames: tuple[int, int] | None) -> EditList:
        """The edits with what a lasso or the brush has selected, removed in the whole groups of `frames`."""
        edits = self.pending or self.edits
        *others, last = edits.regions
        return edits.with_(regions=(*others, last.model_copy(update={"frames": frames})))

    def commit(self, edits: EditList, words: str) -> str:
        """Write the edits as one change to undo; returns why that was refused, "" if it was not."""
        before, self.pending = self.edits, None
        undo = partial(self._write, edits, before, f"undo: {words}")
        redo = partial(self._write, before, edits, words)
        refused = ""
        try:
            if edits != before:
                redo()
                self.workspace.history.add(Change(words, undo, redo))
        except StudioError as error:
            refused = self._refuse(str(error))
        if self.tool == "floaters":
            self.tool = "look"
        return refused

    def _write(self, before: EditList, edits: EditList, words: str) -> None:
        take = self.workspace.take
        if take is None or self.workspace.context is None:
            raise StudioError("edits.no_take", "no take with readable settings is open", fix="Open a take first.")
        change_edits(take.edits, edits, words, before)
        self.workspace.inputs_changed()

    def _refuse(self, why: str) -> str:
        self.refusal.emit(why)
        return why

    def _trim(self, key: str) -> None:
        whole = Trim(first=self.numbers.number(0), last=self.numbers.number(max(self._group_ends()[-1] - 1, 0)))
        frame, now = self.numbers.number(self.frame), self.edits.trim or whole
        first, last = (frame, now.last) if key == "in" else (now.first, frame)
        if first > last:
            first, last = (first, whole.last) if key == "in" else (whole.first, last)
        trim = Trim(first=first, last=last)
        self.commit(self.edits.with_(trim=None if trim == whole else trim), f"trim to frames {first} to {last}")

    def set_scale(self, start: np.ndarray, end: np.ndarray, distance: float) -> str:
        """Scale the world so that two points are `distance` apart; returns why that was refused, "" if it was not."""
        apart = float(np.linalg.norm(end - start))
        if not (apart > 0 and distance > 0):
            return self._refuse("The points must differ, and the distance must be above 0.")
        world = self.edits.world or World()
        try:
            scaled = World.model_validate(world.model_dump() | {"scale": distance / apart})
        except ValueError:
            return self._refuse("The scale must be from 0.000001 to 1000000.")
        self.clicks = ()
        return self.commit(self.edits.with_(world=scaled), f"scale {scaled.scale:.4g}")

    # Gestures

    @property
    def orbits(self) -> bool:
        return True

    def _free_view(self) -> Viewpoint:
        """The viewpoint, which has left a capture camera."""
        if self.viewpoint.camera:
            self.viewpoint.look_through("")
        return self.viewpoint

    def drag(self, dx: float, dy: float, turn: bool, height: int) -> None:
        self._free_view().drag(dx, dy, turn, height)

    def wheel(self, x: float, y: float, notches: float) -> None:
        self._free_view().wheel(x, y, notches)

    def reset(self) -> None:
        self._free_view().reset()

    def grabs(self, x: float, y: float) -> bool:
        """Whether a press at a pixel grabs a handle or begins to draw."""
        if self.tool == "floaters" and self._histogram.holds(x, y):
            self._limiting = True
            self._limit(x)
            return True
        view = self._view()
        if self._draws:
            self.pending = None
            self._stroke = Stroke(((x, y),), None if self.tool == "lasso" else self.brush * view.height)
            return True
        self._dragged = self.pending or self.edits
        self._handle, self._from = grabbed(self.handles(self._dragged), view, x, y), (x, y)
        return self._handle is not None

    def pull(self, x: float, y: float) -> None:
        """Drag what was grabbed to a pixel."""
        if self._limiting:
            self._limit(x)
            return
        if self._stroke is not None:
            last = self._stroke.points[-1]
            if abs(x - last[0]) + abs(y - last[1]) >= 2:
                self._stroke = Stroke((*self._stroke.points, (x, y)), self._stroke.radius)
            return
        handle, edits = self._handle, self._dragged
        if handle is None or edits is None:
            return
        distance = handle.distance(self._view(), self._from, (x, y))
        if handle.name == "ground" and edits.ground is not None:
            ground = edits.ground.model_copy(update={"height": edits.ground.height + distance})
            self.pending = edits.with_(ground=ground)
        elif handle.name.startswith("detail"):
            self.pending = resized(edits, handle, distance)
        elif edits.crop is not None:
            self.pending = edits.with_(crop=moved_crop(edits.crop, handle, distance))

    def release(self) -> None:
        """Let go: a drag is written, a drawing selects."""
        self._limiting = False
        stroke, self._stroke = self._stroke, None
        if stroke is not None:
            self._select(stroke)
        elif self._handle is not None:
            self._handle = None
            if self.pending is not None and self.pending != self.edits:
                self.commit(self.pending, _DRAGGED[self.tool])

    @property
    def _histogram(self) -> HistogramPlace:
        return HistogramPlace(self._size, self.em)

    def _limit(self, x: float) -> None:
        """Select splats below the opacity at a column of the histogram, besides what other limits select."""
        edits = self.pending or self.edits
        floaters = edits.floaters or Floaters(opacity=1.0)
        limits = floaters.model_copy(update={"opacity": self._histogram.opacity_at(x)})
        self.pending = edits.with_(floaters=limits)

    def _select(self, stroke: Stroke) -> None:
        edits, points = self.edits, stroke.points
        if len(points) < (3 if stroke.radius is None else 1):
            return
        points, number = points[:: -(-len(points) // MOST_POINTS)], self.numbers.number(self.frame)
        try:
            region = Region(
                view=RegionView.of(self._view()), outline=points, radius=stroke.radius, drawn=number,
                frames=(number, number),
            )  # fmt: skip
            self.pending = edits.with_(regions=(*edits.regions, region))
        except ValueError:
            self._refuse("There are too many regions already. Take some back with List.")

    def click(self, x: float, y: float) -> None:
        if self.tool == "detail":
            self._mark_detail(x, y)
        if self.tool not in ("origin", "up", "scale"):
            return
        point = picked(self._view(), self._seen, x, y)
        if point is None:
            self._refuse(NOBODY)
            return
        edits = self.edits
        world = edits.world or World()
        if self.tool == "origin":
            self.commit(edits.with_(world=world.model_copy(update={"origin": tuple(point.tolist())})), "origin")
            return
        self.clicks = (*self.clicks[-1:], tuple(point.tolist())) if len(self.clicks) < 2 else (tuple(point.tolist()),)
        if len(self.clicks) < 2:
            return
        start, end = (np.array(one) for one in self.clicks)
        if np.linalg.norm(end - start) < 1e-9:
            self.clicks = self.clicks[:1]
        elif self.tool == "scale":
            self.two_points.emit(start, end)
        else:
            up = (end - start) / np.linalg.norm(end - start)
            if not self.commit(edits.with_(world=world.model_copy(update={"up": tuple(up.tolist())})), "up"):
                self.clicks = ()
                viewpoint = self._free_view()
                orbit = viewpoint.orbit
                viewpoint.orbit = OrbitCamera.from_to(orbit.eye, orbit.target, up, orbit.fov)

    def _mark_detail(self, x: float, y: float) -> None:
        take, edits = self.workspace.take, self.edits
        if take is None:
            return
        try:
            frame = min(self.frame, max(self._group_ends()[-1] - 1, 0))
            mark = marked(take, self.numbers.number(frame), self._view(), self._seen, x, y)
            if mark is None:
                self._refuse(NOBODY)
                return
            after = edits.with_(details=(*edits.details, mark))
        except StudioError as error:
            self._refuse(str(error.message))
            return
        except ValueError:
            self._refuse("There are too many details already. Take some back with List.")
            return
        self.commit(after, f"detail {len(after.details)}")

    # The image

    def _view(self) -> Camera:
        return self.viewpoint.orbit.camera(*self._size)

    def handles(self, edits: EditList) -> list[Handle]:
        """What can be dragged with the current tool, of these edits."""
        if self.tool == "crop" and edits.crop is not None:
            return [handle for handle in crop_handles(edits.crop) if handle.movable(self._view())]
        if self.tool == "ground" and edits.ground is not None and len(self._seen):
            return [ground_handle(edits.ground, np.median(self._seen, axis=0))]
        if self.tool == "detail":
            found = detail_handles(edits, self.numbers.number(self.frame), self.up)
            return [one for one in found if one.movable(self._view())]
        return []

    def _group_ends(self) -> tuple[int, ...]:
        """First trained frame of each group, and the number of all."""
        take = self.workspace.take
        return _group_ends(take, self.workspace.run.results) if take is not None else (0,)

    def poll(self, size: Size) -> np.ndarray | None:
        self._size = size
        self._suggest()
        found = super().poll(size)
        if self._suggest():  # from what was just drawn
            again = super().poll(size)
            found = found if again is None else again
        return self._with_brush(found)

    def _with_brush(self, found: np.ndarray | None) -> np.ndarray | None:
        """The new image, or the last one if the pointer has moved, with a circle where the brush is; None if nothing
        has changed. The splats are not drawn again for it."""
        self._plain = found if found is not None else self._plain
        if self._plain is None:
            return None
        high, wide = self._plain.shape[:2]
        circle = None
        if self.tool == "brush" and self.pointer is not None:
            circle = (self.pointer[0] * wide, self.pointer[1] * high, self.brush * high)
        before, self._circle = self._circle, circle
        if found is None and circle == before:
            return None
        return self._plain if circle is None else picture.with_circle(self._plain, *circle)

    def show_again(self) -> None:
        super().show_again()
        self._plain = self._circle = None

    def state(self) -> Hashable:
        orbit, background = self.viewpoint.orbit, self.viewpoint.background
        return _State(
            self.frame, orbit.key, orbit, self.tool, self.show_removed, self.edits, self.pending, self._stroke,
            self.clicks, self._handle.name if self._handle is not None else "", background, self._group_ends()[-1],
            self.em,
        )  # fmt: skip

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        assert isinstance(state, _State)
        edited = self._edited
        edited.read(self.workspace.take, state.frame)
        found = edited.selection(state.edits)
        removed = found.removed
        selected = back = np.zeros_like(removed)
        if state.pending is not None:
            pending = edited.selection(state.pending).removed
            selected, back = pending & ~removed, removed & ~pending
        elif state.tool == "floaters":
            self._proposed = edited.proposed_floaters(state.edits)
        self._seen = edited.seen(removed)
        sums = {"removed": removed, "selected": selected, "back": back}
        self.counts = found.counts | {name: int(one.sum()) for name, one in sums.items()}
        view = state.orbit.camera(*size)
        shown = picture.colored(edited.gaussians, removed, selected, state.show_removed)
        splats = draw_layer(shown, view)
        canvas = self._drawn(view, state, splats, edited.paths.means[edited.at][selected])
        if state.tool == "floaters":
            limits = (state.pending or state.edits).floaters
            kept = ~np.any([found.kinds[name] for name in ("crop", "ground", "regions")], axis=0)
            opacities, limit = edited.paths.opacities.max(axis=0)[kept], limits.opacity if limits is not None else None
            draw_histogram(canvas, HistogramPlace(size, state.em), opacities, limit)
        self._say(canvas, state)
        return canvas.pixels

    def _say(self, canvas: Canvas, state: _State) -> None:
        """Write what is kept, and what to do next."""
        edited, size = self._edited, round(0.9 * state.em)
        trim, total = state.edits.trim, len(edited.gaussians)
        number = edited.paths.frames[edited.at]
        outside = "   trimmed off" if trim is not None and not trim.holds(number) else ""
        kept = total - self.counts["removed"]
        words = f"group {edited.group.index}: {kept:,} of {counted(total, 'splat')} kept{outside}"
        compare.label(canvas, 0.6 * state.em, 0.6 * state.em, words, size=size)
        pending, selected, back = state.pending, self.counts["selected"], self.counts["back"]
        floaters = pending.floaters if pending is not None else None
        in_use = floaters is not None and floaters == state.edits.floaters
        words = hint(state.tool, None if pending is None else selected, back, floaters, in_use)
        color = FAIR if pending is not None and selected + back else TEXT
        lines = wrapped(words, size, canvas.width - 2 * state.em) if words else []
        for number, line in enumerate(lines):
            compare.label(canvas, 0.6 * state.em, (2.5 + 1.6 * number) * state.em, line, color=color, size=size)

    def _drawn(self, view: Camera, state: _State, splats: SplatLayer, selected: np.ndarray) -> Canvas:
        edits, back = state.pending or state.edits, (state.pending or state.edits).similarity.inverse
        seen = self._seen if len(self._seen) else np.zeros((1, 3))
        middle, reach = np.median(seen, axis=0), float(np.linalg.norm(np.ptp(seen, axis=0))) or 1.0
        colors = {state.tool: ACCENT}  # of what the tool changes
        within = []
        if edits.ground is not None:
            grid, _ = grid_lines(middle, edits.ground.unit, edits.ground.height, 0.6 * reach)
            within.append(Lines.of(grid.ends, colors.get("ground", DIM)))
        if edits.crop is not None:
            within.append(box_lines(edits.crop.corners, colors.get("crop", DIM), 2.0 if state.tool == "crop" else 1.0))
        frame, color = self._edited.paths.frames[self._edited.at], colors.get("detail", DIM)
        over = [detail_lines(mark, frame, view.center, color) for mark in edits.details]
        over.append(Lines.of(np.array(list(pairwise(state.clicks))), FAIR, 2.0))
        axes = axis_lines(back.points(np.zeros(3)), back.directions(np.eye(3)), 0.25 * reach)
        shows_axes = edits.world is not None or state.tool in ("origin", "up", "scale")
        over += [axes] if shows_axes else []
        canvas = picture.composed(view, splats, BACKGROUNDS[state.background], within, over, selected)
        if shows_axes:
            picture.draw_names(canvas, view, axes)
        picture.draw_clicks(canvas, view, state.clicks)
        picture.draw_handles(canvas, view, self.handles(edits), state.held)
        if state.stroke is not None:
            picture.draw_stroke(canvas, state.stroke)
        return canvas

    @property
    def status(self) -> str:
        found = describe(self.edits)
        if not found:
            return "No edits yet. Edits change what is baked and exported."
        # in a narrow window, more would not fit; List shows all
        words = {kind: counted(len(getattr(self.edits, kind)), kind[:-1]) for kind in ("regions", "details")}
        words |= {"trim": f"trim to {found.get('trim')}", "regions": f"{words['regions']} removed"}
        kinds = dict.fromkeys(name.partition(" ")[0] for name in found)
        return f"Edits: {', '.join(words.get(kind, kind) for kind in kinds)}"


@lru_cache(maxsize=1)
def _group_ends(take: Take, results: int) -> tuple[int, ...]:
    """See `EditView`; `results` changes with the trained frames."""
    files, starts = take.trained_files()
    return (*starts, len(files))
