"""The strip of images above the timeline: which frames it shows, and where."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.palette import RAISED
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.thumbnails import Thumbnails
from v3studio.gui.models.playback.timeline import Timeline
from v3studio.studio.cameras import Camera
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.stream import is_address

Size = tuple[int, int]

ASPECT = 1.1  # width of an image divided by its height: room for arms and what is held


@dataclass(frozen=True)
class Slot:
    """A place in the strip: the frame, its left edge (may begin outside) and its width up to the next one, pixels."""

    frame: int
    x: float
    width: float


def slots(timeline: Timeline, width: int) -> list[Slot]:
    """Places for images `width` pixels wide that do not overlap, each beginning at its frame. The frames are
    multiples of a power of two, so that panning keeps them and zooming keeps half of them."""
    each = timeline.width / max(timeline.shown, 1e-9)
    step = 1
    while step * each < width:
        step *= 2
    begin = timeline.zoom.first
    first = max(math.floor(begin / step) * step, 0)
    last = min(math.ceil(begin + timeline.shown), timeline.frame_count)
    candidates = (Slot(frame, (frame - begin) * each, step * each) for frame in range(first, last, step))
    return [slot for slot in candidates if -slot.width < slot.x < timeline.width]


def draw_strip(timeline: Timeline, size: Size, pictures: Mapping[int, np.ndarray | None]) -> np.ndarray:
    """(height, timeline.width, 3) uint8. `pictures`: by frame; None or missing for those that are not drawn yet."""
    canvas = Canvas(timeline.width, size[1], RAISED)
    for slot in slots(timeline, size[0]):
        picture = pictures.get(slot.frame)
        if picture is not None:
            # the ground of the image fills its place, so that the strip has no gaps
            red, green, blue = (int(channel) for channel in picture[0, 0])
            canvas.rect(slot.x, 0, slot.width - 1, size[1], (red, green, blue))
            canvas.image(slot.x + (slot.width - 1 - size[0]) / 2, 0, picture)
    timeline.shade(canvas.pixels)
    return canvas.pixels


def has_pictures(player: PlayerPresenter) -> bool:
    """Whether the open take or stream can be drawn: not a stream on the web, which would be downloaded twice."""
    opened = player.opened
    return opened is not None and opened.default is not None and not is_address(str(opened.path))


class Filmstrip(Thumbnails):
    """Draws the images while nothing is played and no stage runs."""

    def __init__(self) -> None:
        super().__init__()
        self._cameras: MemoryCache[tuple[object, ...], Camera] = MemoryCache(1)

    def pictures(
        self, player: PlayerPresenter, frames: list[int], size: Size, busy: bool = False
    ) -> dict[int, np.ndarray | None]:
        """Pictures by frame, None until they are drawn; empty if nothing can be. `busy`: a stage needs the time."""
        opened = player.opened
        if opened is None or not has_pictures(player):
            return {}
        camera = self._view(player, size)
        ask = not (busy or player.transport.playing)  # would take time from the stage, or the frames that are played
        return {frame: self.get(opened.path, player.contents, camera, frame, size, ask) for frame in frames}

    def _view(self, player: PlayerPresenter, size: Size) -> Camera:
        """The direction of the view that the take opens with, as near as all that moves allows."""
        key = (id(player.points), player.home.key, size)
        return self._cameras.get_or_make(key, lambda _: player.home.filling(player.points, *size))
