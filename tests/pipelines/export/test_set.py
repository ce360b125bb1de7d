"""The set behind the performer, exported as one frame, and shown in movies unless a color takes its place."""

from pathlib import Path

import av
import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from tests.support.streams import bake_numbered, edit_manifest
from v3studio.pipelines.export.source import Source
from v3studio.pipelines.export.writers import writer_of
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import no_progress
from v3studio.studio.stream import BakeSettings, StreamReader, bake_set, write_manifest


@pytest.fixture
def stream(tmp_path: Path) -> Path:
    """Two frames of a performer at x = 0 and 1, inside a red ball of splats."""
    folder, settings = bake_numbered(tmp_path / "stream", (2,), 25.0), BakeSettings(quality=0, preset="ultrafast")
    directions = torch.nn.functional.normalize(torch.randn(300, 3, generator=torch.Generator().manual_seed(0)), dim=1)
    quats, red = torch.tensor([[1.0, 0, 0, 0]]).repeat(300, 1), torch.tensor([[[1.5, -1.5, -1.5]]]).repeat(300, 1, 1)
    behind = Gaussians(20 * directions, quats, torch.full((300, 3), 1.0), torch.full((300,), 6.0), red)
    with StreamReader.open(folder) as reader:
        groups = reader.manifest.groups
    write_manifest(folder, groups, 25.0, settings, behind=bake_set(behind, folder, settings))
    return folder


def test_it_is_a_video_of_one_frame(stream: Path) -> None:
    with Source(str(stream)) as source:
        video = source.video("set")
        assert (video.frame_count, len(video.read(0))) == (1, 300)
        assert source.sound("set", video) is None
    edit_manifest(stream, lambda values: values.update(set=[]))
    with Source(str(stream)) as source, refuses("export.no_set"):
        source.video("set")


@pytest.mark.parametrize(("options", "redness"), [({}, 60), ({"background": (0.0, 0.0, 0.0)}, 0)])
def test_movies_show_it_unless_there_is_a_color(
    stream: Path, tmp_path: Path, options: dict[str, tuple[float, float, float]], redness: int
) -> None:
    out = tmp_path / "turn.mp4"
    with Source(str(stream)) as source:
        writer_of("turntable", source, out, False, {"size": (64, 48), "seconds": 0.2, **options}).write(no_progress)
    with av.open(str(out)) as container:
        image = next(container.decode(video=0)).to_ndarray(format="rgb24").astype(int)
    assert np.median(image[..., 0] - image[..., 2]) >= redness
    assert (redness > 0) == bool(np.median(image[..., 0] - image[..., 2]) > 20)
