"""The camera path: its panel, its preview, and moving its views on the timeline."""

import time
from collections.abc import Callable
from pathlib import Path

from v3studio.gui.drawing.compare import What
from v3studio.gui.layout import Layout
from v3studio.gui.models.camera_path import PathEditor
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.pipelines.takes.authored.camera_paths import PATH_SUFFIXES, keys_in_take
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.formats.camera_path import CameraPath


class PathActions:
    """Changes the path. `export`: asks for the options of the movie."""

    def __init__(
        self, player: PlayerPresenter, views: StageViews, editor: PathEditor, layout: Layout, dialogs: Dialogs,
        notices: Notices, export: Callable[[], None],
    ) -> None:  # fmt: skip
        self._player, self._views, self.editor, self._layout = player, views, editor, layout
        self._dialogs, self._notices, self._export = dialogs, notices, export
        self.preview = PathPreview(player, views, editor)

    def toggle(self) -> None:
        """Show the panel, or the inspector again."""
        self._layout.toggle_path()
        if self._layout.shows_path:
            self._views.select("review")

    def add(self) -> None:
        """Add the view and the frame on screen, and show the panel."""
        player = self._player
        camera = player.view()
        if camera is None or player.source is None:
            return
        if self._done(lambda: self.editor.add(camera, player.transport.frame)):
            count = len(self.editor.keys)
            self._notices.show(f"{counted(count, 'view')} in the camera path.", topic="path")
            if not self._layout.shows_path:
                self.toggle()

    def clear(self) -> None:
        if self.editor.keys and self._done(lambda: self.editor.load([])):
            self._notices.show("The camera path is empty now. Ctrl+Z brings it back.")

    def ask_file(self) -> None:
        """Ask for a file with a camera path, or a camera of a film tool, whose views replace those of the path."""
        opened, dialogs = self._player.opened, self._dialogs
        if opened is not None:
            start = dialogs.usual_folder(Path(opened.path))
            ask_path(dialogs, "Camera path from a file", start, "file", self.read, endings=PATH_SUFFIXES)

    def read(self, file: str, camera: str | None = None) -> None:
        """Read a file; ask for the camera if it has several."""
        opened = self._player.opened
        if opened is None:
            return
        of = next((name for name in (What.DECODED, What.TRAINED) if name in opened.sources), "")
        try:
            keys = keys_in_take(str(opened.path), of if opened.take is not None else "", Path(file), camera)
        except StudioError as error:
            if error.code != "camera_path.which_camera":
                self._notices.show(str(error), bad=True, topic="path")
                return
            names, title = error.message.fields.get("expected", []), f"Which camera of {Path(file).name}?"
            self._dialogs.choose("camera", title, names, lambda name: self.read(file, name))
            return
        if self._done(lambda: self.editor.load(keys)) and not self._layout.shows_path:
            self.toggle()

    def act(self, what: str, row: int) -> None:
        """Do what was clicked in the panel (`path_panel.HINTS`)."""
        player, editor = self._player, self.editor
        camera = player.view()
        actions: dict[str, Callable[[], None]] = {
            "add": self.add,
            "preview": self.preview.toggle,
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
            self.preview.stop()
        if what == "view":
            if camera is not None:
                self._done(lambda: editor.update(row, camera, player.transport.frame))
        else:
            self._done(actions[what])

    def move_frame(self, row: int, frame: int) -> None:
        """A view was dragged to another frame on the timeline."""
        self._done(lambda: self.editor.set_frame(row, frame))

    def _done(self, action: Callable[[], None]) -> bool:
        with self._notices.reporting("path"):
            action()
            return True
        return False

    def _go(self, row: int) -> None:
        player, key, frame = self._player, self.editor.keys[row], self.editor.frames[row]
        self.editor.selected = row
        player.transport.pause()
        player.look_through("")
        player.orbit = OrbitCamera.looking_through(key.camera, player.home.target, player.orbit.up)
        if frame is None:
            self._notices.show(f"The take does not have frame {key.frame}.", topic="path")
        else:
            player.transport.seek(frame)

    def _ask_time(self, row: int) -> None:
        def save(text: str) -> None:
            try:
                seconds = float(text)
            except ValueError:
                words = f"'{text}' is not a number of seconds; example: 2.5"
                self._notices.show(words, bad=True, topic="path")
                return
            self._done(lambda: self.editor.set_time(row, seconds))

        words, now = "Seconds in the movie; later views move by as much:", f"{self.editor.keys[row].time:g}"
        self._dialogs.line("time", f"Time of view {row + 1}", words, now, ("save", "Set", save))


class PathPreview:
    """Plays the camera path, until it ends or the user does something else."""

    def __init__(self, player: PlayerPresenter, views: StageViews, editor: PathEditor) -> None:
        self._player, self._views, self._editor = player, views, editor
        self._begun: tuple[CameraPath, float] | None = None
        self._shown: OrbitCamera | None = None

    @property
    def playing(self) -> bool:
        return self._begun is not None

    def toggle(self) -> None:
        if self._begun is not None:
            self.stop()
            return
        player = self._player
        player.transport.pause()
        player.look_through("")
        self._begun = (self._editor.path(*player.size), time.monotonic())

    def stop(self) -> None:
        self._begun = self._shown = None

    def advance(self) -> bool:
        """Move the view on. Call at each tick; returns whether something changed."""
        if self._begun is None:
            return False
        player, (path, start) = self._player, self._begun
        moved = self._shown is not None and (player.orbit is not self._shown or player.transport.playing)
        if moved or not self._views.shows_player:  # the user does something else
            self.stop()
            return True
        seconds = min(time.monotonic() - start, path.duration)
        orbit = OrbitCamera.looking_through(path.camera(seconds), player.home.target, player.orbit.up)
        player.orbit = self._shown = orbit
        player.transport.seek(round(path.frame(seconds)))
        if seconds >= path.duration:
            self.stop()
        return True
