"""The list of commands: what the mouse and the keys select and run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from open3d.visualization import gui

from gui.actions.menus import MENUS
from gui.platform.keyboard import DOWN, PAGE_DOWN, UP
from gui.widgets.command_list import ROWS, Command, row_height
from gui.widgets.dialogs import command as command_dialog
from gui.widgets.dialogs.command import CommandDialog
from gui.widgets.picture import PictureWidget

COMMANDS = [Command.of(key, title, label) for title, items in MENUS for key, label in items if key]
EM = 16.0


class Host:
    """What the list needs of `gui.widgets.dialogs.base.Dialogs`."""

    em, room, focusing = EM, 600, False

    def __init__(self) -> None:
        self.name, self.laid = "", 0
        self.lines: list[str] = []
        self.widgets: dict[str, Any] = {}
        self.pictures: list[PictureWidget] = []

    def show(self, name: str, *_: object) -> None:
        self.name = name

    def close(self) -> None:
        self.name = ""

    def label(self, text: str) -> gui.Label:
        return gui.Label(text)

    def focus(self, _field: object) -> None:
        pass

    def laid_out(self) -> None:
        self.laid += 1


@pytest.fixture
def host() -> Host:
    return Host()


@pytest.fixture
def ran() -> list[str]:
    return []


@pytest.fixture
def shown(host: Host, ran: list[str]) -> CommandDialog:
    dialog = CommandDialog(host, ran.append)  # type: ignore[arg-type]
    dialog.show(COMMANDS)
    return dialog


def mouse(dialog: CommandDialog, kind: str, row: float, wheel: float = 0.0) -> None:
    event: Any = SimpleNamespace(type=getattr(gui.MouseEvent.Type, kind), wheel_dy=wheel)
    dialog._on_mouse(event, 10.0, (row + 0.5) * row_height(EM))


def release(dialog: CommandDialog, key: gui.KeyName) -> None:
    event: Any = SimpleNamespace(type=gui.KeyEvent.Type.UP, key=key)
    assert dialog._key(event)


@pytest.mark.parametrize("scrolled", [0, 9, len(COMMANDS) - ROWS])
@pytest.mark.parametrize("row", range(ROWS))
def test_a_click_runs_the_command_under_the_pointer(
    shown: CommandDialog, ran: list[str], row: int, scrolled: int
) -> None:
    if scrolled:
        mouse(shown, "WHEEL", 0, -(scrolled + ROWS - 1))
    mouse(shown, "BUTTON_DOWN", row)
    shown.tick()
    assert not ran, "a press only selects"
    mouse(shown, "BUTTON_UP", row)
    assert ran == [COMMANDS[scrolled + row].key]


def test_a_release_on_another_row_runs_nothing(shown: CommandDialog, ran: list[str]) -> None:
    mouse(shown, "BUTTON_DOWN", 3)
    mouse(shown, "BUTTON_UP", 4)
    mouse(shown, "BUTTON_UP", 4)
    assert not ran


def test_a_held_key_moves_on_and_its_release_does_not(shown: CommandDialog) -> None:
    for _ in range(5):
        shown._press(DOWN)
    release(shown, gui.KeyName.DOWN)
    assert shown._list.at == 5
    shown._press(UP)
    release(shown, gui.KeyName.UP)
    assert shown._list.at == 4
    shown._press(PAGE_DOWN)
    assert shown._list.at == 4 + ROWS


def test_where_presses_are_not_told_releases_count(shown: CommandDialog) -> None:
    release(shown, gui.KeyName.DOWN)
    release(shown, gui.KeyName.DOWN)
    assert shown._list.at == 2


def test_further_openings_make_no_images(shown: CommandDialog, host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[object] = []
    image = gui.UIImage

    def make(*arguments: Any) -> gui.UIImage:
        made.append(arguments)
        return image(*arguments)

    make.Scaling = image.Scaling  # type: ignore[attr-defined]
    monkeypatch.setattr(command_dialog.gui, "UIImage", make)
    for _ in range(3):
        host.close()
        shown.tick()
        shown.show(COMMANDS)
    assert not made
    host.room -= 50  # another window size
    host.close()
    shown.show(COMMANDS)
    assert len(made) == 1


def test_a_click_outside_closes_it(shown: CommandDialog, host: Host) -> None:
    frames = {"line": (304, 197, 672, 22), "list": (304, 229, 672, 312), "run": (858, 583, 46, 28)}
    host.widgets = {**host.widgets, "run": gui.Button("Run")}
    for name, frame in frames.items():
        host.widgets[name].frame = gui.Rect(*frame)
    for x, y in ((500, 300), (500, 160), (310, 600), (298, 400), (980, 600)):
        assert not shown.press(1, x, y)
    assert not shown.press(4, 100, 100), "the wheel"
    assert host.name
    for x, y in ((500, 130), (270, 400), (1010, 400), (500, 650)):
        assert shown.press(1, x, y)
        assert not host.name
        assert not shown.press(1, x, y), "another dialog may be open"
        host.name = command_dialog.NAME


def test_it_says_how_many_more_there_are(shown: CommandDialog) -> None:
    rest = len(COMMANDS) - ROWS
    assert shown._hint.text.startswith(f"{rest} more below. ")
    mouse(shown, "WHEEL", 0, -(ROWS + 1))
    shown.tick()
    assert shown._hint.text.startswith(f"2 more above and {rest - 2} below. ")
    shown._type("html rep")
    shown.tick()
    assert "more" not in shown._hint.text


def test_it_asks_to_be_laid_out_each_time(shown: CommandDialog, host: Host) -> None:
    shown.show(COMMANDS)
    assert host.laid == 2
