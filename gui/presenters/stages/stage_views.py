"""The viewport's content for each stage: its stage view, or the player."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gui.presenters.edits.view import EDIT_CHOICES, EditView
from gui.presenters.playback.player import PlayerPresenter
from gui.presenters.points.view import PointsView
from gui.presenters.run.workspace import Workspace
from gui.presenters.stages.bake import BakeView
from gui.presenters.stages.calibrate import CalibrateView
from gui.presenters.stages.capture import CaptureView
from gui.presenters.stages.initialize import InitializeView, Mesh
from gui.presenters.stages.stage_view import StageView, waiting
from gui.presenters.stages.train import TrainView

Choice = tuple[str, str, str]

REVIEW_CHOICES: tuple[Choice, ...] = (
    ("truth", "Footage", "Footage of a capture camera, matted (1)"),
    ("trained", "Trained", "Trained Gaussians (2)"),
    ("decoded", "Decoded", "Gaussians decoded from the baked stream (3)"),
    ("other", "Other bake", "Another bake or take to compare with; View > Bakes chooses it (4)"),
    ("", "", ""),
    ("side by side", "Side by side", "Show sources side by side (S)"),
    ("wipe", "Wipe", "Wipe against footage or trained; drag the line (W)"),
    ("difference", "Difference", "Difference heat map against footage or trained (D)"),
    ("", "", ""),
    ("edit", "Edit", "Trim, crop, remove floaters, place the world; can be undone (X)"),
)
EDIT_KEYS = frozenset(key for key, _, _ in EDIT_CHOICES if key)

DIMMED_AFTER, FRAME_DIMMED_AFTER = 0.1, 0.5
"""Seconds after which a picture of something else, or of another frame, is dimmed: not at every quick change."""

TOOLTIPS = {
    "mask overlay": "Images with the background darkened and the matte's edge outlined",
    "images": "Original images",
    "performer": "Images cut out by the mattes",
    "cameras": "Camera frustums with their images, and sparse points",
    "report": "Reprojection error per camera",
    "points by hand": "Mark tie points manually, for footage with too few automatic matches",
    "mesh": "Visual hull of the group's keyframe",
    "points": "Initial points for training",
    "progress": "Live loss, PSNR and splat count; latest render of a held-out camera next to its footage",
    "gaussians": "Trained frames in the interactive viewer",
    "bytes": "Size by attribute and by group",
    "try other QPs": "Size and PSNR at other quantization parameters, measured on a whole group",
    "planes": "Attribute planes of the frame as images",
}


class StageViews:
    """The stage views, and which one is on screen.

    Args:
        workspace: the take.
        player: the player.
        read_mesh: see `InitializeView`.
        now: a clock in seconds that never runs backwards.

    Attributes:
        asked: ("look" or "menu", camera) after a click on a camera; the window takes it.
        asked_bakes: whether another bake is wanted, but none is open; the window asks for it.
        asked_edit: button of the edits that needs a dialog; the window takes it.
        editing: whether Review shows the edits.
        pressed: whether there was a click since the window last looked.
    """

    def __init__(
        self,
        workspace: Workspace,
        player: PlayerPresenter,
        read_mesh: Callable[[Path], Mesh],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.workspace, self.player = workspace, player
        self.capture = CaptureView(workspace)
        self.stage_views: dict[str, StageView] = {
            "capture": self.capture,
            "calibrate": CalibrateView(workspace),
            "initialize": InitializeView(workspace, read_mesh),
            "train": TrainView(workspace),
            "bake": BakeView(workspace),
        }
        self.points = PointsView(workspace)
        self.editor = EditView(workspace)
        self.editing = False
        self.stage = "review"
        self._now = now
        self._shown: object = None
        self._pixels: np.ndarray | None = None
        self._missing_since: float | None = None
        self._waits = ""
        self.asked: tuple[str, str] | None = None
        self.asked_bakes = False
        self.asked_edit = ""
        self.pressed = False

    def choices(self) -> dict[str, tuple[Choice, ...]]:
        """Buttons above the viewport, by stage."""
        found: dict[str, tuple[Choice, ...]] = {
            stage: tuple((mode, mode[0].upper() + mode[1:], TOOLTIPS[mode]) for mode in stage_view.modes)
            for stage, stage_view in self.stage_views.items()
        }
        return {**found, "review": REVIEW_CHOICES, "edit": EDIT_CHOICES}

    @property
    def row(self) -> str:
        """Which of `choices` are offered."""
        return "edit" if self.edits_take else self.stage

    @property
    def edits_take(self) -> bool:
        """Whether the edits are on screen."""
        return self.editing and self.stage == "review"

    def edit(self) -> None:
        """Show the edits of the take."""
        player = self.player
        if player.opened is None or self.workspace.take is None:
            player.message = "Only a take can be edited. Open one, or create one from footage."
            return
        player.transport.pause()
        self.stage, self.editing = "review", True
        self.editor.background = player.background
        self.editor.begin(player.orbit, player.opened.up, player.opened.reach)
        self.shown_anew()

    def leave_edits(self) -> bool:
        """Show the take again; returns whether the edits were on screen. A selection is let go first."""
        if not self.edits_take:
            return False
        if self.editor.pending is not None or self.editor.clicks:
            self.editor.choose_tool("look")
            return True
        self.editing = False
        if self.editor.orbit is not None:
            self.player.orbit = self.editor.orbit
        self.shown_anew()
        return True

    def chosen(self) -> set[str]:
        """The pressed buttons."""
        if self.edits_take:
            return self.editor.pressed_buttons
        if self.stage != "review":
            return {self.stage_views[self.stage].mode}
        return {self.player.what, self.player.mode}

    def choose(self, key: str) -> None:
        """Press a button; pressing an active comparison turns it off."""
        player = self.player
        if self.edits_take and key in EDIT_KEYS:
            self._choose_edit(key)
        elif self.stage != "review":
            self.stage_views[self.stage].mode = key
            self.shown_anew()
        elif key == "edit":
            self.edit()
        elif key == "other" and player.why_not(key):
            self.asked_bakes = True
        elif key in ("truth", "trained", "decoded", "other"):
            if key == "truth" and player.mode != "single":
                player.choose_mode("single")
            player.choose(key)
        else:
            player.choose_mode("single" if player.mode == key else key)

    def _choose_edit(self, key: str) -> None:
        if key == "done":
            self.editor.choose_tool("look")
            self.leave_edits()
        elif key in ("numbers", "list"):
            self.asked_edit = key
        else:
            self.editor.press(key)

    def select(self, stage: str) -> None:
        """Show a stage."""
        if stage != self.stage:
            self.stage = stage
            self.shown_anew()

    def shown_anew(self) -> None:
        """Redraw, because something else was on screen."""
        self.player.show_again()
        for stage_view in (*self.stage_views.values(), self.points, self.editor):
            stage_view.show_again()

    @property
    def shows_player(self) -> bool:
        """Whether the viewport shows the player."""
        if self.edits_take:
            return False
        return self.stage == "review" or (self.stage == "train" and self.stage_views["train"].mode == "gaussians")

    @property
    def stage_view(self) -> StageView | None:
        """The stage view on screen; None if it is the player."""
        if self.shows_player:
            return None
        if self.edits_take:
            return self.editor
        return self.points if self.edits_points else self.stage_views[self.stage]

    @property
    def edits_points(self) -> bool:
        """Whether the view of manual tie points is on screen."""
        return self.stage == "calibrate" and self.stage_views["calibrate"].mode in self.points.modes

    def fit_transport(self) -> bool:
        """Set the transport's range to the frames of the selected stage; returns whether it changed."""
        found = self.workspace.assessment
        over_footage = not (self.shows_player or self.stage in ("bake", "review")) or self.player.source is None
        if over_footage and found.numbers:
            return self.player.span(len(found.numbers), found.group_starts, found.fps)
        return self.player.span_source()

    def poll(self, size: tuple[int, int], drawn_size: tuple[int, int], em: float) -> np.ndarray | None:
        """Return a new picture if there is one. Never blocks; call at each tick.

        A picture is never left under another label: while the chosen one is being made, the old one is dimmed.

        Args:
            size: size of the viewport, pixels.
            drawn_size: size of pictures rendered from splats.
            em: font size, pixels.
        """
        pixels = self._poll(size, drawn_size, em)
        if pixels is not None:
            self._shown, self._pixels, self._missing_since, self._waits = self._wanted, pixels, None, ""
            return pixels
        if self._pixels is None or (self._wanted == self._shown and self._frame_shown):
            self._missing_since = None
            return None
        now = self._now()
        if self._missing_since is None:
            self._missing_since = now
        if now - self._missing_since < (DIMMED_AFTER if self._wanted != self._shown else FRAME_DIMMED_AFTER):
            return None
        words = "not available" if self.settled else "drawing"
        if words == self._waits:
            return None
        self._waits = words
        return waiting(self._pixels, "" if self.message else words, em)

    @property
    def _wanted(self) -> object:
        """What the chosen picture is a picture of."""
        return self.player.label if self.shows_player else (self.row, self.stage_view and self.stage_view.mode)

    @property
    def _frame_shown(self) -> bool:
        return not self.shows_player or self.player.opened is None or self.player.current

    def _poll(self, size: tuple[int, int], drawn_size: tuple[int, int], em: float) -> np.ndarray | None:
        stage_view = self.stage_view
        self.player.on_screen = stage_view is None
        if stage_view is None:
            self.player.context = self.workspace.context
            self.player.filmed = self.workspace.assessment.numbers
            self.player.resize(*drawn_size)
            picture = self.player.poll()
            return picture.image if picture is not None else None
        stage_view.em = em
        stage_view.frame = self.player.transport.frame
        return stage_view.poll(drawn_size if stage_view.orbits else size)

    @property
    def settled(self) -> bool:
        """Whether the newest picture shows what was last requested."""
        stage_view = self.stage_view
        return self.player.settled if stage_view is None else stage_view.settled

    @property
    def message(self) -> str:
        """Message over the viewport; stage views draw their own messages."""
        if self.player.opened is None or self.stage_view is None:
            return self.player.message
        return ""

    # Gestures, see gui.viewport.Gestures

    def drag(self, dx: float, dy: float, turn: bool, height: int) -> None:
        """Orbit or pan."""
        stage_view = self.stage_view
        if stage_view is not None:
            stage_view.drag(dx, dy, turn, height)
        elif turn:
            self.player.drag_orbit(dx, dy)
        else:
            self.player.drag_pan(dx, dy)

    def wheel(self, notches: float) -> None:
        """Zoom."""
        stage_view = self.stage_view
        if stage_view is not None:
            stage_view.wheel(notches)
        else:
            self.player.wheel(notches)

    def click(self, x: float, y: float) -> None:
        """Handle a click."""
        self.pressed = True
        if self.stage_view is not None:
            camera = self.stage_view.camera_at(x, y)
            if camera:
                self.asked = ("look", camera)
            self.stage_view.click(x, y)

    def context(self, x: float, y: float) -> None:
        """Handle a right click."""
        self.pressed = True
        view = self.stage_view
        camera = self.player.camera if view is None else view.camera_at(x, y)
        if camera:
            self.asked = ("menu", camera)

    def show_alone(self, camera: str, toggle: bool = True) -> None:
        """Show one camera in Capture; all of them if it is shown alone and `toggle`."""
        self.capture.camera = "" if toggle and self.capture.camera == camera else camera

    def leave_camera(self) -> bool:
        """Show all cameras in Capture again; returns whether one was shown alone."""
        alone = self.stage == "capture" and self.capture.camera != ""
        if alone:
            self.capture.camera = ""
        return alone

    def mark_camera(self, camera: str) -> None:
        """Mark a camera in Calibrate."""
        self.stage_views["calibrate"].camera = camera

    def hover(self, x: float, y: float) -> None:
        """Note the pointer position."""
        if self.stage_view is not None:
            self.stage_view.hover(x, y)

    def grabs(self, x: float, y: float) -> bool:
        """Whether a press at a pixel grabs the wipe's line, or a handle of an edit, or begins a lasso."""
        if self.edits_take:
            return self.editor.grabs(x, y)
        return self.stage_view is None and self.player.wipe_at(x)

    def pull(self, x: float, y: float) -> None:
        """Move what is grabbed."""
        if self.edits_take:
            self.editor.pull(x, y)
        else:
            self.player.move_wipe(x)

    def release(self) -> None:
        """Let go of what is grabbed."""
        if self.edits_take:
            self.editor.release()

    def reset(self) -> None:
        """Return to the initial view."""
        stage_view = self.stage_view
        if stage_view is None:
            self.player.reset_view()
        else:
            stage_view.reset()

    def close(self) -> bool:
        """End all threads. Returns whether they ended in time."""
        return all(
            [stage_view.close() for stage_view in (*self.stage_views.values(), self.points, self.editor)]
            + [self.player.close()]
        )
