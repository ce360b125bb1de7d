"""The start page: when it is on screen, and what its parts do."""

from collections.abc import Callable
from pathlib import Path

from v3studio.gui.layout import Layout
from v3studio.gui.models.loop import LOOP
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.preferences import Preferences
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.start.cards import CardKind
from v3studio.gui.pages.start.panel import StartPanel
from v3studio.pipelines.new_take import make_sample_take

LOOK_EVERY = 0.25  # seconds between two looks at the files of the page
DRAWS = 3  # of the panels before a dialog opens over them; the toolkit may drop one


class StartScreen:
    """Shows the start page while nothing is open, and over the open take or stream if it is asked for; does what its
    parts stand for. `open_place`: opens a path or URL; `command`: does what an item of the menus stands for."""

    def __init__(
        self, panel: StartPanel, layout: Layout, player: PlayerPresenter, workspace: Workspace,
        preferences: Preferences, notices: Notices, open_place: Callable[[str], None],
        command: Callable[[str], object], changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self._panel, self._layout, self._player, self._workspace = panel, layout, player, workspace
        self._preferences, self._notices, self._page = preferences, notices, panel.page
        self._open, self._command, self._changed = open_place, command, changed
        self._page.changed.connect(changed)
        self._asked = False
        self._next: tuple[int, Callable[[], object]] | None = None  # draws to wait for, and what is then done
        self._timer = LOOP.every(LOOK_EVERY, self._look)

    @property
    def shown(self) -> bool:
        return self._panel.shown

    def update(self) -> None:
        """Show the page if it is asked for or nothing is open, else hide it."""
        wanted = self._asked or (self._player.opened is None and not self._workspace.opening)
        if self._panel.shown != wanted:
            self._layout.set_start(wanted)
        self._timer.soon()
        self._changed()

    def _look(self) -> None:
        opened = self._player.opened
        if self._panel.shown:
            self._page.back = opened.title if opened is not None else ""
            self._page.look(self._preferences.recent)

    def show(self) -> None:
        """Show the page over the open take or stream."""
        self._player.transport.pause()
        self._asked = True
        self.update()

    def hide(self) -> bool:
        """Show the open take or stream again; returns whether the page was over it."""
        was_shown, self._asked = self._asked and self._player.opened is not None, False
        self.update()
        return was_shown

    def leave_for(self, action: Callable[[], object]) -> bool:
        """Show the open take or stream again, and act once it is drawn: the toolkit would put what appears with it over
        a dialog that opens with it. Returns whether the page was over it."""
        left = self.hide()
        self._next = (DRAWS, action) if left else None
        return left

    def drawn(self) -> bool:
        """Note that the window is drawn; returns whether it is to be drawn again."""
        if self._next is None:
            return False
        (left, action), self._next = self._next, None
        if left:
            self._next = left - 1, action
        else:
            action()
        return True

    def toggle(self) -> None:
        """Show the page, or the open take or stream."""
        if not self.hide():
            self.show()

    def act(self, name: str) -> None:
        """Do what a part of the page stands for, see `StartImage`."""
        kind, _, number = name.partition(" ")
        actions: dict[str, Callable[[], object]] = {
            "back": self.hide,
            "card": lambda: self._open_card(int(number)),
            "remove": lambda: self._keep(lambda place: place not in self._page.places[int(number) :][:1]),
            "forget": lambda: self._keep(lambda place: "://" in place or Path(place).exists()),
            "start": self._page.queue.start,
            "stop": self._page.queue.stop,
            "sample": self._open_sample,
        }
        actions.get(kind, lambda: self._command(kind))()
        self._timer.soon()

    def _keep(self, wanted: Callable[[str], bool]) -> None:
        """Keep the cards of the places that are wanted."""
        self._preferences.keep(recent=list(filter(wanted, self._preferences.recent)))

    def _open_card(self, number: int) -> None:
        if number >= len(self._page.places):
            return
        place = self._page.places[number]
        card = self._page.cards.get(place)
        if card is not None and card.kind == CardKind.MISSING:
            words = f"{place}: no such folder. It was moved, deleted, or is on a disk that is not connected."
            self._notices.show(words, bad=True, topic="open")
        else:
            self._open(place)

    def _open_sample(self) -> None:
        """Open the take of the sample capture, which is created first if need be."""
        with self._notices.reporting("open"):
            take, new = make_sample_take()
            self._open(str(take))
            if new:
                self._notices.show(f"Created a take of the sample capture: {take}", path=take, topic="sample")
