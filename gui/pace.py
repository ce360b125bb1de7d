"""When the window looks at everything, and when it is drawn."""

import time

from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.platform.input_order import InputOrder
from v3studio.gui.platform.redraw import Redraws
from v3studio.gui.widgets.dialogs.base import Dialogs

AWAKE = 0.5
"""Seconds after an event, or while an image is awaited, in which the window checks everything at each tick (10 ms)."""

REST = 0.05  # seconds between two looks at everything while nothing happens

SOFTWARE_PAUSE, LONGER_PAUSE = 1 / 10, 1 / 5
"""Minimum seconds between two draws of the window if the CPU draws it, which takes 90 ms of a core: leaves time to
render frames. The longer one applies while rendering falls behind playback."""

JOB_PAUSE, ATTENTION = 1 / 2, 2.0
"""Minimum seconds between two draws while a job runs, which needs the CPU more, and seconds after the last touch from
which this applies."""


class Pace:
    """Decides at each tick what is worth its time. `software`: whether the CPU draws the window."""

    def __init__(
        self, software: bool, keys: InputOrder, player: PlayerPresenter, workspace: Workspace, dialogs: Dialogs
    ) -> None:
        self._software, self._input = software, keys
        self._player, self._workspace, self._dialogs = player, workspace, dialogs
        self._redraws = Redraws()
        self._awake_until = self._next_look = self._last_input = 0.0

    def changed(self) -> None:
        """Note that something on screen may have changed."""
        self._redraws.changed()
        self.stay_awake()

    def stay_awake(self) -> None:
        self._awake_until = time.monotonic() + AWAKE

    def touched(self) -> None:
        """Note that the user does something."""
        self._last_input = time.monotonic()
        self.stay_awake()

    def rests(self) -> bool:
        """Whether nothing happens, so that this tick can pass without a look at everything."""
        now = time.monotonic()
        if now < self._next_look and now >= self._awake_until:
            return True
        self._next_look = now + REST
        return False

    @property
    def pausing(self) -> bool:
        """Whether the window was drawn so recently that nothing that changes now is seen."""
        return self._redraws.pausing

    def due(self, settled: bool, pausing: bool) -> bool:
        """Whether to draw the window now. Call at each tick. `settled`: whether no image is awaited. `pausing`: as it
        was when the panels were updated: everything that is drawn together is updated together."""
        playing = self._player.transport.playing
        if playing or not settled or self._workspace.opening:  # the next image is shown as soon as it is there
            self.stay_awake()
        if self._software:
            self._redraws.pause = LONGER_PAUSE if self._player.behind else SOFTWARE_PAUSE
            unwatched = self._input.active and time.monotonic() > self._last_input + ATTENTION
            if self._workspace.busy and not playing and unwatched:
                self._redraws.pause = JOB_PAUSE
            if self._dialogs.focusing:
                self._redraws.pause = 0.0
        return not pausing and self._redraws.due()
