"""The table of commands: what menus, keys and buttons do."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from open3d.visualization import gui

from v3studio.gui.actions.edits import EditActions
from v3studio.gui.actions.help import HelpActions
from v3studio.gui.actions.marks import MarkActions
from v3studio.gui.actions.menus import Item, Needs
from v3studio.gui.actions.opening import OpenDialogs
from v3studio.gui.actions.output import OutputActions
from v3studio.gui.actions.path import PathActions
from v3studio.gui.actions.points import PointActions
from v3studio.gui.actions.preferences import PreferenceActions
from v3studio.gui.actions.queue import QueueActions
from v3studio.gui.actions.review import ReviewActions
from v3studio.gui.actions.runs import RunActions
from v3studio.gui.actions.search import SearchActions, opens_list
from v3studio.gui.actions.shares import ShareActions
from v3studio.gui.actions.start import StartScreen
from v3studio.gui.actions.worst import WorstActions
from v3studio.gui.drawing.compare import Mode, What
from v3studio.gui.layout import Layout
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.exports import Exports
from v3studio.gui.models.take.serving import Serving
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.platform.closing import CloseRequests

Action = Callable[[], object]
NOTHING, TAKE, SPLATS = Needs.NOTHING, Needs.TAKE, Needs.SPLATS

SWITCHES = frozenset(getattr(gui.KeyName, name) for name in (*"ABDFIJLOPSTVWX", "SPACE"))
"""Keys that act once while they are held; otherwise they would switch back and forth. None that opens a text field: the
field would keep the release of the key, and its next press would be taken for a repeat."""

KEYS_OF = {"?": ("QUESTION_MARK", "SLASH"), "<": ("COMMA", "LESS_THAN"), ">": ("PERIOD", "GREATER_THAN")}
"""Keys of the toolkit by shortcut, where they have other names: with and without Shift."""


@dataclass(frozen=True)
class Actions:
    """The models and groups of actions that commands choose from, and the command of each key."""

    player: PlayerPresenter
    views: StageViews
    workspace: Workspace
    exports: Exports
    serving: Serving
    closing: CloseRequests
    opening: OpenDialogs
    preferences: PreferenceActions
    outputs: OutputActions
    runs: RunActions
    edits: EditActions
    review: ReviewActions
    worst: WorstActions
    queue: QueueActions
    screen: StartScreen
    layout: Layout
    marks: MarkActions
    points: PointActions
    path: PathActions
    shares: ShareActions
    help: HelpActions
    search: SearchActions
    notices: Notices

    def act(self, item: "Item[Actions]") -> None:
        """Do what an item of the menus stands for: what needs an open take, without the start page over it."""
        if item.needs == NOTHING or not self.screen.shown:
            item.act(self)
        elif not self.screen.leave_for(partial(item.act, self)):
            opening = self.workspace.opening
            self.notices.show(f"{opening} is being opened." if opening else "Open a take or a stream first.")

    def why_not(self, item: "Item[Actions]") -> str:
        """Return why an item of the menus is not possible now; "" if it is."""
        opened = self.player.opened
        if item.needs != NOTHING and opened is None:
            opening = self.workspace.opening
            return f"{opening} is being opened." if opening else "No take or stream is open."
        if item.needs == TAKE and opened is not None and opened.take is None:
            return "No take is open."
        if item.lacks is not None and not item.lacks[0](self):
            return item.lacks[1]
        return "Nothing is trained yet." if item.needs == SPLATS and opened and not opened.sources else ""

    def for_key(self, event: gui.KeyEvent, again: bool = False) -> Action | None:
        """The action of a key; None if it has none, or if it is one of `SWITCHES` and is held (`again`)."""
        key, review, player, transport = gui.KeyName, self.review, self.player, self.player.transport
        if again and event.key in SWITCHES:
            return None
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
            key.ONE: lambda: review.choose(What.FOOTAGE),
            key.TWO: lambda: review.choose(What.TRAINED),
            key.THREE: lambda: review.choose(What.DECODED),
            key.FOUR: lambda: review.choose(What.OTHER),
            key.S: lambda: review.choose(Mode.SIDE_BY_SIDE),
            key.W: lambda: review.choose(Mode.WIPE),
            key.D: lambda: review.choose(Mode.DIFFERENCE),
            key.B: review.exchange,
            key.Z: player.zoom_to_performer,
            key.L: lambda: transport.set_loop(not transport.loop),
            key.V: player.toggle_sound,
            **of_menu,
            **self.points.keys(),
            **self.edits.keys(),
        }
        return actions.get(event.key)

    def for_chord(self, event: gui.KeyEvent, shift: bool) -> Action | None:
        """The action of a key pressed with Ctrl; None if it has none."""
        key = gui.KeyName
        if opens_list(event, shift):
            return self.search.show
        if event.key == key.Y or (event.key == key.Z and shift):
            return self.edits.redo
        return self.edits.undo if event.key == key.Z else None


Lack = tuple[Callable[[Actions], object], str]
"""A condition of a command, and the sentence that is said if it is not met."""

NO_UNDO: Lack = (lambda do: do.workspace.history.made, "Nothing to undo.")
NO_REDO: Lack = (lambda do: do.workspace.history.undone, "Nothing to redo.")
NO_CAMERAS: Lack = (lambda do: do.player.camera_names, "There are no cameras yet.")
NO_FIGURES: Lack = (lambda do: do.worst.quality.evaluation.frames, "Nothing is evaluated yet. Run Review.")
NO_MARKS: Lack = (lambda do: do.marks.marks.notes, "No marks yet. M makes one.")
NO_PATH: Lack = (lambda do: do.path.editor.keys, "The camera path is empty.")
NO_EXPORT: Lack = (lambda do: do.exports.running, "No export is running.")
NOT_SERVED: Lack = (lambda do: do.serving.running, "Nothing is served.")

MENUS: dict[str, tuple[Item[Actions] | None, ...]] = {  # by title; None is a line between items
    "File": (
        Item("new", "New take from footage...", lambda do: do.opening.new_take(), needs=NOTHING),
        Item("open", "Open take, stream or cast...", lambda do: do.opening.ask(), needs=NOTHING),
        Item("address", "Open stream from URL...", lambda do: do.opening.ask_address(), needs=NOTHING),
        None,
        Item("screenshot", "Save screenshot...", lambda do: do.outputs.screenshot()),
        Item("report", "Write HTML report", lambda do: do.outputs.report(), needs=TAKE),
        None,
        Item("preferences", "Preferences...", lambda do: do.preferences.ask(), needs=NOTHING),
        Item("quit", "Quit", lambda do: do.closing.ask(), needs=NOTHING),
    ),
    "Edit": (
        Item("undo", "Undo", lambda do: do.edits.undo(), "Ctrl+Z", lacks=NO_UNDO),
        Item("redo", "Redo", lambda do: do.edits.redo(), "Ctrl+Shift+Z", lacks=NO_REDO),
        None,
        Item("edit", "Trim, crop, clean", lambda do: do.edits.show(), "X", needs=TAKE),
    ),
    "View": (
        Item("reset", "Reset view", lambda do: do.views.reset(), "R"),
        Item("camera", "Next capture camera", lambda do: do.player.next_camera(), "C", lacks=NO_CAMERAS),
        Item("span", "Select span: from here, to here, none", lambda do: do.review.step_span(), "T"),
        None,
        Item("scene", "Scene: splats, cameras, points", lambda do: do.review.choose(Mode.SCENE), "O", needs=SPLATS),
        None,
        Item("worst", "Worst frames by camera...", lambda do: do.worst.show(), needs=TAKE, lacks=NO_FIGURES),
        Item("queue", "Queue of takes", lambda do: do.queue.show(), "Q", needs=NOTHING),
        None,
        Item("start", "Start page", lambda do: do.screen.toggle(), "H", needs=NOTHING),
        Item("figures", "Inspector and log", lambda do: do.layout.toggle_figures(), "I"),
        Item("log", "Job log, large", lambda do: do.layout.toggle_log(), "J"),
        Item("log_warnings", "Job log: warnings only, all lines", lambda do: do.layout.toggle_warnings()),
        Item("fullscreen", "Fullscreen", lambda do: do.layout.toggle_fullscreen(), "F", needs=NOTHING),
    ),
    "Mark": (
        Item("mark", "Mark frame...", lambda do: do.marks.ask(), "M"),
        Item("next_mark", "Next mark", lambda do: do.marks.go_to_next(1), ">", lacks=NO_MARKS),
        Item("previous_mark", "Previous mark", lambda do: do.marks.go_to_next(-1), "<", lacks=NO_MARKS),
        Item("marks", "All marks...", lambda do: do.marks.show()),
    ),
    "Export": (
        Item("export", "Export...", lambda do: do.outputs.export(), needs=SPLATS),
        None,
        Item("path", "Camera path editor", lambda do: do.path.toggle(), "P"),
        Item("add_key", "Add view to camera path", lambda do: do.path.add(), "K", needs=SPLATS),
        Item("read_keys", "Camera path from file...", lambda do: do.path.ask_file(), needs=SPLATS),
        Item("clear_keys", "Clear camera path", lambda do: do.path.clear(), lacks=NO_PATH),
        None,
        Item("stop_export", "Stop export", lambda do: do.exports.stop(), needs=NOTHING, lacks=NO_EXPORT),
    ),
    "Share": (
        Item("share folder", "Folder for a web server...", lambda do: do.shares.ask("folder")),
        Item("share single-file", "Single HTML file...", lambda do: do.shares.ask("single-file")),
        None,
        Item("serve", "Serve with QR code...", lambda do: do.shares.serve()),
        Item("stop_serving", "Stop serving", lambda do: do.serving.stop(), needs=NOTHING, lacks=NOT_SERVED),
    ),
    "Help": (
        Item("stage_help", "What to look for", lambda do: do.help.show_stage(), "F1"),
        None,
        Item("search", "Find a command...", lambda do: do.search.show(), "Ctrl+K", needs=NOTHING),
        Item("shortcuts", "Shortcuts", lambda do: do.help.show_shortcuts(MENUS), "?", needs=NOTHING),
        None,
        Item("about", "About", lambda do: do.help.about(), needs=NOTHING),
    ),
}

ITEMS = {item.key: item for items in MENUS.values() for item in items if item is not None}
