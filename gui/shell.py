"""Shell: the interface of the main window (`gui.window.MainWindow`) for actions and the state log."""

from __future__ import annotations

from typing import Protocol

from open3d.visualization import gui

from gui.layout import Layout
from gui.panels.camera_menu import CameraMenu
from gui.panels.controls import ControlsPanel
from gui.panels.dialogs import Dialogs
from gui.panels.hints import Hints
from gui.panels.inspector import InspectorPanel
from gui.panels.modes import ModesPanel
from gui.panels.notice_bar import NoticeBar
from gui.panels.path_panel import PathPanel
from gui.panels.stages import StagesPanel
from gui.panels.start_panel import StartPanel
from gui.panels.timeline import TimelinePanel
from gui.panels.tour_bubble import TourBubble
from gui.platform.input_order import InputOrder
from gui.presenters.evaluation import Evaluation
from gui.presenters.marks import Marks
from gui.presenters.notices import Notices
from gui.presenters.playback.player import PlayerPresenter
from gui.presenters.preferences import Preferences
from gui.presenters.run.exports import Exports
from gui.presenters.run.serving import Serving
from gui.presenters.run.workspace import Workspace
from gui.presenters.stages.stage_views import StageViews
from gui.scene_view import SceneView
from gui.viewport import Viewport


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
