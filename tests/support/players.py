"""Players for tests."""

from gui.models.playback.player import PlayerPresenter
from tests.support.waiting import wait_until


def settle(player: PlayerPresenter, seconds: float = 120.0) -> None:
    """Poll until the newest picture shows the current frame."""

    def settled() -> bool:
        player.poll()
        return player.settled and player.poll() is None and player.settled

    wait_until("settled", settled, seconds)
