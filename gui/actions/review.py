"""The choice of what the view shows."""

from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.swap_guard import SwapGuard


class ReviewActions:
    """Chooses images, comparisons and spans. `guard`: refuses clicks that came late."""

    def __init__(self, player: PlayerPresenter, views: StageViews, notices: Notices, guard: SwapGuard) -> None:
        self._player, self._views, self._notices, self._guard = player, views, notices, guard

    def press(self, row: str, key: str) -> None:
        """Press a button of a row above the view."""
        if row == self._views.row and not self._guard.refuses():
            self._views.choose(key)

    def choose(self, choice: str) -> None:
        """Show a comparison in Review, or leave it if it is on screen."""
        came = self._views.stage != "review"
        self._views.select("review")
        if not (came and choice == self._player.mode):  # from elsewhere a key shows a comparison, never turns it off
            self._views.choose(choice)

    def exchange(self) -> None:
        """Switch between the stream and what it is compared with."""
        self._views.select("review")
        self._views.leave()
        self._player.exchange()

    def step_span(self) -> None:
        """Begin, end or clear the span of frames that is played."""
        if self._player.opened is not None:
            self._notices.show(self._player.transport.step_span())
