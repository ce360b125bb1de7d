"""What Capture keeps in memory: small pictures of one take, up to a limit."""

import gc
from pathlib import Path

import numpy as np
import pytest

from gui.models.take.workspace import Workspace
from gui.pages.capture import view as capture
from gui.pages.capture.view import CaptureView
from pipelines.takes.take import Take
from studio.memory_cache import MemoryCache, bytes_of

SIZE = (720, 500)


def drawn(view: CaptureView, mode: str, frame: int) -> np.ndarray:
    view.mode, view.frame, view.em = mode, frame, 16.0
    return view.draw(SIZE, view.state())


def kept() -> int:
    """Bytes of images and masks in all caches."""
    return sum(one.used for one in gc.get_objects() if type(one) is MemoryCache and one.size_of is bytes_of)


def test_what_capture_keeps_is_bounded_and_its_pictures_stay_the_same(
    workspace: Workspace, finished_project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gc.collect()
    before = kept()
    workspace.open(Take.open(finished_project / "take"))
    usual = CaptureView(workspace)
    wanted = {(mode, frame): drawn(usual, mode, frame) for mode in ("", "masks", "evidence") for frame in range(4)}
    used = kept() - before
    usual.forget()
    assert len({picture.tobytes() for picture in wanted.values()}) == len(wanted)

    image = 64 * 48 * 4  # of one camera, with its mask
    monkeypatch.setattr(capture, "KEPT_BYTES", 7 * image)  # more than the six of one frame
    monkeypatch.setattr(capture, "DECODED_BYTES", image)
    tight = CaptureView(workspace)
    for key, picture in wanted.items():
        assert np.array_equal(drawn(tight, *key), picture), key
        assert kept() - before <= 8 * image < used
    usual.close()
    tight.close()
