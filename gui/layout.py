"""The places of the window's panels. In a narrow window rows wrap and the right panel is hidden."""

from dataclasses import dataclass

from open3d.visualization import gui

from v3studio.gui.drawing.palette import GROUND, PANEL
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.pages.start.panel import StartPanel
from v3studio.gui.viewport import Viewport
from v3studio.gui.widgets.camera_menu import CameraMenu
from v3studio.gui.widgets.controls import ControlsPanel
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.hints import Hints
from v3studio.gui.widgets.inspector import InspectorPanel
from v3studio.gui.widgets.modes import ModesPanel
from v3studio.gui.widgets.notice_bar import NoticeBar
from v3studio.gui.widgets.path_panel import PathPanel
from v3studio.gui.widgets.picture import ImagePanel, color, holds
from v3studio.gui.widgets.stages import StagesPanel
from v3studio.gui.widgets.timeline import STRIP, TimelinePanel

NARROW = 60  # width in em below which the right panel is hidden until the user shows it (I)
LEFT, LEAST_LEFT, MOST_LEFT = 18.0, 14.0, 40.0  # width of the left panel in em: at first, the least and the most

RIGHT, RIGHT_SHARE, MOST_RIGHT = 17.0, 0.2, 26.0
"""Width of the right panel: least in em, share of the window, most in em. The log is easier to read in wide lines."""

PLAIN, SPARE, MOST_TALLER = 50.0, 0.12, 6.0
"""Height of the window in em from which the timeline gets this share of each further em, and the most that it gets."""


@dataclass(frozen=True)
class Panels:
    """The widgets of the window. `status` is the line at the bottom, `message` is over the view."""

    viewport: Viewport
    timeline: TimelinePanel
    controls: ControlsPanel
    modes: ModesPanel
    stages: StagesPanel
    inspector: InspectorPanel
    camera_menu: CameraMenu
    path_panel: PathPanel
    start: StartPanel
    notice_bar: NoticeBar
    hints: Hints
    status: gui.Label
    message: gui.Label

    @property
    def widgets(self) -> tuple[gui.Widget, ...]:
        """All widgets, in the order in which they are drawn."""
        return (
            self.viewport.picture.widget,
            *(row.widget for row in self.modes.rows.values()),
            self.timeline.picture.widget,
            self.controls.widget,
            *self.stages.widgets,
            *self.inspector.widgets,
            self.path_panel.picture.widget,
            self.status,
            self.message,
            self.hints.picture.widget,
            self.camera_menu.widget,
            self.start.picture.widget,
            self.notice_bar.widget,
        )

    @property
    def pictures(self) -> tuple[ImagePanel, ...]:
        """The panels that are images."""
        return (
            self.viewport.picture, self.timeline.picture, self.stages.list, self.inspector.figures, self.inspector.log,
            self.path_panel.picture, self.start.picture, self.hints.picture,
        )  # fmt: skip

    def over_view(self, x: int, y: int) -> bool:
        """Whether a menu or a card lies over the view at a position, window pixels."""
        over = (self.camera_menu.widget, self.notice_bar.widget)
        return any(widget.visible and holds(widget, x, y) for widget in over)


class Layout:
    """The panels that are on screen, and their places."""

    def __init__(self, window: gui.Window, em: float, panels: Panels, dialogs: Dialogs, views: StageViews) -> None:
        self._window, self._em, self._panels, self._dialogs, self._views = window, em, panels, dialogs, views
        self.fullscreen = False  # only the viewport is visible
        self.figures: bool | None = None
        self._width = window.content_rect.width  # asking for it takes a round trip to the X server
        # Fills between the panels: one background under everything would cost a software driver 30 ms per draw.
        # Few, because Open3D draws a window with more than 20 visible children incorrectly.
        self.fills = [gui.Vert() for _ in range(4)]
        for number, fill in enumerate(self.fills):
            fill.background_color = color(GROUND if number < 3 else PANEL)
        self.left = LEFT  # width of the left panel, em; at most a third of the window
        self.view = (0, 0, 16, 16)  # x, y, width and height of the viewport, or of the start page, window pixels

    def widen(self, x: float) -> None:
        """Drag the left panel's edge to a column of the window."""
        at = x - self._window.content_rect.x
        self.left = min(max(at / self._em, LEAST_LEFT), MOST_LEFT)
        self._window.set_needs_layout()

    @property
    def shows_figures(self) -> bool:
        if self.fullscreen or self._panels.start.shown:
            return False
        return self._width >= NARROW * self._em if self.figures is None else self.figures

    def toggle_figures(self) -> None:
        self.figures = not self.shows_figures
        self._window.set_needs_layout()

    @property
    def shows_path(self) -> bool:
        """Whether the panel of the camera path is chosen, in place of the inspector."""
        return self._panels.path_panel.shown

    def toggle_path(self) -> None:
        """Choose the panel of the camera path, and show it, or the inspector again."""
        panel = self._panels.path_panel
        panel.shown = not panel.shown
        if panel.shown and not self.shows_figures:
            self.figures = True
        self._window.set_needs_layout()

    def toggle_warnings(self) -> None:
        """Show the warnings of the log only, or all lines again."""
        self._panels.inspector.toggle_warnings()

    def toggle_log(self) -> None:
        """Show the log over the view, or in its panel again; not in fullscreen, which has no log."""
        if not self.fullscreen:
            self._panels.inspector.toggle()

    def close_log(self) -> bool:
        """Show the log in its panel again; returns whether it was over the view."""
        shown = self._panels.inspector.large and self._panels.inspector.log.widget.visible
        if shown:
            self.toggle_log()
        return shown

    def set_fullscreen(self, on: bool) -> None:
        """Show the viewport alone, or with all panels."""
        if on == self.fullscreen:
            return
        self.fullscreen = on
        self._window.show_menu(not on)
        self._show_panels(not on and not self._panels.start.shown)

    def toggle_fullscreen(self) -> None:
        self.set_fullscreen(not self.fullscreen)

    def set_start(self, on: bool) -> None:
        """Show the start page alone, or the panels."""
        panels = self._panels
        self.set_fullscreen(False)
        panels.start.shown = panels.start.picture.widget.visible = on
        panels.camera_menu.close()
        self._show_panels(not on)

    def _show_panels(self, on: bool) -> None:
        panels = self._panels
        for widget in (*self.fills, panels.status, panels.controls.widget, panels.timeline.picture.widget):
            widget.visible = on
        panels.hints.hide()
        panels.stages.set_visible(on)
        if not on:
            for row in panels.modes.rows.values():
                row.widget.visible = False
        self._window.set_needs_layout()

    def place(self, context: gui.LayoutContext) -> None:
        panels, em = self._panels, self._em
        area = self._window.content_rect
        x, y, width, height = area.x, area.y, area.width, area.height
        self._width = width
        self._dialogs.place(gui.Rect(x, y, width, height))
        figures = self.shows_figures
        for widget in panels.inspector.widgets:
            widget.visible = figures
        alone = self.fullscreen or panels.start.shown
        panels.inspector.log.widget.visible = not alone and (figures or panels.inspector.large)
        # not under the large log: a click brings the view to the front, and Open3D knows no order but that of clicks
        panels.viewport.picture.widget.visible = not panels.start.shown and (alone or not panels.inspector.large)
        beside = figures and not panels.inspector.large  # the large log leaves only a strip of what is beside the view
        panels.path_panel.picture.widget.visible = beside and panels.path_panel.shown
        panels.inspector.figures.widget.visible = beside and not panels.path_panel.shown
        if alone:
            picture = panels.start.picture if panels.start.shown else panels.viewport.picture
            picture.place(x, y, width, height)
            self._place_over(context, x, y, width, height)
            return
        left = min(round(self.left * em), width // 3)
        right = min(round(min(max(RIGHT * em, RIGHT_SHARE * width), MOST_RIGHT * em)), width // 4) if figures else 0
        gap, pad = round(0.4 * em), round(0.5 * em)
        inner = x + left + gap
        inner_width = width - left - gap
        padded = inner_width - 2 * pad
        controls = panels.controls.flow.height(padded, context)
        taller = min(max(SPARE * (height - PLAIN * em), 0.0), MOST_TALLER * em)
        bottom_height = round((10.4 + STRIP) * em + controls + taller)
        bottom = y + height - bottom_height
        panels.stages.place(x, y, left, height, context)
        panels.status.frame = gui.Rect(inner + pad, y + height - round(1.4 * em), padded, round(1.35 * em))
        # above the status line with a margin: a list that is opened brings the controls to the front
        panels.controls.flow.place(inner + pad, y + height - controls - round(1.9 * em), padded, context)
        plots = bottom_height - controls - 2.4 * em - pad
        panels.timeline.picture.place(inner + pad, bottom + pad, padded, plots)
        view_width = inner_width - right - (gap if figures else 0)
        modes = panels.modes.place(self._views.row, inner + pad, y + 0.25 * em, view_width - pad, context)
        row = round(modes + 0.5 * em)
        panels.viewport.picture.place(inner, y + row, view_width, bottom - y - row)
        if figures or panels.inspector.large:
            over = (inner, y + row, inner_width, bottom - y - row)
            panels.inspector.place(inner + view_width + gap, y, right, bottom - y, over)
        if figures:
            panels.path_panel.picture.widget.frame = panels.inspector.figures.widget.frame
        frames = (
            (x + left, y, gap, height),
            (inner, y, inner_width if panels.inspector.large else view_width, row),
            (inner + view_width, y, gap if figures else 0, bottom - y),
            (inner, bottom, inner_width, bottom_height),
        )
        for fill, frame in zip(self.fills, frames, strict=True):
            fill.frame = gui.Rect(*frame)
        self._place_over(context, inner, y + row, view_width, bottom - y - row)

    def _place_over(self, context: gui.LayoutContext, x: int, y: int, width: int, height: int) -> None:
        panels = self._panels
        self.view = (x, y, width, height)
        wide, high = _size_of(panels.message, context, width)
        panels.message.frame = gui.Rect(x + (width - wide) // 2, y + (height - high) // 2, wide, high)
        if self.fullscreen:  # at the top: cards of notices are at the bottom
            wide, high = _size_of(panels.status, context, width)
            panels.status.frame = gui.Rect(x + (width - wide) // 2, y + round(self._em), wide, high)
        panels.hints.place(self.view)
        if panels.camera_menu.camera:
            panels.camera_menu.place(context, self._window.content_rect)
        panels.notice_bar.place(context, x, y, width, height)


def _size_of(label: gui.Label, context: gui.LayoutContext, width: int) -> tuple[int, int]:
    """Width and height of a label over a view of some width, where longer text wraps; pixels."""
    limits = gui.Widget.Constraints()
    limits.width = int(0.85 * width)
    preferred = label.calc_preferred_size(context, limits)
    return min(preferred.width, limits.width), preferred.height
