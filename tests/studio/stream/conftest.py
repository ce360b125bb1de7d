"""Fixtures: small moving splat sets and baked streams."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.support import sounds
from tests.support.shared import made_once
from tests.support.splats import noise
from v3studio.studio.audio import SoundFile, cut_sound
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream import BakeSettings, Rung, bake_group, bake_sound, write_manifest
from v3studio.studio.stream.encode import write_manifest as manifest_writer

MakeLadder = Callable[..., Path]
FindStream = Callable[[str], Path]
LADDER = (Rung(qp=24), Rung(qp=34), Rung(qp=34, splats=0.5, sh_degree=0, finetune_iterations=0))
KINDS: dict[str, dict[str, Any]] = {
    "motion": {"lengths": (4, 3), "ladder": (), "quality": 24},
    "ladder": {"lengths": (3, 2, 2), "clicks": [0.1], "paged": True},
}
"""Streams of 80 splats that tests share: one with several renditions, sound, and two groups in a page of the index."""


@pytest.fixture(scope="session")
def intact(tmp_path_factory: pytest.TempPathFactory) -> FindStream:
    """`intact(kind)`: one of `KINDS`, not to be changed."""

    def find(kind: str) -> Path:
        def make(folder: Path) -> None:
            write_stream(folder / "stream", splats=80, **KINDS[kind])

        return made_once(tmp_path_factory, f"stream of {kind}", make) / "stream"

    return find


@pytest.fixture
def copy_of(intact: FindStream, tmp_path: Path) -> FindStream:
    """`copy_of(kind)`: a copy of one of `KINDS`, to change."""
    return lambda kind: Path(shutil.copytree(intact(kind), tmp_path / kind))


@pytest.fixture
def make_ladder(tmp_path: Path) -> MakeLadder:
    """`make_ladder(lengths, ...)`: a stream in `tmp_path`, as `write_stream` makes."""

    def make(lengths: tuple[int, ...] = (4, 3), name: str = "stream", **more: Any) -> Path:
        return write_stream(tmp_path / name, lengths, **more)

    return make


def write_stream(
    folder: Path,
    lengths: tuple[int, ...] = (4, 3),
    splats: int = 120,
    degree: int = 1,
    clicks: Sequence[float] | None = None,
    paged: bool = False,
    **settings: Any,
) -> Path:
    """A stream with groups of these lengths and three renditions. With `clicks`, with sound that has clicks at these
    times; with `paged`, with all groups but the first in pages of the index."""
    chosen = BakeSettings(**{"ladder": LADDER, "preset": "ultrafast", **settings})
    entries, first = [], 0
    for g, length in enumerate(lengths):
        frames = turned_bodies(first + length, splats, degree)[first:]
        share = lambda: torch.arange(splats).numpy().astype(float)  # noqa: E731
        entries.append(bake_group(frames, folder, g, first, chosen, fps=25.0, contribution=share))
        first += length
    audio = None
    if clicks is not None:
        seconds = first / 25
        wav = sounds.write_wav(folder.with_suffix(".wav"), sounds.clicks(seconds, clicks, channels=2))
        audio = bake_sound(cut_sound(SoundFile(wav), 0, seconds), folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(manifest_writer, "INLINE_BYTES", 1 if paged else 1 << 20)
        write_manifest(folder, entries, 25.0, chosen, {"title": "test"}, audio=audio)
    return folder


def clouds(frames: int = 4, splats: int = 200, degree: int = 0, seed: int = 0) -> list[Gaussians]:
    """A rotating, drifting cloud; all attributes vary over time."""
    random = noise(seed)
    start, velocity = random(splats, 3), 0.05 * random(splats, 3)
    quats, log_scales, logits = random(splats, 4), random(splats, 3) * 0.7 - 4, random(splats) * 2
    sh = random(splats, (degree + 1) ** 2, 3)
    return [
        Gaussians(
            means=start + t * velocity + torch.tensor([0.1 * t, 0.0, 0.0]),
            quats=(quats + 0.1 * t * random(splats, 4)) * (-1.0) ** t,  # signs flip on purpose
            log_scales=log_scales + 0.02 * t,
            logit_opacities=logits - 0.05 * t,
            sh=sh + 0.01 * random(*sh.shape),
        )
        for t in range(frames)
    ]


def turned_bodies(frames: int, splats: int, degree: int = 0) -> list[Gaussians]:
    """Two rigid bodies that pass through each other, one of them rotating; colors and sizes are constant."""
    random = noise(3)
    start = random(splats, 3) * 0.2
    second = torch.arange(splats) % 2 == 1
    quats = torch.nn.functional.normalize(random(splats, 4), dim=1)
    log_scales, logits, sh = random(splats, 3) * 0.5 - 4, random(splats), random(splats, (degree + 1) ** 2, 3)
    result = []
    for t in range(frames):
        turn = Rotation.from_rotvec([0, 0, 0.2 * t])
        moved = torch.from_numpy(start.numpy() @ turn.as_matrix().T).float()
        turned = (turn * Rotation.from_quat(quats.numpy()[:, [1, 2, 3, 0]])).as_quat()[:, [3, 0, 1, 2]]
        means = torch.where(second[:, None], moved, start + torch.tensor([0.05 * t, 0.0, 0.0]))
        turns = torch.where(second[:, None], torch.from_numpy(turned).float(), quats)
        result.append(Gaussians(means, turns, log_scales, logits, sh))
    return result
