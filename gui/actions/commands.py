"""What menus, keys and buttons do."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from open3d.visualization import gui

from v3studio.gui.actions.bakes import BakeActions
from v3studio.gui.actions.cameras import CameraActions
from v3studio.gui.actions.edits import EditActions
from v3studio.gui.actions.help import show_shortcuts, show_stage_help
from v3studio.gui.actions.marks import ask_mark, go_to_next, show_marks
from v3studio.gui.actions.menus import Item
from v3studio.gui.actions.output import OutputActions
from v3studio.gui.actions.path import PathActions
from v3studio.gui.actions.points import follow_points, point_keys
from v3studio.gui.actions.queue import QueueActions
from v3studio.gui.actions.search import SearchActions, opens_list
from v3studio.gui.actions.shares import ask_share, follow_sharing, serve
from v3studio.gui.actions.start import StartActions
from v3studio.gui.models.loop import later
from v3studio.gui.models.preferences import BACKGROUND_NAMES, PICTURE_SIZES
from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.setting_words import FOLDERS
from v3studio.gui.models.take.settings import SettingField, place_of
from v3studio.gui.platform.clipboard import Clipboard
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.gui.widgets.dialogs.form import Form
from v3studio.gui.widgets.dialogs.take import NewTakeDialog
from v3studio.pipelines.new_take import NewTake
from v3studio.pipelines.takes.take import program_version
from v3studio.studio.errors import StudioError

Action = Callable[[], object]

SWITCHES = frozenset(getattr(gui.KeyName, name) for name in (*"ABDFIJLOPSTVWX", "SPACE"))
"""Keys that act once while they are held; otherwise they would switch back and forth. None that opens a text field: the
field would keep the release of the key, and its next press would be taken for a repeat."""

KEYS_OF = {"?": ("QUESTION_MARK", "SLASH"), "<": ("COMMA", "LESS_THAN"), ">": ("PERIOD", "GREATER_THAN")}
"""Keys of the toolkit by shortcut, where they have other names: with and without Shift."""


class Actions:
    """See the module. Acts through the window."""

    def __init__(self, window: Shell) -> None:
        self.window = window
        follow_points(window)
        follow_sharing(window)
        self.outputs = OutputActions(window)
        self.cameras = CameraActions(window)
        self.queue = QueueActions(window)
        self.bakes = BakeActions(window)
        dialogs = {"cameras": self.cameras.ask, "bakes": self.bakes.show}
        window.views.dialog_wanted.connect(later(lambda name: dialogs[name]()))
        self.edits = EditActions(window)
        self.path = PathActions(window, lambda: self.outputs.export("camera-path"))
        self.clipboard = Clipboard()
        self.search = SearchActions(window, MENUS, self.act)
        self.new_take_dialog = NewTakeDialog(window.dialogs, self._create, window.changed)
        by_key, new_take = lambda key: self.act(ITEMS[key]), self.new_take_dialog.show
        self.start: StartActions = StartActions(window, self.queue.queue, self.clipboard, by_key, new_take)

    def act(self, item: "Item[Actions]") -> None:
        """Do what an item of the menus stands for: what needs an open take, without the start page over it."""
        if item.needs and self.window.start.shown and not self.start.hide():
            self.window.notices.show("Open a take or a stream first.")
        else:
            item.act(self)

    def for_key(self, event: gui.KeyEvent, again: bool = False) -> Action | None:
        """The action of a key; None if it has none, or if it is one of `SWITCHES` and is held (`again`)."""
        window, key = self.window, gui.KeyName
        if again and event.key in SWITCHES:
            return None
        player, transport = window.player, window.player.transport
        of_menu = {
            getattr(key, name): partial(self.act, item)
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
            key.ONE: lambda: self.review("footage"),
            key.TWO: lambda: self.review("trained"),
            key.THREE: lambda: self.review("decoded"),
            key.FOUR: lambda: self.review("other"),
            key.S: lambda: self.review("side by side"),
            key.W: lambda: self.review("wipe"),
            key.D: lambda: self.review("difference"),
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
        key, history = gui.KeyName, self.window.workspace.history
        if opens_list(event, shift):
            return self.search.show
        if event.key == key.Y or (event.key == key.Z and shift):
            return partial(self.step, history.redo)
        return partial(self.step, history.undo) if event.key == key.Z else None

    def step(self, step: Callable[[], str]) -> None:
        self.window.notices.show(step())
        self.window.views.editor.pending = None  # what was selected belongs to other edits

    def review(self, choice: str) -> None:
        views = self.window.views
        came = views.stage != "review"
        self.window.views.select("review")
        if not (came and choice == views.player.mode):  # from elsewhere a key shows a comparison, never turns it off
            views.choose(choice)

    def _exchange(self) -> None:
        self.window.views.select("review")
        self.window.views.leave()
        self.window.player.exchange()

    def pick(self, field: SettingField) -> None:
        """Choose the file or the folder of a setting in a dialog."""
        window = self.window
        config = window.workspace.config
        if config is None:
            return
        title, kind = field.label[:1].upper() + field.label[1:], "folder" if field.name in FOLDERS else "file"
        ask_path(window.dialogs, title, place_of(field, config), kind, partial(window.stages.set_text, field))

    def step_span(self) -> None:
        window = self.window
        if window.player.opened is not None:
            window.notices.show(window.player.transport.step_span())

    # Runs

    def run(self, stage: str, again: bool) -> None:
        """Run a stage, or check the footage."""
        window = self.window
        if stage == "capture":
            window.views.capture.check()
            return

        def start() -> None:
            if window.workspace.start(stage, again) and stage != "all":
                window.views.select(stage)

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
        window = self.window

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
        window = self.window
        try:
            root = new.create()
        except StudioError as error:
            self.new_take_dialog.show(new, str(error))
            return
        window.dialogs.close()
        window.open(str(root))

    def ask_open(self) -> None:
        window = self.window
        opened = window.player.opened
        known = [Path(name) for name in window.preferences.recent if "://" not in name]
        if opened is not None and isinstance(opened.path, Path):
            known.insert(0, opened.path)
        start = window.dialogs.usual_folder(*(path.parent for path in known))
        ask_path(window.dialogs, "Open take, stream or cast", start, "take", window.open, endings=(".v3s", ".json"))

    def ask_address(self) -> None:
        words = "URL of the stream's folder, for example https://example.org/streams/walk"
        open_ = ("open", "Open", lambda text: self.window.open(text.strip()))
        self.window.dialogs.line("address", "Open stream from URL", words, "", open_)

    def ask_preferences(self) -> None:
        window, dialogs = self.window, self.window.dialogs
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

    def about(self) -> None:
        text = (
            f"V3 Studio {program_version()}\n\nFrom synchronized multi-camera footage of a performer to a "
            "streamable Gaussian video.\nGNU General Public License, version 3 or later.\n\n"
            f"Graphics device: {self.window.device}"
        )
        self.window.dialogs.message("About", text)


MENUS: dict[str, tuple[Item[Actions] | None, ...]] = {  # by title; None is a line between items
    "File": (
        Item("new", "New take from footage...", Actions.new_take, needs=""),
        Item("open", "Open take, stream or cast...", Actions.ask_open, needs=""),
        Item("address", "Open stream from URL...", Actions.ask_address, needs=""),
        None,
        Item("screenshot", "Save screenshot...", lambda do: do.outputs.screenshot()),
        Item("report", "Write HTML report", lambda do: do.outputs.report(), needs="take"),
        None,
        Item("preferences", "Preferences...", Actions.ask_preferences, needs=""),
        Item("quit", "Quit", lambda do: do.window.close_requests.ask(), needs=""),
    ),
    "Edit": (
        Item("undo", "Undo", lambda do: do.step(do.window.workspace.history.undo), "Ctrl+Z"),
        Item("redo", "Redo", lambda do: do.step(do.window.workspace.history.redo), "Ctrl+Shift+Z"),
        None,
        Item("edit", "Trim, crop, clean", lambda do: do.edits.show(), "X", needs="take"),
    ),
    "View": (
        Item("reset", "Reset view", lambda do: do.window.views.reset(), "R"),
        Item("camera", "Next capture camera", lambda do: do.window.player.next_camera(), "C"),
        Item("span", "Select span: from here, to here, none", Actions.step_span, "T"),
        None,
        Item("scene", "Scene: splats, cameras, points", lambda do: do.review("scene"), "O", needs="splats"),
        None,
        Item("worst", "Worst frames by camera...", lambda do: do.cameras.show_worst(), needs="take"),
        Item("queue", "Queue of takes", lambda do: do.queue.show(), "Q", needs=""),
        None,
        Item("start", "Start page", lambda do: do.start.toggle(), "H", needs=""),
        Item("figures", "Inspector and log", lambda do: do.window.layout.toggle_figures(), "I"),
        Item("log", "Job log, large", lambda do: do.window.layout.toggle_log(), "J"),
        Item("log_warnings", "Job log: warnings only, all lines", lambda do: do.window.inspector.toggle_warnings()),
        Item("fullscreen", "Fullscreen", lambda do: do.window.layout.toggle_fullscreen(), "F", needs=""),
    ),
    "Mark": (
        Item("mark", "Mark frame...", lambda do: ask_mark(do.window), "M"),
        Item("next_mark", "Next mark", lambda do: go_to_next(do.window, 1), ">"),
        Item("previous_mark", "Previous mark", lambda do: go_to_next(do.window, -1), "<"),
        Item("marks", "All marks...", lambda do: show_marks(do.window)),
    ),
    "Export": (
        Item("export", "Export...", lambda do: do.outputs.export(), needs="splats"),
        None,
        Item("path", "Camera path editor", lambda do: do.path.toggle(), "P"),
        Item("add_key", "Add view to camera path", lambda do: do.path.add(), "K", needs="splats"),
        Item("read_keys", "Camera path from file...", lambda do: do.path.ask_file(), needs="splats"),
        Item("clear_keys", "Clear camera path", lambda do: do.path.clear()),
        None,
        Item("stop_export", "Stop export", lambda do: do.window.exports.stop(), needs=""),
    ),
    "Share": (
        Item("share folder", "Folder for a web server...", lambda do: ask_share(do.window, "folder")),
        Item("share single-file", "Single HTML file...", lambda do: ask_share(do.window, "single-file")),
        None,
        Item("serve", "Serve with QR code...", lambda do: serve(do.window)),
        Item("stop_serving", "Stop serving", lambda do: do.window.serving.stop(), needs=""),
    ),
    "Help": (
        Item("stage_help", "What to look for", lambda do: show_stage_help(do.window), "F1"),
        None,
        Item("search", "Find a command...", lambda do: do.search.show(), "Ctrl+K", needs=""),
        Item("shortcuts", "Shortcuts", lambda do: show_shortcuts(do.window, MENUS), "?", needs=""),
        None,
        Item("about", "About", Actions.about, needs=""),
    ),
}

ITEMS = {item.key: item for items in MENUS.values() for item in items if item is not None}
