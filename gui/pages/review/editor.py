"""Editor: the edits of the open take, and what the chosen tool is about to change of them."""

from bisect import bisect_right
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from v3studio.gui.models.history import Change
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.playback.viewpoint import Viewpoint
from v3studio.gui.models.scene.handles import default_crop, default_ground, up_of
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.stage_rows import message_text
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.review.handles import marked
from v3studio.gui.pages.review.tools import BRUSH, BRUSH_STEP, DRAWS, LEAST_BRUSH, MOST_BRUSH, Stroke, Tool
from v3studio.pipelines.takes.authored.edits import change_edits, describe
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers
from v3studio.pipelines.takes.take import Take
from v3studio.studio.cameras import Camera
from v3studio.studio.counts import counted
from v3studio.studio.edits.edit_list import (
    MOST_CLICKS,
    MOST_POINTS,
    EditList,
    Floaters,
    Region,
    RegionView,
    Trim,
    World,
)
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.corrections import MaskClick


@dataclass(frozen=True, eq=False)
class Measured:
    """Facts about a frame's splats from drawing it: (M, 3) places of those that are seen, world; numbers of the
    group's splats that the edits remove, that are selected, and that a selection would bring back; limits to propose
    for floaters, None with other tools."""

    seen: np.ndarray
    removed: int = 0
    selected: int = 0
    back: int = 0
    proposed: Floaters | None = None


class Editor:
    """The edits of the open take, the chosen tool, and what it has selected but not changed yet.

    Signals:
        tool_chosen: a tool was chosen, maybe the same one again.
        range_wanted: splats are selected in these frames of a group; `remove_selected` is to be called with those in
            which they are to be removed.
        two_points: two points were picked, (3,) world; `set_scale` is to be called with their distance.
        refusal: a change is refused, for this reason.
    """

    def __init__(self, workspace: Workspace, viewpoint: Viewpoint) -> None:
        self.workspace, self.viewpoint = workspace, viewpoint
        self.tool_chosen: Signal[[]] = Signal()
        self.range_wanted: Signal[[range]] = Signal()
        self.two_points: Signal[[np.ndarray, np.ndarray]] = Signal()
        self.refusal: Signal[[str]] = Signal()
        self.tool, self.show_removed = Tool.ORBIT, False
        self.pending: EditList | None = None  # the edits with what is selected or being dragged; None if nothing is
        self.clicks: tuple[tuple[float, ...], ...] = ()  # picked points, world
        self.frame, self.numbers = 0, FrameNumbers()
        self.brush = BRUSH  # radius of the brush, relative to the height of the image
        # where the pointer is over the image, relative to its width and height; None elsewhere
        self.pointer: tuple[float, float] | None = None
        self.measured = Measured(np.zeros((0, 3)))

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

    @property
    def group_ends(self) -> tuple[int, ...]:
        """First trained frame of each group, and the number of all trained frames."""
        take = self.workspace.take
        return _group_ends(take, self.workspace.run.results) if take is not None else (0,)

    @property
    def status(self) -> str:
        """The edits in a line."""
        descriptions = describe(self.edits)
        if not descriptions:
            return "No edits yet. Edits change what is baked and exported."
        # in a narrow window, more would not fit; List shows all
        words = {kind: counted(len(getattr(self.edits, kind)), kind[:-1]) for kind in ("regions", "details")}
        words |= {"trim": f"trim to {descriptions.get('trim')}", "regions": f"{words['regions']} removed"}
        words["masks"] = counted(len(self.edits.masks), "click") + " on masks"
        kinds = dict.fromkeys(name.partition(" ")[0] for name in descriptions)
        return f"Edits: {', '.join(words.get(kind, kind) for kind in kinds)}"

    # Buttons

    def choose_tool(self, tool: Tool) -> None:
        """Take another tool; what was selected but not removed is let go."""
        self.tool, self.clicks, self.pending = tool, (), None
        self.measured = replace(self.measured, proposed=None)
        self.tool_chosen.emit()
        self.suggest()

    def step_brush(self, steps: int) -> None:
        """Make the brush larger, or smaller, by a number of steps."""
        self.brush = min(max(self.brush * BRUSH_STEP**steps, LEAST_BRUSH), MOST_BRUSH)

    def suggest(self) -> bool:
        """Begin with a box around the performer, a plane under the feet, limits of floaters. Returns whether it did."""
        edits, points, opened = self.edits, self.measured.seen, self.viewpoint.opened
        if opened is not None:
            points = np.concatenate([points, opened.reach])
        if self.pending is not None:
            return False
        floaters = edits.floaters or self.measured.proposed
        if self.tool == Tool.CROP and edits.crop is None and len(points):
            self.pending = edits.with_(crop=default_crop(points, edits, self.up))
        elif self.tool == Tool.GROUND and edits.ground is None and len(points):
            self.pending = edits.with_(ground=default_ground(points, self.up))
        elif self.tool == Tool.FLOATERS and floaters is not None:
            self.pending = edits.with_(floaters=floaters)
        return self.pending is not None

    def press(self, key: str) -> None:
        """Press a button that needs no dialog."""
        if key in tuple(Tool):
            self.choose_tool(Tool[key.upper()])
        elif key == "removed":
            self.show_removed = not self.show_removed
        elif key in ("in", "out"):
            self._trim(key)
        elif key == "remove":
            self._remove()

    @property
    def pressed_buttons(self) -> set[str]:
        """The chosen tool, and what is switched on."""
        return {self.tool, *(["removed"] if self.show_removed else [])}

    @property
    def idle_buttons(self) -> set[str]:
        """Buttons that would do nothing now. Limits may select in other groups only, or bring splats back."""
        nothing = self.pending is None or self.pending == self.edits
        return {"remove"} if nothing or (self.draws and not self.measured.selected) else set()

    @property
    def draws(self) -> bool:
        """Whether the tool selects by drawing on the image."""
        return self.tool in DRAWS

    # Changes

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
            refused = self.refuse(message_text(error))
        if self.tool == Tool.FLOATERS:
            self.tool = Tool.ORBIT
        return refused

    def _write(self, before: EditList, edits: EditList, words: str) -> None:
        take = self.workspace.take
        if take is None or self.workspace.context is None:
            raise StudioError("edits.no_take", "no take with readable settings is open", fix="Open a take first.")
        change_edits(take.edits, edits, words, before)
        self.workspace.inputs_changed()

    def refuse(self, why: str) -> str:
        """Say why something is refused; returns that sentence."""
        self.refusal.emit(why)
        return why

    def correct_mask(self, click: MaskClick) -> None:
        """Add a click that corrects a mask, or take it back if there is the same."""
        clicks = self.edits.masks
        left = tuple(other for other in clicks if other != click)
        where = f"mask of {click.camera}, frame {click.frame}"
        if len(left) == MOST_CLICKS:
            self.refuse("There are too many clicks on masks already.")
        else:
            self.commit(self.edits.with_(masks=left if len(left) < len(clicks) else (*clicks, click)), where)

    def _remove(self) -> None:
        """Remove what is selected; ask first in which frames if it was drawn and there are several groups."""
        edits = self.pending
        if edits is None or self.idle_buttons:
            self.refuse("Nothing is selected.")
            return
        if not self.draws:
            self.commit(edits, self.tool)
            return
        *starts, count = self.group_ends
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

    def _trim(self, key: str) -> None:
        whole = Trim(first=self.numbers.number(0), last=self.numbers.number(max(self.group_ends[-1] - 1, 0)))
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
            return self.refuse("The points must differ, and the distance must be above 0.")
        world = self.edits.world or World()
        try:
            scaled = World.model_validate(world.model_dump() | {"scale": distance / apart})
        except ValueError:
            return self.refuse("The scale must be from 0.000001 to 1000000.")
        self.clicks = ()
        return self.commit(self.edits.with_(world=scaled), f"scale {scaled.scale:.4g}")

    def limit_opacity(self, opacity: float) -> None:
        """Select splats below an opacity, besides what other limits select."""
        edits = self.pending or self.edits
        floaters = edits.floaters or Floaters(opacity=1.0)
        self.pending = edits.with_(floaters=floaters.model_copy(update={"opacity": opacity}))

    def select(self, stroke: Stroke, view: Camera) -> None:
        """Select the splats that a stroke covers in a view."""
        edits, points = self.edits, stroke.points
        if len(points) < (3 if stroke.radius is None else 1):
            return
        points, number = points[:: -(-len(points) // MOST_POINTS)], self.numbers.number(self.frame)
        try:
            region = Region(
                view=RegionView.of(view), outline=points, radius=stroke.radius, drawn=number, frames=(number, number)
            )
            self.pending = edits.with_(regions=(*edits.regions, region))
        except ValueError:
            self.refuse("There are too many regions already. Take some back with List.")

    def pick(self, point: np.ndarray, eye: np.ndarray) -> None:
        """Use a point of the performer, (3,) world, that was clicked from `eye`, as the tool says."""
        world = self.edits.world or World()
        if self.tool == Tool.DETAIL:
            self._mark_detail(point, eye)
        elif self.tool == Tool.ORIGIN:
            placed = world.model_copy(update={"origin": tuple(point.tolist())})
            self.commit(self.edits.with_(world=placed), "origin")
        elif len(self.clicks) != 1:
            self.clicks = (tuple(point.tolist()),)
        elif (apart := float(np.linalg.norm(point - self.clicks[0]))) >= 1e-9:
            start, self.clicks = np.array(self.clicks[0]), (*self.clicks, tuple(point.tolist()))
            if self.tool == Tool.SCALE:
                self.two_points.emit(start, point)
            else:
                self._set_up((point - start) / apart)

    def _set_up(self, up: np.ndarray) -> None:
        world = self.edits.world or World()
        if not self.commit(self.edits.with_(world=world.model_copy(update={"up": tuple(up.tolist())})), "up"):
            self.clicks = ()
            self.viewpoint.look_through("")
            orbit = self.viewpoint.orbit
            self.viewpoint.orbit = OrbitCamera.from_to(orbit.eye, orbit.target, up, orbit.fov)

    def _mark_detail(self, point: np.ndarray, eye: np.ndarray) -> None:
        take, edits = self.workspace.take, self.edits
        if take is None:
            return
        frame = min(self.frame, max(self.group_ends[-1] - 1, 0))
        try:
            mark = marked(take, self.numbers.number(frame), self.measured.seen, point, eye)
            after = edits.with_(details=(*edits.details, mark))
        except StudioError as error:
            self.refuse(message_text(error))
        except ValueError:
            self.refuse("There are too many details already. Take some back with List.")
        else:
            self.commit(after, f"detail {len(after.details)}")


@lru_cache(maxsize=1)
def _group_ends(take: Take, results: int) -> tuple[int, ...]:
    """First trained frame of each group, and the number of all; `results` changes with them."""
    files, starts = take.trained_files()
    return (*starts, len(files))
