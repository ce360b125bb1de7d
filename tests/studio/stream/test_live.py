"""Live streams: the manifest grows, and a reader follows."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from tests.support.errors import refuses
from tests.support.streams import bake_numbered, only
from v3studio.studio.stream import BakeSettings, Rung, StreamReader, check_stream
from v3studio.studio.stream.encode import write_manifest as manifest_writer

LADDER = (Rung(qp=24), Rung(qp=34))


@pytest.fixture
def publish(tmp_path: Path) -> Callable[..., Path]:
    """`publish(groups, live, ...)`: bake the first groups of two frames each, and write the manifest."""

    def write(groups, live=True, fps=25, ladder=LADDER):
        settings = BakeSettings(ladder=ladder, preset="ultrafast")
        return bake_numbered(tmp_path, (2,) * groups, fps, 60, settings, live=live)

    return write


def test_a_reader_follows(publish: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    folder = publish(1)
    monkeypatch.setattr(manifest_writer, "INLINE_BYTES", 1)  # later groups are in pages
    with only(StreamReader.open(folder), "qp34") as reader:
        assert reader.live
        first = reader.gaussians(1)
        assert reader.refresh() == 0
        publish(3)
        assert reader.refresh() == 2
        assert reader.frame_count == 6
        assert torch.equal(reader.gaussians(1).means, first.means)
        assert reader.gaussians(5).means.shape == (60, 3)
        publish(4, live=False)
        assert reader.refresh() == 1
        assert not reader.live
        assert reader.refresh() == 0
        assert not check_stream(reader).damage


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"groups": 1}, "groups"),
        ({"groups": 3, "fps": 30}, "fps"),
        ({"groups": 3, "ladder": (Rung(qp=24),)}, "renditions"),
    ],
)
def test_a_manifest_that_takes_back_is_refused(publish: Callable[..., Path], change: dict[str, Any], what: str) -> None:
    folder = publish(2)
    with StreamReader.open(folder) as reader:
        publish(**change)
        with refuses("stream.live_changed", value=[what]):
            reader.refresh()
        assert reader.frame_count == 4
