"""The worst evaluated frames, each compared with the footage of its camera."""

from collections.abc import Callable

import numpy as np

from v3studio.gui.drawing.compare import ALONE
from v3studio.gui.figures import QualityFigures
from v3studio.gui.models.evaluation import WorstFrame
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.thumbnails import Thumbnails
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.worst import WorstDialog


class WorstActions:
    """Shows the worst frames in a dialog; choosing one shows it. `look_through`: shows the performer from a camera."""

    def __init__(
        self, player: PlayerPresenter, quality: QualityFigures, thumbnails: Thumbnails, dialogs: Dialogs,
        look_through: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._player, self.quality, self._thumbnails = player, quality, thumbnails
        self._look_through = look_through
        self._dialog = WorstDialog(dialogs, self._show_frame, self._picture)
        thumbnails.changed.connect(self._dialog.update)

    def show(self) -> None:
        self._dialog.show(self.quality.evaluation, self._player.transport.number)

    def _show_frame(self, worst: WorstFrame) -> None:
        player = self._player
        self._look_through(worst.camera)
        if player.mode in ALONE:
            player.choose_mode("side by side")
        player.transport.pause()
        player.transport.seek(worst.frame)

    def _picture(self, worst: WorstFrame, size: tuple[int, int]) -> np.ndarray | None:
        player = self._player
        if player.opened is None or player.opened.rig is None or worst.camera not in player.camera_names:
            return None
        camera = player.opened.rig[worst.camera].undistorted()
        view = ImageZoom.around(player.points, camera, *size).camera(camera, *size)
        return self._thumbnails.get(player.opened.path, player.contents, view, worst.frame, size)
