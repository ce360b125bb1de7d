"""When the window looks at everything, and when it is drawn."""

import time

from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.platform.input_order import InputOrder
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

AGAIN_SECONDS = (0.05, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Seconds after a change at which the window is drawn again. Open3D drops a frame while the last one is still being
drawn, which takes seconds where a busy CPU draws a large window, so that its last change might never be seen."""


class Pace:
    """Decides at each tick what is worth its time. `software`: whether the CPU draws the window."""

    def __init__(
        self, software: bool, keys: InputOrder, player: PlayerPresenter, workspace: Workspace, dialogs: Dialogs
    ) -> None:
        self._software, self._input = software, keys
        self._player, self._workspace, self._dialogs = player, workspace, dialogs
        self._awake_until = self._next_look = self._last_input = 0.0
        self._pause = 0.0  # least seconds between two draws: if the CPU draws the window, they compete with rendering
        self._draws: list[float] = []  # when to draw
        self._last_draw = -float("inf")

    def changed(self) -> None:
        """Note that something on screen may have changed."""
        now = time.monotonic()
        # a due draw stays due; otherwise steady changes would postpone it forever
        self._draws = [min([now, *self._draws[:1]]), *(now + delay for delay in AGAIN_SECONDS)]
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
        return time.monotonic() < self._last_draw + self._pause

    def due(self, settled: bool, pausing: bool) -> bool:
        """Whether to draw the window now. Call at each tick. `settled`: whether no image is awaited. `pausing`: as it
        was when the panels were updated: everything that is drawn together is updated together."""
        playing = self._player.transport.playing
        if playing or not settled or self._workspace.opening:  # the next image is shown as soon as it is there
            self.stay_awake()
        if self._software:
            self._pause = LONGER_PAUSE if self._player.behind else SOFTWARE_PAUSE
            unwatched = self._input.active and time.monotonic() > self._last_input + ATTENTION
            if self._workspace.busy and not playing and unwatched:
                self._pause = JOB_PAUSE
            if self._dialogs.focusing:
                self._pause = 0.0
        if pausing or self.pausing:
            return False
        now = time.monotonic()
        waiting = [draw for draw in self._draws if draw > now]
        due = len(waiting) < len(self._draws)
        self._draws = waiting
        if due:
            self._last_draw = now
        return due
