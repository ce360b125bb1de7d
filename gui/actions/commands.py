"""What menus, keys and buttons do."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from open3d.visualization import gui

from gui.actions.bakes import BakeActions
from gui.actions.cameras import CameraActions
from gui.actions.edits import EditActions
from gui.actions.keys import shortcuts_text
from gui.actions.marks import MarkActions
from gui.actions.output import OutputActions
from gui.actions.path import PathActions
from gui.actions.points import PointActions
from gui.actions.queue import QueueActions
from gui.actions.shares import ShareActions
from gui.panels.folder_dialog import ask_path
from gui.panels.option_dialogs import ask_preferences
from gui.panels.take_dialog import ask_new_take
from gui.presenters.preferences import Preferences
from gui.presenters.run.exports import FORMATS
from gui.presenters.run.new_take import NewTake
from gui.presenters.run.setting_words import FOLDERS
from gui.presenters.run.settings import SettingField, place_of
from gui.presenters.run.shares import FORMS
from gui.presenters.stages.stage_rows import TITLES
from gui.shell import Shell
from pipelines.takes.take import program_version
from studio.errors import StudioError

Action = Callable[[], object]


class Actions:
    """See the module. Acts through the window.

    Args:
        window: the main window.
    """

    def __init__(self, window: Shell) -> None:
        self._window = window
        self._marks, self._outputs = MarkActions(window), OutputActions(window)
        self.points = PointActions(window)
        self.shares = ShareActions(window)
        self.cameras = CameraActions(window)
        self.queue = QueueActions(window)
        self.bakes = BakeActions(window)
        self.edits = EditActions(window)
        self.path = PathActions(window, lambda: self._outputs.export("camera-path"))

    def menu(self) -> dict[str, Action]:
        """Actions by key of `gui.actions.menus.MENUS`."""
        window = self._window
        return {
            "new": self.new_take,
            "open": self._ask_open,
            "recent": self._ask_recent,
            "address": self._ask_address,
            "undo": self.undo,
            "redo": self.redo,
            "edit": self.edits.show,
            "screenshot": self._outputs.screenshot,
            "report": self._outputs.report,
            "preferences": lambda: ask_preferences(window.dialogs, window.preferences, self._save_preferences),
            "quit": window.ask_close,
            "reset": window.views.reset,
            "background": window.player.next_background,
            "camera": window.player.next_camera,
            "cameras": self.cameras.ask,
            "fullscreen": lambda: window.layout.set_fullscreen(not window.layout.fullscreen),
            "figures": window.layout.toggle_figures,
            "queue": self.queue.show,
            "bakes": self.bakes.show,
            "mark": self._marks.ask,
            "next_mark": lambda: self._marks.go(1),
            "previous_mark": lambda: self._marks.go(-1),
            "marks": self._marks.show_all,
            **{f"export {kind}": partial(self._outputs.export, kind) for kind in FORMATS},
            "path": self.path.toggle,
            "add_key": self.path.add,
            "clear_keys": self.path.clear,
            "stop_export": window.exports.stop,
            **{f"share {form}": partial(self.shares.ask, form) for form in FORMS},
            "serve": self.shares.serve,
            "stop_serving": self.shares.stop,
            "shortcuts": lambda: window.dialogs.message("Shortcuts", shortcuts_text()),
            "about": self._about,
        }

    def for_key(self, event: gui.KeyEvent) -> Action | None:
        """The action of a key; None if it has none."""
        window, key = self._window, gui.KeyName
        player, transport = window.player, window.player.transport
        menu = self.menu()
        of_menu: dict[str, tuple[Any, ...]] = {
            "background": (key.B,),
            "reset": (key.R,),
            "mark": (key.M,),
            "add_key": (key.K,),
            "path": (key.P,),
            "fullscreen": (key.F,),
            "figures": (key.I,),
            "queue": (key.Q,),
            "edit": (key.X,),
            "shortcuts": (key.QUESTION_MARK, key.SLASH),
            "previous_mark": (key.COMMA, key.LESS_THAN),
            "next_mark": (key.PERIOD, key.GREATER_THAN),
        }
        actions: dict[Any, Action] = {
            key.SPACE: transport.toggle,
            key.LEFT: lambda: transport.step(-1),
            key.RIGHT: lambda: transport.step(1),
            key.HOME: lambda: transport.seek(0),
            key.END: lambda: transport.seek(transport.last),
            key.LEFT_BRACKET: lambda: transport.jump_group(-1),
            key.RIGHT_BRACKET: lambda: transport.jump_group(1),
            key.ONE: lambda: self._review("truth"),
            key.TWO: lambda: self._review("trained"),
            key.THREE: lambda: self._review("decoded"),
            key.FOUR: lambda: self._review("other"),
            key.S: lambda: self._review("side by side"),
            key.W: lambda: self._review("wipe"),
            key.D: lambda: self._review("difference"),
            key.C: player.next_camera,
            key.Z: player.zoom_to_performer,
            key.L: lambda: transport.set_loop(not transport.loop),
            key.V: player.toggle_sound,
            **{one: menu[name] for name, keys in of_menu.items() for one in keys},
            **self.points.keys(),
        }
        return actions.get(event.key)

    def for_chord(self, event: gui.KeyEvent, shift: bool) -> Action | None:
        """The action of a key pressed with Ctrl; None if it has none."""
        key = gui.KeyName
        if event.key == key.Y or (event.key == key.Z and shift):
            return self.redo
        return self.undo if event.key == key.Z else None

    def undo(self) -> None:
        """Reverse the last change of settings, marks or edits."""
        self._step(self._window.workspace.history.undo)

    def redo(self) -> None:
        """Make the change that was undone again."""
        self._step(self._window.workspace.history.redo)

    def _step(self, step: Callable[[], str]) -> None:
        try:
            words = step()
        except StudioError as error:
            words = str(error)
        self._window.notices.tell(words)
        self._window.marks_changed()
        self.edits.changed()

    def _review(self, choice: str) -> None:
        views = self._window.views
        self._window.select("review")
        views.choose(choice)
        if views.asked_bakes:
            views.asked_bakes = False
            self.bakes.show()

    def pick(self, field: SettingField) -> None:
        """Choose the file or the folder of a setting in a dialog."""
        window = self._window
        config = window.workspace.config
        if config is None:
            return
        kind = "folder" if field.name in FOLDERS else "file"

        def done(chosen: str) -> None:
            window.stages.set_text(field, chosen)

        ask_path(window.dialogs, field.label[:1].upper() + field.label[1:], place_of(field, config), kind, done)

    # Runs

    def run(self, stage: str, again: bool) -> None:
        """Run a stage, or check the footage."""
        window = self._window
        if stage == "capture":
            window.views.capture.check()
            return

        def start() -> None:
            if window.workspace.start(stage, again) and stage != "all":
                window.select(stage)

        if not again or stage in ("bake", "review"):
            start()
            return
        window.dialogs.ask(
            f"Run {TITLES[stage]} again?",
            "Nothing that this stage depends on has changed, so the result would be the same.\n"
            "Its current results are deleted first and are lost if you cancel the run.",
            [("again", "Run again", start), ("stay", "Cancel", lambda: None)],
        )

    def ask_about_job(self) -> None:
        """Ask what to do with the running job before closing."""
        window = self._window

        def leave() -> None:
            window.wants_close = True

        def stop() -> None:
            window.workspace.cancel()
            window.wants_close = True

        window.dialogs.ask(
            "A run is in progress",
            "It can continue without the window; open the take again to follow it.\n"
            "If you stop it, finished work is kept and the next run resumes from there.",
            [
                ("leave", "Leave running", leave),
                ("stop", "Stop run", stop),
                ("stay", "Cancel", lambda: None),
            ],
        )

    # Opening

    def new_take(self) -> None:
        """Ask for footage, settings and the take's folder."""
        ask_new_take(self._window.dialogs, NewTake(), self._create)

    def _create(self, new: NewTake) -> None:
        window = self._window
        try:
            root = new.create()
        except StudioError as error:
            ask_new_take(window.dialogs, new, self._create, str(error))
            return
        window.dialogs.close()
        window.open(str(root))

    def _ask_open(self) -> None:
        window = self._window
        opened = window.player.opened
        known = [Path(name) for name in window.preferences.recent if "://" not in name]
        if opened is not None and isinstance(opened.path, Path):
            known.insert(0, opened.path)
        start = next((path.parent for path in known if path.parent.is_dir()), Path.cwd())
        ask_path(window.dialogs, "Open take or stream", start, "take", window.open)

    def _ask_recent(self) -> None:
        window = self._window
        preferences = window.preferences

        def keep(names: list[str]) -> Action:
            def forget() -> None:
                preferences.recent = names
                preferences.save()

            return forget

        there = preferences.recent_there()
        answers: list[tuple[str, str, Action]] = []
        if len(there) < len(preferences.recent):
            answers.append(("forget", "Remove missing", keep(there)))
        if preferences.recent:
            answers.append(("clear", "Clear list", keep([])))
        gone = set(preferences.recent) - set(there)
        window.dialogs.choose("recent", "Open recent", preferences.recent, window.open, gone, answers)

    def _ask_address(self) -> None:
        window = self._window
        window.dialogs.line(
            "address",
            "Open stream from URL",
            "URL of the stream's folder, for example https://example.org/streams/walk",
            "",
            [("open", "Open", lambda text: window.open(text.strip())), ("close", "Cancel", lambda _: None)],
        )

    def _save_preferences(self, preferences: Preferences) -> None:
        window = self._window
        window.preferences = preferences
        window.apply_preferences()
        if not preferences.save():
            window.player.message = "Preferences could not be saved; they apply until the window is closed."

    def _about(self) -> None:
        text = (
            f"V3 Studio {program_version()}\n\nFrom synchronized multi-camera footage of a performer to a "
            "streamable Gaussian video.\nGNU General Public License, version 3 or later.\n\n"
            f"Graphics device: {self._window.device}"
        )
        self._window.dialogs.message("About", text)
