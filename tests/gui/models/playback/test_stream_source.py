from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from v3studio.gui.models.playback.stream_source import StreamSource
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits import World
from v3studio.studio.playback import LeftOut
from v3studio.studio.stream import CapturePlace


def test_a_trimmed_and_placed_stream_is_shown_as_in_its_take(take_copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = Take.open(take_copy)
    plain = StreamSource(take.stream, in_take=True)
    world = World(up=(0, 0, 1), origin=(0.1, 0, 0), scale=50)
    # the same stream, read as one that begins with frame 2 of another world
    monkeypatch.setattr(
        "v3studio.gui.models.playback.stream_source.capture_place", lambda _: CapturePlace(2, world.similarity)
    )
    with closing(plain), closing(StreamSource(take.stream, in_take=True)) as placed:
        assert (placed.frame_count, list(placed.group_starts)) == (7, [2, 5])
        with pytest.raises(LeftOut):
            placed.gaussians(1)
        there, here = placed.gaussians(3).means.double(), plain.gaussians(1).means.double()
        back = world.similarity.points(there.numpy())
        assert np.allclose(back, here.numpy(), atol=1e-3)
