"""Shows the state of the models in the panels, before each draw. Functions return whether anything changed."""

import numpy as np
from open3d.visualization import gui

from v3studio.gui.drawing.palette import DIM, TEXT
from v3studio.gui.figures import QualityFigures
from v3studio.gui.layout import Panels
from v3studio.gui.models.camera_path import PathEditor
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.thumbnails import Thumbnails
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.path_panel import PathPanel
from v3studio.gui.widgets.picture import color, put
from v3studio.gui.widgets.swap_guard import SwapGuard
from v3studio.gui.widgets.timeline import TimelinePanel

Pointer = tuple[int, int] | None
"""Position of the pointer in the window, pixels; None where it is not known."""


def mark_timeline(
    timeline: TimelinePanel, player: PlayerPresenter, marks: Marks, path: PathEditor, shows_path: bool
) -> None:
    """Give the timeline the marks, and the views of the camera path if its panel is on screen."""
    numbers = path.numbers = player.transport.numbers
    timeline.path_keys = [-1 if frame is None else frame for frame in path.frames] if shows_path else []
    marked = {at: mark.view for frame, mark in sorted(marks.marks.items()) if (at := numbers.index(frame)) is not None}
    timeline.marks = tuple(marked)
    player.places = {at: view.place for at, view in marked.items() if view is not None and view.place}


def path_pictures(
    panel: PathPanel, player: PlayerPresenter, path: PathEditor, thumbnails: Thumbnails
) -> list[np.ndarray | None]:
    """Thumbnails of the views of the camera path, those that are drawn; none while frames are played."""
    opened, size, contents = player.opened, panel.list.thumbnail_size, player.contents
    if opened is None or player.transport.playing or not panel.shown:
        return [None] * len(path.keys)
    return [
        None if frame is None else thumbnails.get(opened.path, contents, key.camera, frame, size)
        for key, frame in zip(path.keys, path.frames, strict=True)
    ]


def update_buttons(panels: Panels, views: StageViews, guard: SwapGuard, pointer: Pointer) -> tuple[bool, bool]:
    """Show the buttons of what is on screen, and the stages; returns also whether a layout is due."""
    controls = panels.controls.update(views.edits_take)
    modes = panels.modes.update(views.row, views.chosen(), views.idle, pointer)
    stages = panels.stages.update()
    if modes[1]:
        guard.swapped()
    return controls[0] | modes[0] | stages[0], controls[1] | modes[1] | stages[1]


def update_inspector(
    panels: Panels, views: StageViews, workspace: Workspace, marks: Marks, quality: QualityFigures
) -> bool:
    """Show figures of what is on screen, and the log."""
    view = views.stage_view
    changed = panels.inspector.update(
        views.player, quality.evaluation, marks, workspace, views.stage, view.blocks if view is not None else (),
        quality.camera,
    )  # fmt: skip
    return changed | panels.inspector.update_log(workspace)


def update_status(label: gui.Label, views: StageViews, notice: str, *others: str) -> bool:
    """Show the notice, or else what is on screen, in the line at the bottom, followed by `others`."""
    view = views.stage_view
    status = views.player.status if view is None else view.status
    label.text_color = color(TEXT if notice else DIM)
    return put(label, text="   ".join(filter(None, (notice or status, *others))))
