"""Modal dialogs: messages, questions, a text field, a list of choices."""

import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from open3d.visualization import gui

from v3studio.gui.drawing.palette import ACCENT_DARK, DIM
from v3studio.gui.models.loop import LOOP
from v3studio.gui.models.preferences import Preferences
from v3studio.gui.platform.fonts import TEXT_SIZE, TITLE_SIZE
from v3studio.gui.platform.keyboard import BACKSPACE, END, HOME, TAB, send_key, tap_key, type_keys
from v3studio.gui.platform.presses import typed_code
from v3studio.gui.widgets.picture import ImagePanel, color, make_button, make_label

TAB_DOWN, TAB_UP = 3, 5
"""Number of frames drawn of a dialog with a text field before Tab is pressed, and has surely had its effect."""

FRAMES_BEFORE_ENTER = 2  # number of frames drawn between the Enter key and its action
BUTTON_PADDING = 0.2  # room above and below the text of a button, em, besides the toolkit's
SHADE = 0.5  # how dark everything below a dialog becomes, 0 to 1

_MODIFIERS = (
    gui.KeyName.LEFT_CONTROL, gui.KeyName.RIGHT_CONTROL, gui.KeyName.ALT, gui.KeyName.META,
)  # fmt: skip

Answer = tuple[str, str, Callable[[], None]]  # key, label, action


class Dialogs:
    """Shows one dialog at a time over a window, which is darker meanwhile. `titles`: number of the font of titles."""

    def __init__(self, window: gui.Window, titles: int, preferences: Preferences) -> None:
        self._window, self._titles, self.preferences = window, titles, preferences
        self.lay_out = window.set_needs_layout  # lays out the open dialog again
        self.shade = gui.Vert()  # makes the window darker; to be its last child and as large as it
        self.shade.background_color = gui.Color(0.0, 0.0, 0.0, SHADE)
        self.shade.visible = False
        self.em = window.theme.font_size
        self.widgets: dict[str, gui.Widget] = {}  # of the open dialog by key
        self.made: dict[str, gui.Widget] = {}  # of the dialog that is being built
        # places in the images of the open dialog, 0 to 1 across and down, by the key of the image and by name
        self.parts: dict[str, Callable[[], dict[str, list[float]]]] = {}
        self.name = ""  # of the open dialog; "" if none is open
        self.typing = False  # whether its text field has the keyboard focus
        self.lines: list[str] = []  # what the list in it shows, where that changes on its own
        self.pictures: list[ImagePanel] = []  # in the open dialog; they are drawn exactly some draws later
        # handles keys once the text field has the focus, and returns whether it did
        self.on_key: Callable[[gui.KeyEvent], bool] | None = None
        # receives the X key codes of presses and repeats, which the text field keeps for itself, where they are known
        self.on_press: Callable[[int], object] | None = None
        self.expected = False  # whether a dialog with a text field is about to open; what is typed is kept for it
        self._drawn: int | None = None
        self._confirm: int | None = None  # frames to draw until the dialog is confirmed
        self._unseen: gui.Dialog | None = None
        self._field: gui.TextEdit | None = None
        self._before = ""
        self._early: list[tuple[int, bool]] = []  # keys pressed before the field had the focus
        self._early_enter = self._early_first = self._shift = False
        self._on_enter: Callable[[], None] | None = None
        # what the Escape key does: like Cancel or Close, if there is one
        self.on_escape: Callable[[], None] = self.close

    @property
    def room(self) -> int:
        """Largest width of the contents of a dialog, pixels: the toolkit makes none wider than 0.8 of the window."""
        return round(0.78 * self._window.content_rect.width - 2 * self.em)

    def fitting(self, wide: float, high: float, others: float) -> tuple[int, int]:
        """Pixels of a picture of so many em, less in a small window; `others`: height of the rest of the dialog, em."""
        most = max(0.8 * self._window.content_rect.height - others * self.em, 3 * self.em)
        return min(round(wide * self.em), self.room), round(min(high * self.em, most))

    def close(self) -> None:
        """Close the open dialog, if any."""
        self._on_enter = self._drawn = self._confirm = self._field = self._unseen = None
        self.typing = self._early_enter = False
        self._early = []
        if self.name:
            self._window.close_dialog()
        self.shade.visible = False
        self.widgets, self.parts, self.name, self.lines = {}, {}, "", []
        self.pictures, self.on_key, self.on_press = [], None, None
        self.expected = False

    def show(
        self,
        name: str,
        title: str,
        parts: Sequence[gui.Widget],
        answers: Sequence[Answer],
        width: float,
        on_enter: Callable[[], None] | None = None,
        accent: str | None = None,
    ) -> None:
        """Show a dialog made of `parts`, replacing the open one; `on_enter`: action of the Enter key; `accent`: key of
        the highlighted answer; None for the first."""
        early = (self._early, self._early_enter) if self.expected else ([], False)
        self.close()
        self._early, self._early_enter = early
        self._on_enter = on_enter
        self.on_escape = next((action for key, _, action in answers if key == "close"), self.close)
        em = self.em
        dialog = gui.Dialog(title)
        column = gui.Vert(0.6 * em, gui.Margins(em, em, em, em))
        # the widest line gives the dialog its width
        heading = gui.Label(title + " " * max(int(width * TEXT_SIZE / TITLE_SIZE - len(title)), 0))
        heading.font_id = self._titles
        column.add_child(heading)
        for part in parts:
            column.add_child(part)
        row = gui.Horiz(0.5 * em)
        row.add_stretch()
        accent = answers[0][0] if accent is None else accent
        for key, label, action in answers:
            row.add_child(self.button(key, label, action, accent=key == accent))
        column.add_child(row)
        dialog.add_child(column)
        self.widgets, self.made = self.made, {}
        self.name, self.shade.visible = name, True
        self._window.show_dialog(dialog)

    def button(self, key: str, label: str, action: Callable[[], None], accent: bool = False) -> gui.Button:
        """Make a button for the dialog being built."""
        button = self.made[key] = make_button(label, action, pad=0.5, pad_y=BUTTON_PADDING)
        if accent:
            button.background_color = color(ACCENT_DARK)
        return button

    def row(self, *buttons: Answer) -> gui.Horiz:
        """Make a row of buttons for the dialog being built."""
        row = gui.Horiz(0.4 * self.em)
        for button in buttons:
            row.add_child(self.button(*button))
        return row

    def list_of(self, rows: int, selected: Callable[[str, bool], None]) -> gui.ListView:
        """Make the list of the dialog being built. `selected`: called with the clicked line and whether twice."""
        made = self.made["list"] = gui.ListView()
        made.set_max_visible_items(rows)
        made.set_on_selection_changed(selected)
        return made

    def label(self, text: str, dim: bool = True) -> gui.Label:
        """Make a label for the dialog being built."""
        return make_label(text, DIM) if dim else gui.Label(text)

    def usual_folder(self, *others: Path) -> Path:
        """The folder in which a dialog for a path begins: the last, the first of `others` that exists, or home."""
        last = [Path(self.preferences.folder)] if self.preferences.folder else []
        return next((path for path in (*last, *others) if path.is_dir()), Path.home())

    def enter(self) -> None:
        """Handle the release of the Enter key (a field being edited consumes the press). Text typed just before reaches
        the field only when the window is drawn, so the dialog is confirmed a few frames later."""
        if self.focusing:
            self._early_enter = True
        elif self._on_enter is not None and self._confirm is None:
            self._confirm = FRAMES_BEFORE_ENTER

    def key(self, event: gui.KeyEvent) -> bool:
        """Keep a key pressed before the text field has the focus, to be typed then; returns whether it is handled."""
        down = event.type == gui.KeyEvent.Type.DOWN
        if event.key in (gui.KeyName.LEFT_SHIFT, gui.KeyName.RIGHT_SHIFT):
            self._shift = down
            return False
        if event.key in _MODIFIERS and not down:
            return False  # of Ctrl+K: the toolkit would think that it is still held, and take no text
        if not self.focusing:
            return self.on_key is not None and self.on_key(event)
        keycode = BACKSPACE if event.key == gui.KeyName.BACKSPACE else typed_code(event.key)
        if down and keycode is not None and not self._early_enter:
            self._early.append((keycode, self._shift))
        return True

    def tick(self) -> bool:
        """Focus a new dialog's text field once it has been drawn, and confirm the dialog after Enter. Call at each
        drawn tick. Returns whether the window must be drawn again."""
        unsettled = [picture.settle() for picture in self.pictures]
        if self._confirm is not None:
            self._confirm -= 1
            if self._confirm == 0:
                self._confirm = None
                if self._on_enter is not None:
                    self._on_enter()
            return True
        if self._drawn is None:
            return any(unsettled)
        self._drawn += 1
        if self._drawn == TAB_DOWN:
            tap_key(TAB)
        elif self._drawn > TAB_UP and not self._type_early(self._drawn - TAB_UP - 1):
            self._drawn = None
            self.typing = True
            if self._early_enter:
                self._early_enter = False
                self._confirm = FRAMES_BEFORE_ENTER
        return True

    def _type_early(self, step: int) -> bool:
        """Type the kept keys, in several draws; returns whether another one is needed. Keys that came after them may
        have reached the field already, as its focus comes between two draws: the kept ones belong before these."""
        if not self._early or self._field is None:
            return False
        if step == 0:
            self._early_first = self._field.text_value != self._before
        if self._early_first and step in (0, 2):
            send_key(HOME if step == 0 else END, True)
        if self._early_first and step in (1, 3):
            send_key(HOME if step == 1 else END, False)
        if step == 1:
            type_keys(self._early)
        return step < 3

    def close_menu(self) -> None:
        """Close the toolkit's menu, which knows no keys: it does so for a dialog. This one is nowhere on the screen."""
        self.name, self._unseen, self.on_escape = "menu", gui.Dialog(""), self.close
        self._window.show_dialog(self._unseen)
        self._window.set_needs_layout()

    def place(self, window: gui.Rect) -> None:
        """Lay out what is not left to the toolkit. It draws meanwhile."""
        self.shade.frame = window
        if self._unseen is not None:
            self._unseen.frame = gui.Rect(-99, -99, 1, 1)
            LOOP.post(self.close)

    def message(self, title: str, text: str) -> None:
        self.show("message", title, [self.label(text, dim=False)], [("close", "Close", self.close)], 60, self.close)

    def ask(self, title: str, text: str, answers: Sequence[Answer]) -> None:
        """Ask a question; each answer closes the dialog first."""
        closing = [(key, label, self.closing(action)) for key, label, action in answers]
        self.show("ask", title, [self.label(text, dim=False)], closing, 60)

    def line(
        self,
        name: str,
        title: str,
        text: str,
        value: str,
        *answers: tuple[str, str, Callable[[str], object]],
        cancel: Callable[[], None] = lambda: None,
    ) -> None:
        """Ask for a line of text; answers receive the text, and Enter triggers the first."""
        edit = gui.TextEdit()
        edit.text_value = value
        typed = [value]

        def changed(now: str) -> None:
            typed[0] = now

        edit.set_on_text_changed(changed)

        def answer(action: Callable[[str], object]) -> Callable[[], None]:
            return self.closing(lambda: action(typed[0]))

        parts: list[gui.Widget] = [self.label(text), edit, self.label("Enter to confirm.")]
        buttons: list[Answer] = [(key, label, answer(action)) for key, label, action in answers]
        buttons.append(("close", "Cancel", self.closing(cancel)))
        self.show(name, title, parts, buttons, 70, buttons[0][2])
        self.widgets["line"] = edit
        self.focus(edit)

    def focus(self, field: gui.TextEdit) -> None:
        """Give the first text field of the dialog the keyboard focus."""
        self._field, self._before, self._drawn = field, field.text_value, 0

    @property
    def focusing(self) -> bool:
        """Whether a text field is about to get the keyboard focus, for which the window must be drawn often."""
        return self._drawn is not None or self.expected or self._unseen is not None

    def expect(self) -> None:
        """A dialog with a text field is about to open. No effect while one is open."""
        if not self.name:
            self.expected, self._early, self._early_enter = True, [], False
            self.on_escape = self.close

    def pressed(self, code: int) -> None:
        """Note that a key was pressed or repeats, by its X key code."""
        if self.on_press is not None and not self.focusing:
            self.on_press(code)

    def choose(
        self,
        name: str,
        title: str,
        choices: Sequence[str],
        chosen: Callable[[str], object],
        answers: Sequence[tuple[str, str, Callable[[], object]]] = (),
        nothing: str = "The list is empty.",
        note: str = "",
    ) -> None:
        """Choose from a list (`nothing` is shown for an empty one) with a note below it; answers are before Close."""
        parts: list[gui.Widget] = []
        for number, choice in enumerate(choices):
            parts.append(self.button(f"choice{number}", choice, self.closing(partial(chosen, choice))))
        if not choices:
            parts.append(self.label(nothing))
        if note:
            parts.append(self.label(note))
        row: list[Answer] = [(key, label, self.closing(action)) for key, label, action in answers]
        row.append(("close", "Close", self.close))
        self.show(name, title, parts, row, 60, accent="close")

    def closing(self, action: Callable[[], object]) -> Callable[[], None]:
        """An action that closes the dialog first."""

        def go() -> None:
            self.close()
            action()

        return go


def filled(lines: Sequence[str], count: int) -> list[str]:
    """Lines with blank ones after them, `count` at least: a dialog does not resize while what it shows changes."""
    return [*lines, *[" "] * (count - len(lines))]


def in_lines(text: str, count: int) -> str:
    """The text wrapped to the width of a dialog, in exactly so many lines."""
    return exactly(broken(text).splitlines(), count)


def exactly(lines: Sequence[str], count: int) -> str:
    """Exactly so many lines; dots at the end of the last one if there are more."""
    shown = lines if len(lines) <= count else [*lines[: count - 1], f"{lines[count - 1]} ..."]
    return "\n".join(filled(shown, count))


def broken(text: str) -> str:
    """Wrap text to the width of a dialog."""
    return "\n".join(line for part in text.splitlines() for line in textwrap.wrap(part, 84) or [""])
