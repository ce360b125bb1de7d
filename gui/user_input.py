"""Keys, mouse and menus of the window: what comes from the user, and what it does."""

from collections.abc import Callable, Sequence
from functools import partial

from open3d.visualization import gui

from v3studio.gui.actions.commands import Actions
from v3studio.gui.actions.menus import Item
from v3studio.gui.actions.opening import PasteActions
from v3studio.gui.actions.search import opens_list
from v3studio.gui.layout import Panels
from v3studio.gui.models.loop import LOOP
from v3studio.gui.platform.closing import CloseRequests
from v3studio.gui.platform.input_order import InputOrder, Kind
from v3studio.gui.platform.menu_bar import MenuBar
from v3studio.gui.platform.presses import Chords, key_code, typed_code
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.picture import holds
from v3studio.gui.widgets.settings import SettingsList


class UserInput:
    """Passes events on to the toolkit, follows the mouse, and gives keys to the open dialog, to what lies over panels,
    or to a command. `escapes`: what Escape does while no dialog or menu is open: the first that returns True.
    `buttons`: the pressed mouse buttons, where `keys` does not see them."""

    def __init__(
        self, keys: InputOrder, chords: Chords, dialogs: Dialogs, closing: CloseRequests, menu_bar: MenuBar,
        panels: Panels, actions: Actions, pasting: PasteActions, escapes: Sequence[Callable[[], object]],
        buttons: Callable[[], int], changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self._input, self._chords, self._dialogs, self._closing = keys, chords, dialogs, closing
        self._menu_bar, self._panels, self._actions, self._pasting = menu_bar, panels, actions, pasting
        self._escapes, self._pressed, self._changed = escapes, buttons, changed
        self.buttons = 0
        self._pointer: tuple[int, int] | None = None
        keys.wanted = self._pointed

    @property
    def _settings(self) -> SettingsList:
        """The list of settings on screen."""
        stages = self._panels.stages
        return stages.settings[stages.selected]

    def on_key(self, event: gui.KeyEvent) -> bool:
        """Handle a key event of the toolkit; returns whether it is not to be handled further."""
        dialogs, chords = self._dialogs, self._chords
        LOOP.run()  # what is typed is for what a chosen item opens
        is_new, press = True, None
        if event.type == gui.KeyEvent.Type.DOWN:
            is_new, press = self._input.reports.reported(key_code(event.key))
        modifier = chords.note(event, press)
        if modifier and event.type == gui.KeyEvent.Type.UP:
            self._actions.search.show_expected()
        if event.key == gui.KeyName.ESCAPE:
            self._closing.escape()
            if event.type == gui.KeyEvent.Type.DOWN and is_new and not chords.again:
                self._escape()
            return True
        if event.key == gui.KeyName.ENTER and (dialogs.name or dialogs.expected):
            if event.type == gui.KeyEvent.Type.UP:
                dialogs.enter()
                self._changed()
            return True
        if not is_new:
            return True
        if dialogs.focusing and chords.again:
            return True  # the key that opened the dialog, still held
        if dialogs.key(event):
            return True
        if modifier or event.type != gui.KeyEvent.Type.DOWN or dialogs.name:
            return False
        settings = self._settings
        if event.key == gui.KeyName.ENTER:
            settings.edited = False
        if settings.edited and not chords.control and typed_code(event.key) is not None:
            return True  # for a field that has lost the focus
        return self._act(event)

    def _act(self, event: gui.KeyEvent) -> bool:
        """Do what a pressed key stands for; returns whether it stands for something."""
        chords = self._chords
        if not self._key_over_panels(event):
            if chords.control:
                action = None if chords.again else self._actions.for_chord(event, chords.shift)
            else:
                action = self._actions.for_key(event, chords.again)
            if action is None:
                return False
            action()
        self._changed()
        return True

    def _key_over_panels(self, event: gui.KeyEvent) -> bool:
        """Handle a key for what lies over the panels, the notice and the start page, or for the table in the view;
        returns whether it was one."""
        chords, key = self._chords, gui.KeyName
        start, bar = self._panels.start, self._panels.notice_bar
        on_start, control, card = start.shown, chords.control, self._actions.notices.card
        if chords.again and (control or event.key in (key.ENTER, key.BACKSPACE, key.DELETE, key.H)):
            return on_start or event.key == key.H
        if control and event.key == key.C and card is not None:
            bar.copy()
        elif control and event.key == key.O and card is not None:
            bar.open_folder()
        elif control and event.key == key.C and not on_start:
            return self._copy_table()
        elif not on_start or (control and opens_list(event, chords.shift)):
            return False
        elif control:
            if event.key == key.V:
                self._pasting.paste()
        elif event.key in (key.H, key.Q, key.QUESTION_MARK, key.SLASH):
            return False
        else:
            start.key(event, chords.shift)
        return True

    def _copy_table(self) -> bool:
        """Copy the table in the view; returns whether there is one."""
        view = self._actions.views.stage_view
        if view is None or not view.table_text:
            return False
        if self._panels.notice_bar.copied(view.table_text):
            self._actions.notices.show("Copied the table.")
        return True

    def _escape(self) -> None:
        """Do what Escape stands for: leave what was opened last."""
        if self._dialogs.name or self._dialogs.expected:
            self._dialogs.on_escape()
        elif self._menu_bar.opened:
            self._menu_bar.closed()
            self._dialogs.close_menu()
        else:
            any(leave() for leave in self._escapes)
        self._changed()

    def tick(self) -> bool:
        """Pass events on to the toolkit. Call at each tick; returns whether there were any."""
        keys, dialogs = self._input, self._dialogs
        keys.reports.dialog = bool(dialogs.name)
        came = keys.poll(hold=dialogs.focusing, release=dialogs.expected)
        if keys.came_to_rest():
            self._chords.release_all()
            self._actions.search.show_expected()
        if came - {Kind.MOVE, Kind.KEY_UP}:  # a frame that the toolkit drops would hide what they did
            self._changed()
        keys.reports.dialog = bool(dialogs.name)  # what came may have closed it
        if keys.reports.escape_kept():  # by a text field, which only restores its text
            self._escape()
        self._watch_mouse()
        return bool(came)

    def _watch_mouse(self) -> None:
        """Redraw when a mouse button is pressed or released: the toolkit reports no clicks on its menus and lists, and
        would show what they open only when the pointer moves."""
        buttons = self._input.buttons if self._input.active else self._pressed()
        if buttons != self.buttons:
            self.buttons = buttons
            self._changed()
        pointer, before = self._input.pointer, self._pointer
        self._pointer = pointer
        if pointer != before:
            self._actions.edits.moved(self._in_view(pointer))
            if pointer is not None and holds(self._settings.widget, *pointer):
                self._changed()  # a tooltip has the size of the one before it until the second draw

    def _in_view(self, pointer: tuple[int, int] | None) -> tuple[float, float] | None:
        """The place of the pointer over the view, relative to its width and height; None elsewhere."""
        panels, view = self._panels, self._panels.viewport.picture.widget
        if pointer is None or self._dialogs.name or panels.start.shown or not holds(view, *pointer):
            return None
        if panels.over_view(*pointer):
            return None
        return (pointer[0] - view.frame.x) / view.frame.width, (pointer[1] - view.frame.y) / view.frame.height

    def _pointed(self, kind: Kind, button: int, x: int, y: int) -> bool:
        """Whether the toolkit is to see that the pointer is moved or a button is pressed at a position."""
        if self._dialogs.name:
            self._menu_bar.closed()
            return True
        if kind == Kind.PRESS and button == 1:
            settings = self._settings
            self._panels.hints.press(x, y, (*self._panels.controls.lists, *settings.lists))
            settings.press(x, y)
        if kind == Kind.MOVE:
            self._menu_bar.move(x, y)
        return kind == Kind.MOVE or button != 1 or self._menu_bar.press(x, y)

    def item_chosen(self, item: Item[Actions]) -> None:
        """An item of a menu was chosen, which closes the menu. It acts before the next tick or key: the toolkit reports
        it while it draws, and a dialog that opens then would be below its shade, which the next frame has first."""
        self._menu_bar.closed()
        LOOP.post(partial(self._actions.act, item))
        self._changed()

    @property
    def covered(self) -> bool:
        """Whether a dialog, a menu or a list is open, as far as is known."""
        open_menu = self._panels.camera_menu.camera or self._menu_bar.opened
        return bool(self._dialogs.name or open_menu or self._panels.hints.listing)
