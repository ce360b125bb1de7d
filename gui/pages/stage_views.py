"""The viewport's content for each stage: its stage view, or the player."""

import numpy as np

from v3studio.gui.drawing.compare import Mode, What
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.viewpoint import Rest
from v3studio.gui.models.scene.contents import PARTS
from v3studio.gui.models.scene.gizmo import along
from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.bake.view import BakeView
from v3studio.gui.pages.calibrate.points_view import PointsView
from v3studio.gui.pages.calibrate.view import CalibrateView
from v3studio.gui.pages.capture.camera_color_pairs import CameraColorsView
from v3studio.gui.pages.capture.view import CaptureView
from v3studio.gui.pages.choices import DIALOGS, REVIEW_CHOICES, SCENE_CHOICES, Choice, ViewMode
from v3studio.gui.pages.initialize import InitializeView
from v3studio.gui.pages.newest_image import NewestImage
from v3studio.gui.pages.review.editor import Editor
from v3studio.gui.pages.review.tools import EDIT_CHOICES, Tool
from v3studio.gui.pages.review.view import EditView
from v3studio.gui.pages.stage_view import StageView, shown_at
from v3studio.gui.pages.train import TrainView
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers
from v3studio.studio.edits.edit_list import EditList

EDIT_KEYS = frozenset(key for key, _, _ in EDIT_CHOICES if key)


class StageViews:
    """The stage views, and which one is on screen.

    Signals:
        selected: a stage was selected, by its key; also if it was on screen already.
        clicked: the view was clicked.
        camera_clicked, camera_menu: a camera was clicked with the left or the right button, by its name.
        dialog_wanted: the dialog "cameras" or "bakes" is wanted.
        edit_dialog: the dialog of a button of the edits is wanted, "numbers" or "list".
    """

    def __init__(self, workspace: Workspace, player: PlayerPresenter) -> None:
        self.workspace, self.player = workspace, player
        self.capture, self.bake = CaptureView(workspace), BakeView(workspace)
        self.stage_views: dict[str, StageView] = {
            "capture": self.capture,
            "calibrate": CalibrateView(workspace),
            "initialize": InitializeView(workspace),
            "train": TrainView(workspace),
            "bake": self.bake,
        }
        for stage in TITLES.keys() - self.stage_views.keys() - {"review"}:
            self.stage_views[stage] = StageView(workspace, stage)
        self.capture.wanted.connect(self.show_mask)
        self.points = PointsView(workspace)
        views = (self.points, CameraColorsView(workspace))
        self._by_mode: dict[str, StageView] = {mode: view for view in views for mode in view.modes}
        self.editor = Editor(workspace, player)
        self.capture.corrected.connect(self.editor.correct_mask)
        self.edit_view = EditView(self.editor)
        self.editing = False  # whether Review shows the edits
        self._edits = EditList()  # before the changes since they are on screen
        self.stage = "review"
        self._numbered: tuple[object, ...] = (None, None, None)
        self._newest = NewestImage()
        self._rest = Rest()
        self.selected: Signal[[str]] = Signal()
        self.clicked: Signal[[]] = Signal()
        self.camera_clicked: Signal[[str]] = Signal()
        self.camera_menu: Signal[[str]] = Signal()
        self.dialog_wanted: Signal[[str]] = Signal()
        self.edit_dialog: Signal[[str]] = Signal()

    def choices(self) -> dict[str, tuple[Choice, ...]]:
        """Buttons above the viewport, by stage."""
        by_stage: dict[str, tuple[Choice, ...]] = {
            stage: tuple((mode, mode[0].upper() + mode[1:], mode.tooltip) for mode in stage_view.modes)
            for stage, stage_view in self.stage_views.items()
        }
        for (stage, key), (label, tooltip) in DIALOGS.items():
            by_stage[stage] += (("", "", ""), (key, label, tooltip))
        return {**by_stage, "review": REVIEW_CHOICES, "edit": EDIT_CHOICES, "scene": SCENE_CHOICES}

    @property
    def row(self) -> str:
        """The key of the `choices` that are offered."""
        return "edit" if self.edits_take else "scene" if self.shows_scene else self.stage

    @property
    def edits_take(self) -> bool:
        return self.editing and self.stage == "review"

    @property
    def shows_scene(self) -> bool:
        return self.stage == "review" and not self.editing and self.player.mode == Mode.SCENE

    def leave(self) -> bool:
        """Leave the edits or the scene; returns whether one was on screen."""
        return self.leave_edits() or (self.shows_scene and self.player.choose_mode(Mode.SINGLE))

    def edit(self) -> None:
        player = self.player
        if player.opened is None or self.workspace.take is None:
            player.refused.emit("Only a take can be edited. Open one, or create one from footage.")
            return
        player.transport.pause()
        self.stage = "review"
        self.editing, self._edits = True, self.editor.edits
        self.editor.choose_tool(Tool.ORBIT)
        self.show_again()

    def leave_edits(self) -> bool:
        """Show the take again; returns whether the edits were on screen. A selection is let go first."""
        if not self.edits_take:
            return False
        if self.editor.pending is not None or self.editor.clicks:
            self.editor.choose_tool(Tool.ORBIT)
            return True
        self.editing = False
        if self.editor.edits != self._edits and self.player.what == What.DECODED:
            self.player.choose(What.TRAINED)  # the stream was baked before these edits
        self.show_again()
        return True

    def chosen(self) -> set[str]:
        if self.edits_take:
            return self.editor.pressed_buttons
        if self.stage != "review":
            return {self.stage_views[self.stage].mode}
        if self.shows_scene:
            return {self.player.what, *self.player.scene_parts} - self._no_set
        return {self.player.what, self.player.mode, *({"set"} & self.player.scene_parts)} - self._no_set

    @property
    def idle(self) -> set[str]:
        """Buttons that would do nothing now."""
        if self.edits_take:
            return self.editor.idle_buttons
        return self._no_set if self.stage == "review" else set()

    @property
    def _no_set(self) -> set[str]:
        """The button of the set, if what is shown has none."""
        source = self.player.sources.get(self.player.what)
        return set() if source is not None and source.has_set else {"set"}

    def choose(self, key: str) -> None:
        """Press a button; pressing an active comparison turns it off. What only Review shows ends the edits."""
        player = self.player
        if self.edits_take and key in EDIT_KEYS:
            self._choose_edit(key)
            return
        if self.edits_take and key != "edit":
            self._choose_edit("done")
            if key == player.mode:
                return
        if (self.stage, key) in DIALOGS:
            self.dialog_wanted.emit(key)
        elif self.stage != "review":
            off = key == ViewMode.MASKS == self.capture.mode
            self.stage_views[self.stage].mode = ViewMode.AS_FILMED if off else ViewMode(key)
            if self.stage == "capture" and key != ViewMode.GARBAGE:
                self.capture.garbage.leave()
            self.show_again()
        elif key == "set" or (self.shows_scene and key in PARTS):
            player.scene_parts ^= {key}
        elif key == "edit":
            self.edit()
        elif key == What.OTHER and player.why_not(key):
            self.dialog_wanted.emit("bakes")
        elif key in tuple(What):
            if key == What.FOOTAGE and player.mode != Mode.SINGLE:
                player.choose_mode(Mode.SINGLE)
            player.choose(key)
        else:
            player.choose_mode(Mode.SINGLE if player.mode == key else key)

    def _choose_edit(self, key: str) -> None:
        if key == "done":
            self.editor.choose_tool(Tool.ORBIT)
            self.leave_edits()
        elif key in ("numbers", "list"):
            self.edit_dialog.emit(key)
        else:
            self.editor.press(key)

    def select(self, stage: str) -> None:
        if stage != self.stage:
            self.stage = stage
            self.show_again()
        self.selected.emit(stage)

    def show_again(self) -> None:
        """Redraw, because something else was on screen."""
        self.player.show_again()
        for stage_view in self._all:
            stage_view.show_again()

    def forget(self) -> None:
        """Free the previous take's large buffers, and leave its edits."""
        self.editing = False
        for stage_view in self._all:
            stage_view.forget()

    @property
    def _all(self) -> tuple[StageView, ...]:
        return (*self.stage_views.values(), *self._by_mode.values(), self.edit_view)

    @property
    def shows_player(self) -> bool:
        return self.stage == "review" and not self.editing

    @property
    def stage_view(self) -> StageView | None:
        """The stage view on screen; None if it is the player."""
        if self.shows_player:
            return None
        if self.edits_take:
            return self.edit_view
        chosen = self.stage_views[self.stage]
        return self._by_mode.get(chosen.mode, chosen)

    @property
    def edits_points(self) -> bool:
        """Whether the view of manual tie points is on screen."""
        return self.stage_view is self.points

    @property
    def _over_footage(self) -> bool:
        """Whether the timeline has the frames of the footage, as the settings choose them."""
        shows_splats = self.shows_player or self.stage in ("bake", "review")
        return bool(self.workspace.assessment.numbers) and (not shows_splats or self.player.source is None)

    def fit_transport(self) -> bool:
        """Set the transport's range to the frames of the selected stage; returns whether it changed."""
        assessment, player = self.workspace.assessment, self.player
        trained = player.opened.sources.get(What.TRAINED) if player.opened is not None else None
        if self.edits_take and trained is not None:  # all, so that frames that are trimmed off can be brought back
            return player.span(trained.frame_count, trained.group_starts, trained.fps)
        if self._over_footage:
            return self.player.span(len(assessment.numbers), assessment.group_starts, assessment.fps)
        return self.player.span_source()

    def poll(self, size: tuple[int, int], render_size: tuple[int, int], em: float) -> np.ndarray | None:
        """Return a new image if there is one. Never blocks; call at each tick. An image is never left under another
        label: while the chosen one is being made, the old one is dimmed."""
        pixels = self._poll(size, render_size, em)
        right_frame = not self.shows_player or self.player.opened is None or self.player.current
        doing = "" if self._finished else self.on_screen.doing
        return self._newest.update(pixels, self._wanted, right_frame, doing, self.message, size, em)

    @property
    def _wanted(self) -> object:
        """The subject of the chosen image."""
        return self.player.label if self.shows_player else (self.row, self.stage_view and self.stage_view.mode)

    def _poll(self, size: tuple[int, int], render_size: tuple[int, int], em: float) -> np.ndarray | None:
        stage_view = self.stage_view
        self.player.on_screen = stage_view is None
        self._number_frames()
        if self.stage == "review":
            self.player.context = self.workspace.context
        if stage_view is None:
            assessment = self.workspace.assessment
            self.player.filmed_groups = assessment.group_starts if assessment.numbers else ()
            wanted = size if self.player.rests(size) else render_size
            self.player.em = em * wanted[0] / max(size[0], 1)  # texts of a smaller image are enlarged with it
            self.player.resize(*wanted)
            picture = self.player.poll()
            return picture.image if picture is not None else None
        stage_view.em = em  # part of its state, which must not depend on whether it rests
        resting = stage_view.sharp and self._rest.rests((stage_view.state(), size), self.player.transport.playing)
        wanted = render_size if stage_view.orbits and not resting else size
        stage_view.em = em * wanted[0] / max(size[0], 1)
        stage_view.frame = self.player.transport.frame
        return stage_view.poll(wanted)

    def _number_frames(self) -> None:
        """Number the trained frames as they were when they were trained, the others as the settings say now; over the
        footage all as the settings say."""
        opened, filmed = self.player.opened, self.workspace.assessment.numbers
        trained = opened.numbers.known if opened is not None and not self._over_footage else ()
        of = (trained, filmed, self.player.transport)
        if any(now is not other for now, other in zip(of, self._numbered, strict=True)):
            self._numbered = of
            numbers = FrameNumbers((*trained, *filmed[len(trained) :]))
            self.player.transport.numbers = self.editor.numbers = self.bake.numbers = numbers

    @property
    def settled(self) -> bool:
        """Whether the newest image shows what was last requested."""
        return self._finished and not self._newest.loading

    @property
    def _finished(self) -> bool:
        return self.on_screen.settled

    @property
    def message(self) -> str:
        """Message over the viewport; stage views draw their own messages."""
        if self.player.opened is None or self.stage_view is None:
            opening = self.player.opened is None and self.workspace.opening
            return self.workspace.without_settings if opening else self.player.message
        return ""

    # Gestures of the mouse, see `gui.viewport`. Positions are pixels of the image

    @property
    def on_screen(self) -> StageView | PlayerPresenter:
        """The view in the viewport, which drags and the wheel are for."""
        return self.stage_view or self.player

    def reset(self) -> None:
        self.on_screen.reset()

    def _camera_at(self, x: float, y: float) -> str:
        scene = self.player.scene_places[0] if self.shows_scene else ()
        return shown_at(scene if self.stage_view is None else self.stage_view.places, x, y)

    def click(self, x: float, y: float) -> None:
        self.clicked.emit()
        view, player, camera = self.stage_view, self.player, self._camera_at(x, y)
        end = shown_at(player.scene_places[1], x, y) if self.shows_scene else ""
        if end:
            player.look_through("")
            player.orbit = along(player.orbit, end)
        elif camera:
            self.camera_clicked.emit(camera)  # which may select another stage
        if view is not None:
            view.click(x, y)

    def context(self, x: float, y: float) -> None:
        """Handle a right click."""
        self.clicked.emit()
        view = self.stage_view
        camera = self._camera_at(x, y) or (self.player.camera if view is None else "")
        if camera:
            self.camera_menu.emit(camera)
        elif view is not None:
            view.right_click(x, y)

    def show_alone(self, camera: str, toggle: bool = True) -> None:
        """Show one camera in Capture; all of them if it is shown alone and `toggle`."""
        self.capture.garbage.leave()
        self.capture.camera = "" if toggle and self.capture.camera == camera else camera

    def show_mask(self, camera: str, frame: int) -> None:
        """Show the mask of a camera in a frame, by its number."""
        self.show_alone(camera, toggle=False)
        self.capture.mode = ViewMode.MASKS
        index = self.player.transport.numbers.index(frame)
        if index is not None:
            self.player.transport.seek(index)

    def leave_camera(self) -> bool:
        """Show all cameras in Capture again; whether one was shown alone. A polygon being drawn is let go first."""
        if self.stage != "capture":
            return False
        if self.capture.garbage.leave():
            return True
        alone = self.capture.camera != ""
        self.capture.camera = ""
        return alone
