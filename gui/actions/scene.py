"""Who draws the scene: Open3D where that is fast or wanted, else our rasterizer."""

from __future__ import annotations

from gui.models.preferences import BY_OPEN3D, BY_RASTERIZER, drawn_by_open3d
from gui.shell import Shell
from studio.errors import StudioError

SLOW = "No graphics card draws this window, so that is slow, and black tiles may appear now and then."


class SceneActions:
    """See the module.

    Args:
        window: the main window.
        software: whether the CPU draws the window.
    """

    def __init__(self, window: Shell, software: bool) -> None:
        self._window, self._software = window, software
        self._failed = False

    @property
    def wanted(self) -> bool:
        """Whether Open3D is to draw the scene."""
        return not self._failed and drawn_by_open3d(self._window.preferences.scene_drawn_by, self._software)

    def toggle(self) -> None:
        """Let the other one draw the scene, from now on."""
        window = self._window
        on = not self.wanted
        self._failed = False
        window.preferences.scene_drawn_by = BY_OPEN3D if on else BY_RASTERIZER
        words = "Open3D draws the scene (O)." if on else "The scene (O) is composed from the rasterizer's pictures."
        window.notices.tell(f"{words} {SLOW}" if on and self._software else words, topic="scene")
        if not window.preferences.save():
            words = "Preferences could not be saved; they apply until the window is closed."
            window.notices.tell(words, bad=True, topic="preferences")

    def follow(self) -> bool:
        """Show what is wanted; returns whether something changed. Call at each tick."""
        window = self._window
        player, view, views = window.player, window.scene_view, window.views
        player.native = self.wanted
        picture = player.picture
        native = picture.native if picture is not None else None
        if picture is None or native is None or not (player.native and views.shows_scene) or window.start.shown:
            changed = view.hide()
        elif view.latest is native:
            changed = False
        else:
            try:
                view.show(native)
                changed = True
            except StudioError as error:
                return self._fail(error)
        widget, visible = window.viewport.picture.widget, not view.shown and not window.start.shown
        if widget.visible != visible:
            widget.visible, changed = visible, True
        try:
            moved = view.follow(player)
        except RuntimeError as error:
            return self._fail(error)
        if changed:
            window.laid_out()
        return changed or moved

    def draw(self) -> None:
        """Hand what is shown to Open3D. Call before the window is drawn."""
        try:
            player = self._window.player
            view = player.view()
            if view is not None:
                self._window.scene_view.draw(player.background, view.center)
                self._window.scene_view.follow(player)
        except StudioError as error:
            self._fail(error)

    def _fail(self, error: Exception) -> bool:
        """Tell what Open3D refused; the scene is composed from now on. Returns True."""
        window = self._window
        self._failed = True
        window.scene_view.hide()
        window.player.native = False
        words = f"{error}\nThe scene is composed from the rasterizer's pictures instead."
        window.notices.tell(words, bad=True, topic="scene")
        window.laid_out()
        return True
