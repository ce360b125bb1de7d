"""What menus, keys and buttons do."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from open3d.visualization import gui

from gui.actions.bakes import BakeActions
from gui.actions.cameras import CameraActions
from gui.actions.edits import EditActions
from gui.actions.help import show_shortcuts, show_stage_help
from gui.actions.marks import ask_mark, go_to_next, show_marks
from gui.actions.menus import ITEMS
from gui.actions.output import OutputActions
from gui.actions.path import PathActions
from gui.actions.points import follow_points, point_keys
from gui.actions.queue import QueueActions
from gui.actions.search import SearchActions, opens_list
from gui.actions.shares import ask_share, follow_sharing, serve
from gui.actions.start import StartActions
from gui.models.loop import later
from gui.models.preferences import BACKGROUND_NAMES, PICTURE_SIZES
from gui.models.stage_rows import TITLES
from gui.models.take.setting_words import FOLDERS
from gui.models.take.settings import SettingField, place_of
from gui.models.take.shares import FORMS
from gui.platform.clipboard import Clipboard
from gui.shell import Shell
from gui.widgets.dialogs.folder import ask_path
from gui.widgets.dialogs.form import Form
from gui.widgets.dialogs.take import NewTakeDialog
from pipelines.new_take import NewTake
from pipelines.takes.take import program_version
from studio.errors import StudioError

Action = Callable[[], object]

SWITCHES = frozenset(getattr(gui.KeyName, name) for name in ("O", "S", "W", "D", "B", "X", "F", "I", "J", "L", "SPACE"))
"""Keys that act once while they are held; otherwise they would switch back and forth. None that opens a text field: the
field would keep the release of the key, and its next press would be taken for a repeat."""

KEYS_OF = {"?": ("QUESTION_MARK", "SLASH"), "<": ("COMMA", "LESS_THAN"), ">": ("PERIOD", "GREATER_THAN")}
"""Keys of the toolkit by shortcut, where they have other names: with and without Shift."""


class Actions:
    """See the module. Acts through the window."""

    def __init__(self, window: Shell) -> None:
        self._window = window
        follow_points(window)
        follow_sharing(window)
        self._outputs = OutputActions(window)
        self.cameras = CameraActions(window)
        self.queue = QueueActions(window)
        self.bakes = BakeActions(window)
        dialogs = {"cameras": self.cameras.ask, "bakes": self.bakes.show}
        window.views.dialog_wanted.connect(later(lambda name: dialogs[name]()))
        self.edits = EditActions(window)
        self.path = PathActions(window, lambda: self._outputs.export("camera-path"))
        self.clipboard = Clipboard()
        self.search = SearchActions(window, self.menu)
        others = {"new": self.new_take, "open": self._ask_open, "address": self._ask_address, "queue": self.queue.show}
        self.new_take_dialog = NewTakeDialog(window.dialogs, self._create, window.changed)
        self.start = StartActions(window, self.queue.queue, self.clipboard, others, self.new_take_dialog.show)

    def menu(self) -> dict[str, Action]:
        """Actions by key of `ITEMS`."""
        window = self._window
        actions: dict[str, Action] = {
            "new": self.new_take,
            "open": self._ask_open,
            "address": self._ask_address,
            "undo": partial(self._step, window.workspace.history.undo),
            "redo": partial(self._step, window.workspace.history.redo),
            "edit": self.edits.show,
            "screenshot": self._outputs.screenshot,
            "report": self._outputs.report,
            "preferences": self._ask_preferences,
            "quit": window.close_requests.ask,
            "reset": window.views.reset,
            "scene": lambda: self._review("scene"),
            "camera": window.player.next_camera,
            "worst": self.cameras.show_worst,
            "fullscreen": lambda: window.layout.set_fullscreen(not window.layout.fullscreen),
            "figures": window.layout.toggle_figures,
            "queue": self.queue.show,
            "start": self.start.toggle,
            "span": self._step_span,
            "mark": partial(ask_mark, window),
            "next_mark": partial(go_to_next, window, 1),
            "previous_mark": partial(go_to_next, window, -1),
            "marks": partial(show_marks, window),
            "export": self._outputs.export,
            "path": self.path.toggle,
            "add_key": self.path.add,
            "read_keys": self.path.ask_file,
            "clear_keys": self.path.clear,
            "stop_export": window.exports.stop,
            **{f"share {form}": partial(ask_share, window, form) for form in FORMS},
            "serve": partial(serve, window),
            "stop_serving": window.serving.stop,
            "stage_help": partial(show_stage_help, window),
            "shortcuts": partial(show_shortcuts, window),
            "about": self._about,
            "log": window.layout.toggle_log,
            "log_warnings": window.inspector.toggle_warnings,
            "search": self.search.show,
        }
        return {key: partial(self._uncovered, act) if ITEMS[key].needs else act for key, act in actions.items()}

    def _uncovered(self, action: Action) -> None:
        """Act on the open take or stream, without the start page over it."""
        if self._window.start.shown and not self.start.hide():
            self._window.notices.show("Open a take or a stream first.")
        else:
            action()

    def for_key(self, event: gui.KeyEvent, again: bool = False) -> Action | None:
        """The action of a key; None if it has none, or if it is one of `SWITCHES` and is held (`again`)."""
        window, key = self._window, gui.KeyName
        if again and event.key in SWITCHES:
            return None
        player, transport = window.player, window.player.transport
        menu = self.menu()
        of_menu = {
            getattr(key, name): menu[item.key]
            for item in ITEMS.values()
            if item.shortcut and "+" not in item.shortcut
            for name in KEYS_OF.get(item.shortcut, (item.shortcut,))
        }
        actions: dict[Any, Action] = {
            key.SPACE: transport.toggle,
            key.LEFT: lambda: transport.step(-1),
            key.RIGHT: lambda: transport.step(1),
            key.HOME: lambda: transport.seek(0),
            key.END: lambda: transport.seek(transport.last),
            key.LEFT_BRACKET: lambda: transport.jump_group(-1),
            key.RIGHT_BRACKET: lambda: transport.jump_group(1),
            key.ONE: lambda: self._review("footage"),
            key.TWO: lambda: self._review("trained"),
            key.THREE: lambda: self._review("decoded"),
            key.FOUR: lambda: self._review("other"),
            key.S: lambda: self._review("side by side"),
            key.W: lambda: self._review("wipe"),
            key.D: lambda: self._review("difference"),
            key.B: self._exchange,
            key.Z: player.zoom_to_performer,
            key.L: lambda: transport.set_loop(not transport.loop),
            key.V: player.toggle_sound,
            **of_menu,
            **point_keys(window),
            **self.edits.keys(),
        }
        return actions.get(event.key)

    def for_chord(self, event: gui.KeyEvent, shift: bool) -> Action | None:
        """The action of a key pressed with Ctrl; None if it has none."""
        key, history = gui.KeyName, self._window.workspace.history
        if opens_list(event, shift):
            return self.search.show
        if event.key == key.Y or (event.key == key.Z and shift):
            return partial(self._step, history.redo)
        return partial(self._step, history.undo) if event.key == key.Z else None

    def _step(self, step: Callable[[], str]) -> None:
        self._window.notices.show(step())
        self._window.views.editor.pending = None  # what was selected belongs to other edits

    def _review(self, choice: str) -> None:
        views = self._window.views
        came = views.stage != "review"
        self._window.select("review")
        if not (came and choice == views.player.mode):  # from elsewhere a key shows a comparison, never turns it off
            views.choose(choice)

    def _exchange(self) -> None:
        self._window.select("review")
        self._window.views.leave()
        self._window.player.exchange()

    def pick(self, field: SettingField) -> None:
        """Choose the file or the folder of a setting in a dialog."""
        window = self._window
        config = window.workspace.config
        if config is None:
            return
        title, kind = field.label[:1].upper() + field.label[1:], "folder" if field.name in FOLDERS else "file"
        ask_path(window.dialogs, title, place_of(field, config), kind, partial(window.stages.set_text, field))

    def _step_span(self) -> None:
        window = self._window
        if window.player.opened is not None:
            window.notices.show(window.player.transport.step_span())

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
            [("leave", "Leave running", leave), ("stop", "Stop run", stop), ("stay", "Cancel", lambda: None)],
        )

    # Opening

    def new_take(self) -> None:
        """Ask for footage, settings and the take's folder."""
        self.new_take_dialog.show(NewTake())

    def _create(self, new: NewTake) -> None:
        window = self._window
        try:
            root = new.create()
        except StudioError as error:
            self.new_take_dialog.show(new, str(error))
            return
        window.dialogs.close()
        window.open(str(root))

    def _ask_open(self) -> None:
        window = self._window
        opened = window.player.opened
        known = [Path(name) for name in window.preferences.recent if "://" not in name]
        if opened is not None and isinstance(opened.path, Path):
            known.insert(0, opened.path)
        start = window.dialogs.usual_folder(*(path.parent for path in known))
        ask_path(window.dialogs, "Open take, stream or cast", start, "take", window.open, endings=(".v3s", ".json"))

    def _ask_address(self) -> None:
        window = self._window
        window.dialogs.line(
            "address",
            "Open stream from URL",
            "URL of the stream's folder, for example https://example.org/streams/walk",
            "",
            [("open", "Open", lambda text: window.open(text.strip())), ("close", "Cancel", lambda _: None)],
        )

    def _ask_preferences(self) -> None:
        window, dialogs = self._window, self._window.dialogs
        chosen = replace(window.preferences, recent=list(window.preferences.recent))
        form = Form(dialogs, chosen)
        form.choice("picture_size", "Render resolution", list(PICTURE_SIZES))
        form.choice("background", "Background", BACKGROUND_NAMES)
        form.switch("play_on_opening", "Autoplay")

        def save() -> None:
            window.preferences = chosen
            window.apply_preferences()
            words = "Preferences could not be saved; they apply until the window is closed."
            window.notices.outcome("preferences", "" if chosen.save() else words)

        form.show("preferences", "Preferences", [form.grid], ("save", "Save", dialogs.closing(save)), 60)

    def _about(self) -> None:
        text = (
            f"V3 Studio {program_version()}\n\nFrom synchronized multi-camera footage of a performer to a "
            "streamable Gaussian video.\nGNU General Public License, version 3 or later.\n\n"
            f"Graphics device: {self._window.device}"
        )
        self._window.dialogs.message("About", text)
