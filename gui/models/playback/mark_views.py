"""Views of marks: what is on screen when a frame is marked, and the way back to it; browsers keep the same."""

from __future__ import annotations

import math

import numpy as np

from gui.models.playback.image_zoom import ImageZoom
from gui.models.playback.player import PlayerPresenter
from gui.models.scene.orbit import OrbitCamera
from pipelines.takes.marks import MarkView


def view_of(player: PlayerPresenter) -> MarkView:
    """The view and the comparison on screen."""
    orbit = player.orbit
    eye, target = ((float(x), float(y), float(z)) for x, y, z in (orbit.eye, orbit.target))
    return MarkView(
        eye=eye,
        target=target,
        fov=math.degrees(orbit.fov),
        camera=player.camera,
        wipe=player.wipe if player.camera and player.mode == "wipe" else None,
        whole=player.image_zoom == ImageZoom(),
    )


def show_view(player: PlayerPresenter, view: MarkView) -> None:
    """Show what a mark was made of, as far as it is there: without the take's cameras, the view from the same place."""
    player.message = ""
    if view.camera not in player.camera_names:
        player.look_through("")
        up = player.orbit.up
        player.orbit = OrbitCamera.from_to(np.array(view.eye), np.array(view.target), up, math.radians(view.fov))
        return
    player.look_through(view.camera)
    if view.wipe is None:
        player.choose_mode("single")
    elif player.choose_mode("wipe"):
        player.wipe = view.wipe
    if view.whole == (player.image_zoom != ImageZoom()):
        player.zoom_to_performer()
