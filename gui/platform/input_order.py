"""Input events in an order in which the toolkit sees them all.

Open3D's widgets, menus and text fields look at the mouse and the keys only when the window is drawn. What is pressed
and released between two draws is lost, and a key that is pressed right after a click is handled before what the click
opens. So an invisible child window takes the events of mouse and keyboard and passes them on, with requests to draw
between those that must not fall on one draw. Without X, or with V3STUDIO_PLAIN_INPUT=1 in the environment, the
toolkit's window gets its events as ever.
"""

import ctypes
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from v3studio.gui.platform.presses import KeyReports, Press
from v3studio.gui.platform.x_window import BUTTONS
from v3studio.gui.platform.xlib import ESCAPE, EXPOSE, EXPOSURE_MASK, Connection, InputEvent, errors_ignored


class Kind(Enum):
    """Kinds of events: of mouse buttons, keys and the pointer."""

    PRESS = "press"
    RELEASE = "release"
    KEY = "key"
    KEY_UP = "key up"
    MOVE = "move"


PLAIN = "V3STUDIO_PLAIN_INPUT"  # environment variable that turns this off if it is 1
LAG = 4  # ticks after which an event has surely been drawn, if drawing did not take longer
LONGEST_HOLD = 20.0  # seconds for which input is kept back at most, should a dialog never be ready
_WHEEL = range(4, 8)
_NAMED = range(0xFF00, 0x10000)
"""Key symbols that type no character: the toolkit polls these, while it has a queue for characters."""

_KINDS: dict[int, tuple[Kind, int]] = {
    2: (Kind.KEY, 1 << 0), 3: (Kind.KEY_UP, 1 << 1), 4: (Kind.PRESS, 1 << 2), 5: (Kind.RELEASE, 1 << 3),
    6: (Kind.MOVE, 1 << 6),
}  # fmt: skip
"""Kind and mask by the type of an X event."""

_INPUT_ONLY, _LARGEST = 2, 32767
_SHIFT, _CONTROL = 1 << 0, 1 << 2


@dataclass(frozen=True)
class Input:
    """An event of the mouse or the keyboard."""

    kind: Kind
    code: int  # the button, or the key's code; 0 for a move
    typed: bool  # whether the key only types a character
    repeated: bool  # whether the key was down already
    raw: InputEvent


class Order:
    """Decides where the window must be drawn between events.

    Pressing and releasing must fall on different draws, and so must a click and the keys after it. A move while a
    button is pressed ends the press for the toolkit, too. Of the characters and the keys that edit in one draw, it
    handles the characters first.
    """

    def __init__(self) -> None:
        self._tick = 0
        self._unseen: dict[str, int] = {}  # what may not have been drawn since, by tick

    def tick(self) -> None:
        """Note that the window has ticked: what was passed on some ticks ago has been drawn."""
        self._tick += 1
        self._unseen = {name: tick for name, tick in self._unseen.items() if tick > self._tick - LAG}

    def ordered(self, events: Sequence[Input]) -> Iterator[Input | None]:
        """The events, and None where the window must be drawn. Of moves in a row, only the last is kept."""
        for number, event in enumerate(events):
            if event.kind == Kind.MOVE and number + 1 < len(events) and events[number + 1].kind == Kind.MOVE:
                continue
            for _ in range(self._draws_before(event)):
                self._unseen.clear()
                yield None
            if event.kind in (Kind.PRESS, Kind.RELEASE, Kind.KEY) and not self._is_wheel(event):
                self._unseen[self._name(event)] = self._tick
            yield event

    def _draws_before(self, event: Input) -> int:
        unseen = self._unseen
        if self._is_wheel(event):
            return 0
        if event.kind in (Kind.MOVE, Kind.RELEASE):
            return int("press" in unseen)
        if event.kind == Kind.PRESS:
            return int(bool(unseen))
        if event.kind == Kind.KEY_UP:
            return int(f"key {event.code}" in unseen)
        if "press" in unseen or "release" in unseen:
            return 2  # a text field takes keys from the second draw after a click on
        named = any(name.startswith("key ") for name in unseen)
        return int(named if event.typed else named or "typed" in unseen)

    @staticmethod
    def _is_wheel(event: Input) -> bool:
        return event.kind in (Kind.PRESS, Kind.RELEASE) and event.code in _WHEEL

    @staticmethod
    def _name(event: Input) -> str:
        if event.kind == Kind.KEY:
            return "typed" if event.typed else f"key {event.code}"
        return str(event.kind.value)


class InputOrder(Connection):
    """Passes input events on. Call `poll` at each tick. `window`: the X window of the toolkit; None for none, and then
    nothing has an effect. The child window goes with `close`."""

    def __init__(self, window: int | None) -> None:
        super().__init__(window is not None and os.environ.get(PLAIN) != "1")
        self._order = Order()
        self._kept: list[Input] = []
        self._held_since: float | None = None
        # newest position in the window, pixels; None if no event has come through here
        self.pointer: tuple[int, int] | None = None
        self.buttons = 0  # the mouse buttons that are pressed, a bit for each, as `XDisplay.buttons`
        # called with kind, button and position of each move and press before it is passed on; whether it is to be
        self.wanted: Callable[[Kind, int, int, int], bool] = lambda _kind, _button, _x, _y: True
        self.reports = KeyReports()  # the presses of keys that have come through here
        # called with the code of each key whose press is passed on, also of those that repeat
        self.pressed: Callable[[int], object] = lambda _code: None
        self._dropped: set[int] = set()
        self._down: set[int] = set()  # keys
        self._typing = False  # keys were pressed since `came_to_rest`
        self._stale: set[int] = set()  # keys that were down when input was held back: what they repeat is for nobody
        x = self._x
        if not self._display:
            return
        self._window = window
        # larger than any screen: it need not follow the size of its parent, which clips it
        child = x.XCreateWindow(self._display, window, 0, 0, _LARGEST, _LARGEST, 0, 0, _INPUT_ONLY, None, 0, None)
        x.XSelectInput(self._display, child, sum(mask for _, mask in _KINDS.values()))
        x.XkbSetDetectableAutoRepeat(self._display, 1, None)  # as the toolkit: a key that is held is not released
        x.XMapRaised(self._display, child)
        x.XSync(self._display, 0)

    @property
    def active(self) -> bool:
        """Whether events pass through here."""
        return bool(self._display)

    def came_to_rest(self) -> bool:
        """Whether all keys that came through here are up, and the toolkit has had time to report the last press and
        its release; True once after each series of presses."""
        rests = self._typing and not self._down and not self._kept and self.reports.settled
        self._typing = self._typing and not rests
        return rests

    def poll(self, hold: bool, release: bool = False) -> set[Kind]:
        """Pass on the events that have come; returns the kinds that there were. `hold`: keep them back: what they are
        for is about to open. `release`: pass on the releases of keys that were pressed before, even so: it opens when
        they are released."""
        self.reports.tick()
        if not self._display:
            return set()
        self._order.tick()
        if hold:
            self._stale |= self._down
        self._kept += filter(self._is_meant, self._read())
        if not hold:
            self._held_since = None
        elif self._held_since is None:
            self._held_since = time.monotonic()
        held = self._held_since is not None and time.monotonic() < self._held_since + LONGEST_HOLD
        events, self._kept = (self._of_earlier() if release else [], self._kept) if held else (self._kept, [])
        if not events:
            return set()
        with errors_ignored(self._x, self._display):  # the window may be closed by now
            for event in self._order.ordered([event for event in events if self._is_wanted(event)]):
                self._send(event)
                self._note(event)
        return {event.kind for event in events}

    def _note(self, event: Input | None) -> None:
        """Note a key that was passed on."""
        if event is None:
            return
        if event.kind == Kind.KEY:
            self.pressed(event.code)
            self._typing = True
            control, shift = bool(event.raw.state & _CONTROL), bool(event.raw.state & _SHIFT)
            self.reports.press(Press(event.code, event.repeated, control, shift))
        elif event.kind == Kind.KEY_UP and event.code == ESCAPE:
            self.reports.escape_released()

    def _of_earlier(self) -> list[Input]:
        """Take out of what is kept the releases whose presses are not in it."""
        pressed: set[int] = set()
        releases: list[Input] = []
        kept: list[Input] = []
        for event in self._kept:
            if event.kind == Kind.KEY:
                pressed.add(event.code)
            is_earlier = event.kind == Kind.KEY_UP and event.code not in pressed
            (releases if is_earlier else kept).append(event)
        self._kept = kept
        return releases

    def _read(self) -> Iterator[Input]:
        while self._x.XPending(self._display):
            event = InputEvent()
            self._x.XNextEvent(self._display, ctypes.byref(event))
            if event.type not in _KINDS:
                continue
            kind = _KINDS[event.type][0]
            typed = repeated = False
            if kind == Kind.KEY:
                repeated = event.code in self._down
                typed = self._x.XLookupKeysym(ctypes.byref(event), 0) not in _NAMED and not event.state & _CONTROL
            yield Input(kind, 0 if kind == Kind.MOVE else event.code, typed, repeated, event)

    def _is_meant(self, event: Input) -> bool:
        """False for repeats of a key that was down when a dialog began to open, such as the one that opened it."""
        if event.kind == Kind.KEY_UP:
            self._down.discard(event.code)
            self._stale.discard(event.code)
        elif event.kind == Kind.KEY:
            self._down.add(event.code)
            return event.code not in self._stale
        return True

    def _is_wanted(self, event: Input) -> bool:
        if event.kind in (Kind.MOVE, Kind.PRESS, Kind.RELEASE):
            self.pointer = event.raw.x, event.raw.y
            self._note_buttons(event)
        if event.kind == Kind.RELEASE and event.code in self._dropped:
            self._dropped.discard(event.code)
            return False
        pointed = event.kind in (Kind.MOVE, Kind.PRESS)
        if pointed and not self.wanted(event.kind, event.code, event.raw.x, event.raw.y):
            self._dropped.add(event.code)
            return False
        return True

    def _note_buttons(self, event: Input) -> None:
        bit = 1 << event.code + 7 if event.code in (1, 2, 3) else 0  # Button1Mask and so on; a move has no code
        before = event.raw.state & BUTTONS
        self.buttons = before & ~bit if event.kind == Kind.RELEASE else before | bit

    def _send(self, passed: Input | None) -> None:
        """Pass an event on to the toolkit; None for a request to draw."""
        if passed is None:
            event, mask = InputEvent(type=EXPOSE), EXPOSURE_MASK
        else:
            event, mask = passed.raw, _KINDS[passed.raw.type][1]
            event.subwindow = 0
        event.window, event.display = self._window, self._display
        self._x.XSendEvent(self._display, self._window, 0, mask, ctypes.byref(event))
