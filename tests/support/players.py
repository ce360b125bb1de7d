"""Pictures of players and views in tests."""

from collections.abc import Callable

import numpy as np

from tests.support.looping import wait_in_loop
from tests.support.waiting import wait_until
from v3studio.gui.models.playback.player import PlayerPresenter


def settle(player: PlayerPresenter, seconds: float = 120.0) -> None:
    """Poll until the newest picture shows the current frame."""

    def settled() -> bool:
        player.poll()
        return player.settled and player.poll() is None and player.settled

    wait_until("settled", settled, seconds)


def picture_of(player: PlayerPresenter) -> np.ndarray:
    """The newest picture, once it shows the current frame."""
    settle(player)
    assert player.picture is not None, player.message
    return player.picture.image


def newest(
    poll: Callable[[], np.ndarray | None],
    settled: Callable[[], bool],
    accept: Callable[[np.ndarray], bool] = lambda picture: True,
) -> np.ndarray:
    """The last picture that a view's `poll` returns until it is settled and the picture is accepted."""
    found: list[np.ndarray] = []

    def arrived() -> bool:
        done = settled()  # before the poll: or a picture may be finished just after it
        new = poll()
        found.extend([] if new is None else [new])
        return bool(found) and done and new is None and accept(found[-1])

    wait_in_loop("the picture", arrived)
    return found[-1]
