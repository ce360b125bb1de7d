"""Keys, mouse and menus of the window: what comes from the user, and what it does."""

from functools import partial

from open3d.visualization import gui

from v3studio.gui.actions.commands import Actions
from v3studio.gui.actions.menus import Item
from v3studio.gui.actions.search import opens_list
from v3studio.gui.models.loop import LOOP
from v3studio.gui.platform.menu_bar import MenuBar
from v3studio.gui.platform.presses import key_code, typed_code
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.picture import holds


class UserInput:
    """See the module. `menu_bar`: follows the mouse."""

    def __init__(self, window: Shell, actions: Actions, menu_bar: MenuBar) -> None:
        self._window, self._actions, self._menu_bar = window, actions, menu_bar
        self.buttons = 0
        self._pointer: tuple[int, int] | None = None
        window.input.wanted = self._pointed

    def tick(self) -> bool:
        """Pass events on to the toolkit. Call at each tick; returns whether there were any."""
        window = self._window
        window.input.reports.dialog = bool(window.dialogs.name)
        came = window.input.poll(hold=window.dialogs.focusing, release=window.dialogs.expected)
        if window.input.came_to_rest():
            window.chords.release_all()
            self._actions.search.show_expected()
        if came - {"move", "key up"}:  # a frame that the toolkit drops would hide what they did
            window.changed()
        window.input.reports.dialog = bool(window.dialogs.name)  # what came may have closed it
        if window.input.reports.escape_kept():  # by a text field, which only restores its text
            self._escape()
        self._watch_mouse()
        return bool(came)

    def on_key(self, event: gui.KeyEvent) -> bool:
        """Handle a key event of the toolkit; returns whether it is not to be handled further."""
        window, dialogs = self._window, self._window.dialogs
        LOOP.run()  # what is typed is for what a chosen item opens
        is_new, press = True, None
        if event.type == gui.KeyEvent.Type.DOWN:
            is_new, press = window.input.reports.reported(key_code(event.key))
        modifier = window.chords.note(event, press)
        if modifier and event.type == gui.KeyEvent.Type.UP:
            self._actions.search.show_expected()
        if event.key == gui.KeyName.ESCAPE:
            window.close_requests.escape()
            if event.type == gui.KeyEvent.Type.DOWN and is_new and not window.chords.again:
                self._escape()
            return True
        if event.key == gui.KeyName.ENTER and (dialogs.name or dialogs.expected):
            if event.type == gui.KeyEvent.Type.UP:
                dialogs.enter()
                window.changed()
            return True
        if not is_new:
            return True
        if dialogs.focusing and window.chords.again:
            return True  # the key that opened the dialog, still held
        if dialogs.key(event):
            return True
        if modifier or event.type != gui.KeyEvent.Type.DOWN or dialogs.name:
            return False
        settings = window.stages.settings[window.stages.selected]
        if event.key == gui.KeyName.ENTER:
            settings.edited = False
        if settings.edited and not window.chords.control and typed_code(event.key) is not None:
            return True  # for a field that has lost the focus
        return self._act(event)

    def _act(self, event: gui.KeyEvent) -> bool:
        """Do what a pressed key stands for; returns whether it stands for something."""
        chords = self._window.chords
        if not self._over_panels(event):
            if chords.control:
                action = None if chords.again else self._actions.for_chord(event, chords.shift)
            else:
                action = self._actions.for_key(event, chords.again)
            if action is None:
                return False
            action()
        self._window.changed()
        return True

    def _over_panels(self, event: gui.KeyEvent) -> bool:
        """Handle a key for the notice, the table in the view or the start page; returns whether it was for one."""
        window, chords, key = self._window, self._window.chords, gui.KeyName
        on_start, control, card = window.start.shown, chords.control, window.notices.card
        if chords.again and (control or event.key in (key.ENTER, key.BACKSPACE, key.DELETE, key.H)):
            return on_start or event.key == key.H
        if control and event.key == key.C and card is not None:
            window.notice_bar.copy()
        elif control and event.key == key.O and card is not None:
            window.notice_bar.open_folder()
        elif control and event.key == key.C and not on_start:
            return self._copy_table()
        elif not on_start or (control and opens_list(event, chords.shift)):
            return False
        elif control:
            if event.key == key.V:
                self._actions.start.paste()
        elif event.key in (key.H, key.Q, key.QUESTION_MARK, key.SLASH):
            return False
        else:
            window.start.key(event, chords.shift)
        return True

    def _copy_table(self) -> bool:
        """Copy the table in the view; returns whether there is one."""
        window, view = self._window, self._window.views.stage_view
        if view is None or not view.table_text:
            return False
        if window.notice_bar.copied(view.table_text):
            window.notices.show("Copied the table.")
        return True

    def _escape(self) -> None:
        window = self._window
        if window.dialogs.name or window.dialogs.expected:
            window.dialogs.on_escape()
        elif self._menu_bar.opened:
            self._menu_bar.closed()
            window.dialogs.close_menu()
        elif not (
            window.notices.dismiss()
            or (window.start.shown and self._actions.start.hide())
            or window.camera_menu.close()
            or window.layout.close_log()
            or window.views.leave_camera()
            or window.views.leave()
            or window.player.transport.clear_span()
        ):
            window.layout.set_fullscreen(False)
        window.changed()

    def item_chosen(self, item: Item[Actions]) -> None:
        """An item of a menu was chosen, which closes the menu. It acts before the next tick or key: the toolkit reports
        it while it draws, and a dialog that opens then would be below its shade, which the next frame has first."""
        self._menu_bar.closed()
        LOOP.post(partial(self._actions.act, item))
        self._window.changed()

    def _watch_mouse(self) -> None:
        """Redraw when a mouse button is pressed or released: the toolkit reports no clicks on its menus and lists, and
        would show what they open only when the pointer moves."""
        window = self._window
        buttons = window.input.buttons if window.input.active else window.x.buttons
        if buttons != self.buttons:
            self.buttons = buttons
            window.changed()
        pointer, before = window.input.pointer, self._pointer
        self._pointer = pointer
        if pointer != before:
            self._actions.edits.moved()
            if pointer is not None and holds(window.stages.settings[window.stages.selected].widget, *pointer):
                window.changed()  # a tooltip has the size of the one before it until the second draw

    def _pointed(self, kind: str, button: int, x: int, y: int) -> bool:
        """Whether the toolkit is to see that the pointer is moved or a button is pressed at a position."""
        window = self._window
        self._menu_bar.height = window.window.content_rect.y
        if window.dialogs.name:
            self._menu_bar.closed()
            return True
        if kind == "press" and button == 1:
            settings = window.stages.settings[window.stages.selected]
            window.hints.press(x, y, (*window.controls.lists, *settings.lists))
            settings.press(x, y)
        if kind == "move":
            self._menu_bar.move(x, y)
        return kind == "move" or button != 1 or self._menu_bar.press(x, y)

    @property
    def covered(self) -> bool:
        """Whether a dialog or a menu is open, as far as is known."""
        return bool(self._window.dialogs.name or self._window.camera_menu.camera or self._menu_bar.opened)
