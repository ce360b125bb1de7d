"""Exports appear complete or not at all: on a full disk, and where two write to the same place."""

import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.studio.formats.conftest import MakeVideo
from tests.support.errors import cancel_at, refuses
from tests.support.streams import contents
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import Cancelled
from v3studio.studio.formats.exr import export_exr
from v3studio.studio.formats.movie import render_movie
from v3studio.studio.formats.sequence import export_sequence
from v3studio.studio.formats.usd import export_usd
from v3studio.studio.formats.videogs import export_videogs
from v3studio.studio.similarity import Similarity

CAMERA = Camera.look_at((2.0, 0, 0.2), (0, 0, 0), (0, 0, 1), width=64, height=48)

Export = Callable[..., object]
WRITERS: dict[str, Export] = {
    "out.usdc": export_usd,
    "out.usdz": export_usd,
    "plates": lambda video, out, **more: export_exr(video, out, lambda index: CAMERA, Similarity(), **more),
    "ply": lambda video, out, **more: export_sequence(video, out, ".ply", **more),
    "videogs": export_videogs,
    "a.mp4": lambda video, out, **more: render_movie(video, out, lambda time: CAMERA, lambda time: 0, 0.3, 10, **more),
}


@pytest.fixture(params=WRITERS)
def export(request: pytest.FixtureRequest, tmp_path: Path) -> Export:
    """Exports a video to one place."""
    return lambda video, **more: WRITERS[request.param](video, tmp_path / request.param, **more)


def test_of_two_exports_the_first_that_ends_wins(export: Export, make_video: MakeVideo, tmp_path: Path) -> None:
    video, done = make_video((2,), splats=50), []

    def read(index):
        if not done:  # while the first has begun, the other writes everything
            done.append(index)
            export(video)
            done.append(written())
        return video.read(index)

    def written():
        visible = [path for path in tmp_path.iterdir() if not path.name.startswith(".")]
        return {path.name: path.read_bytes() if path.is_file() else contents(path) for path in visible}

    with refuses("export.already_exists"):
        export(replace(video, read=read))
    assert done[1]
    assert written() == done[1]
    assert len(list(tmp_path.iterdir())) == len(done[1]), "temporary files"


def test_a_canceled_export_leaves_nothing(export: Export, make_video: MakeVideo, tmp_path: Path) -> None:
    with pytest.raises(Cancelled):
        export(make_video((3,), splats=50), progress=cancel_at(2))
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_nothing(export: Export, make_video: MakeVideo, tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        with refuses("export.write_failed") as error:
            export(make_video((2,), splats=3000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []
