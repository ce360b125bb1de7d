"""Shell: the interface of the main window (`gui.window.MainWindow`) for actions and the state log."""

from __future__ import annotations

from typing import Protocol

from open3d.visualization import gui

from gui.layout import Layout
from gui.models.evaluation import Evaluation
from gui.models.marks import Marks
from gui.models.notices import Notices
from gui.models.playback.player import PlayerPresenter
from gui.models.preferences import Preferences
from gui.models.take.exports import Exports
from gui.models.take.serving import Serving
from gui.models.take.workspace import Workspace
from gui.pages.stage_views import StageViews
from gui.pages.start.panel import StartPanel
from gui.platform.input_order import InputOrder
from gui.widgets.camera_menu import CameraMenu
from gui.widgets.controls import ControlsPanel
from gui.widgets.dialogs.base import Dialogs
from gui.widgets.hints import Hints
from gui.widgets.inspector import InspectorPanel
from gui.widgets.modes import ModesPanel
from gui.widgets.notice_bar import NoticeBar
from gui.widgets.path_panel import PathPanel
from gui.widgets.scene_view import SceneView
from gui.widgets.stages import StagesPanel
from gui.widgets.timeline import TimelinePanel
from gui.widgets.tour_bubble import TourBubble
from gui.widgets.viewport import Viewport


class Page(Protocol):
    """The start page, for other actions."""

    def hide(self) -> bool:
        """Show what is open again; returns whether the page was over it."""


class Shell(Protocol):
    """The part of the main window that actions and the state log use."""

    preferences: Preferences
    device: str
    workspace: Workspace
    player: PlayerPresenter
    views: StageViews
    exports: Exports
    notices: Notices
    serving: Serving
    marks: Marks
    evaluation: Evaluation
    camera_menu: CameraMenu
    opening: str
    pictures: int
    wants_close: bool
    numbers: list[int | None]
    dialogs: Dialogs
    input: InputOrder
    layout: Layout
    viewport: Viewport
    scene_view: SceneView
    timeline: TimelinePanel
    controls: ControlsPanel
    modes: ModesPanel
    stages: StagesPanel
    inspector: InspectorPanel
    path_panel: PathPanel
    start: StartPanel
    notice_bar: NoticeBar
    tour_bubble: TourBubble
    hints: Hints
    message: gui.Label
    status: gui.Label

    @property
    def title(self) -> str:
        """Title of the window."""

    @property
    def control_held(self) -> bool:
        """Whether Ctrl or Shift is held."""

    @property
    def start_actions(self) -> Page:
        """The start page."""

    def open(self, path: str) -> None:
        """Open a take, a stream or a URL."""

    def select(self, stage: str) -> None:
        """Show a stage."""

    def run(self, stage: str, again: bool) -> None:
        """Run a stage, or check the footage."""

    def changed(self) -> None:
        """Note that something on screen may have changed."""

    def ask_close(self) -> None:
        """Close the window; ask first if a job is running."""

    def apply_preferences(self) -> None:
        """Apply the preferences."""

    def marks_changed(self) -> None:
        """Update the timeline's marks."""

    def over_view(self, x: int, y: int) -> bool:
        """Whether a menu or a card lies over the view at a position, window pixels."""

    def laid_out(self) -> None:
        """Lay the window out again before it is next drawn."""
