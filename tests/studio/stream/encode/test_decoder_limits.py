"""Warnings about hardware decoders, at the limits of level 5.1 (ITU-T H.264, table A-1) and one step beyond them."""

import pytest

from v3studio.studio.stream.encode.decoder_limits import beyond_hardware
from v3studio.studio.stream.manifest import GroupEntry, Pruning, Rendition, VideoEntry


def warned(rendition: Rendition, fps: float = 25.0) -> bool:
    group = GroupEntry.model_construct(index=4, renditions=(rendition,))
    messages = beyond_hardware(group, fps)
    for message in messages:
        assert message.code == "bake.beyond_hardware"
        fields = {"rendition": "qp0", "group": 4, "size": list(rendition.size), "fps": fps}
        assert message.fields == fields
    assert len(messages) <= 1
    return bool(messages)


def motion(columns: int, rows: int, qp: int = 1, pruning: Pruning = "importance") -> Rendition:
    """A rendition whose video has tiles of 256 pixels."""
    video = VideoEntry.model_construct(qp=qp)
    return Rendition.model_construct(id="qp0", tile=256, columns=columns, rows=rows, video=video, pruning=pruning)


@pytest.mark.parametrize(
    ("rendition", "fps", "beyond"),
    [
        (motion(16, 9), 25.0, False),  # 4096x2304: 36,864 macroblocks
        (motion(9, 16), 25.0, False),
        (motion(17, 1), 25.0, True),  # 4352 pixels a side
        (motion(1, 17), 25.0, True),
        (motion(16, 10), 1.0, True),  # 40,960 macroblocks
        (motion(16, 9), 26.6, False),  # 980,582 macroblocks per second
        (motion(16, 9), 26.7, True),  # 984,269
        (motion(4, 4, qp=0), 25.0, True),  # lossless
        (motion(4, 4, qp=0, pruning="fine-tuned"), 25.0, True),
        (motion(4, 4, qp=0, pruning="none"), 25.0, False),  # the best rendition, which was asked to be lossless
    ],
)
def test_limits_of_level_5_1(rendition: Rendition, fps: float, beyond: bool) -> None:
    assert warned(rendition, fps) == beyond
