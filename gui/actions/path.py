"""The camera path: its panel, its preview, and moving its views on the timeline."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from v3studio.gui.models.camera_path import PathEditor
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.pipelines.takes.authored.camera_paths import PATH_SUFFIXES, keys_in_take
from v3studio.studio.errors import StudioError
from v3studio.studio.formats.camera_path import CameraPath


class PathActions:
    """See the module. `export`: asks for the options of the movie."""

    def __init__(self, window: Shell, export: Callable[[], None]) -> None:
        self._window, self._export = window, export
        self._preview: tuple[CameraPath, float] | None = None
        self._shown: OrbitCamera | None = None

    @property
    def editor(self) -> PathEditor:
        return self._window.exports.path

    @property
    def previewing(self) -> bool:
        """Whether the path is being played."""
        return self._preview is not None

    def toggle(self) -> None:
        """Show the panel, or the inspector again."""
        window = self._window
        window.path_panel.shown = not window.path_panel.shown
        if window.path_panel.shown:
            window.views.select("review")
            if not window.layout.shows_figures:
                window.layout.toggle_figures()
        window.window.set_needs_layout()

    def add(self) -> None:
        """Add the view and the frame on screen, and show the panel."""
        window = self._window
        camera = window.player.view()
        if camera is None or window.player.source is None:
            return
        if self._done(lambda: self.editor.add(camera, window.player.transport.frame)):
            count = len(self.editor.keys)
            window.player.notice = f"{count} view{'s' * (count != 1)} in the camera path"
            if not window.path_panel.shown:
                self.toggle()

    def clear(self) -> None:
        if self.editor.keys and self._done(lambda: self.editor.load([])):
            self._window.notices.show("The camera path is empty now. Ctrl+Z brings it back.")

    def ask_file(self) -> None:
        """Ask for a file with a camera path, or a camera of a film tool, whose views replace those of the path."""
        opened, dialogs = self._window.player.opened, self._window.dialogs
        if opened is not None:
            start = dialogs.usual_folder(Path(opened.path))
            ask_path(dialogs, "Camera path from a file", start, "file", self.read, endings=PATH_SUFFIXES)

    def read(self, file: str, camera: str | None = None) -> None:
        """Read a file; ask for the camera if it has several."""
        window, opened = self._window, self._window.player.opened
        if opened is None:
            return
        of = next((name for name in ("decoded", "trained") if name in opened.sources), "")
        try:
            keys = keys_in_take(str(opened.path), of if opened.take is not None else "", Path(file), camera)
        except StudioError as error:
            if error.code != "camera_path.which_camera":
                window.notices.show(str(error), bad=True, topic="path")
                return
            names, title = error.message.fields.get("expected", []), f"Which camera of {Path(file).name}?"
            window.dialogs.choose("camera", title, names, lambda name: self.read(file, name))
            return
        if self._done(lambda: self.editor.load(keys)) and not window.path_panel.shown:
            self.toggle()

    def act(self, what: str, row: int) -> None:
        """Do what was clicked in the panel (`path_panel.HINTS`)."""
        window, editor = self._window, self.editor
        camera = window.player.view()
        actions: dict[str, Callable[[], None]] = {
            "add": self.add,
            "preview": self._toggle_preview,
            "export": self._export,
            "clear": self.clear,
            "close": self.toggle,
            "row": lambda: self._go(row),
            "time": lambda: self._ask_time(row),
            "easing": lambda: editor.next_easing(row),
            "up": lambda: editor.move(row, -1),
            "down": lambda: editor.move(row, 1),
            "remove": lambda: editor.remove(row),
        }
        if what != "preview":
            self.stop()
        if what == "view":
            if camera is not None:
                self._done(lambda: editor.update(row, camera, window.player.transport.frame))
        else:
            self._done(actions[what])

    def move_frame(self, row: int, frame: int) -> None:
        """A view was dragged to another frame on the timeline."""
        self._done(lambda: self.editor.set_frame(row, frame))

    def _done(self, action: Callable[[], None]) -> bool:
        with self._window.notices.reporting("path"):
            action()
            return True
        return False

    def _go(self, row: int) -> None:
        player, key, frame = self._window.player, self.editor.keys[row], self.editor.frames[row]
        self.editor.selected = row
        player.transport.pause()
        player.look_through("")
        player.orbit = OrbitCamera.looking_through(key.camera, player.home.target, player.orbit.up)
        if frame is None:
            self._window.notices.show(f"The take does not have frame {key.frame}.", topic="path")
        else:
            player.transport.seek(frame)

    def _ask_time(self, row: int) -> None:
        window = self._window

        def save(text: str) -> None:
            try:
                seconds = float(text)
            except ValueError:
                words = f"'{text}' is not a number of seconds; example: 2.5"
                window.notices.show(words, bad=True, topic="path")
                return
            self._done(lambda: self.editor.set_time(row, seconds))

        words, now = "Seconds in the movie; later views move by as much:", f"{self.editor.keys[row].time:g}"
        window.dialogs.line("time", f"Time of view {row + 1}", words, now, ("save", "Set", save))

    # Preview

    def _toggle_preview(self) -> None:
        if self._preview is not None:
            self.stop()
            return
        player = self._window.player
        player.transport.pause()
        player.look_through("")
        self._preview = (self.editor.path(*player.size), time.monotonic())

    def stop(self) -> None:
        self._preview = self._shown = None

    def advance(self) -> bool:
        """Advance the preview. Call at each tick; returns whether something changed."""
        if self._preview is None:
            return False
        player = self._window.player
        path, start = self._preview
        moved = self._shown is not None and (player.orbit is not self._shown or player.transport.playing)
        if moved or not self._window.views.shows_player:  # the user does something else
            self.stop()
            return True
        seconds = min(time.monotonic() - start, path.duration)
        orbit = OrbitCamera.looking_through(path.camera(seconds), player.home.target, player.orbit.up)
        player.orbit = self._shown = orbit
        player.transport.seek(round(path.frame(seconds)))
        if seconds >= path.duration:
            self.stop()
        return True

    def pictures(self) -> list[np.ndarray | None]:
        """Thumbnails of the views, those that are drawn; not while frames are played."""
        window = self._window
        opened, size = window.player.opened, window.path_panel.list.thumbnail_size
        if opened is None or window.player.transport.playing or not window.path_panel.shown:
            return [None] * len(self.editor.keys)
        get, contents = window.thumbnails.get, window.player.contents
        return [
            None if frame is None else get(opened.path, contents, key.camera, frame, size)
            for key, frame in zip(self.editor.keys, self.editor.frames, strict=True)
        ]
