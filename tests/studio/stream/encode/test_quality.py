"""Finding the QP of a group for a target."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.studio.stream.conftest import turned_bodies
from tests.support.errors import refuses
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, check_stream, write_manifest
from v3studio.studio.stream.encode.quality import highest_qp
from v3studio.studio.stream.settings import LEVELS


@pytest.mark.parametrize("steepness", [0.25, 1.0, 4.0])
@pytest.mark.parametrize("border", [0, 1, 15, 22, 23, 40, 51])
def test_the_search_finds_the_last_qp_that_is_good_enough_in_few_calls(steepness: float, border: int) -> None:
    calls = []

    def spare(qp):
        assert 1 <= qp <= 51
        calls.append(qp)
        return steepness * (border + 0.5 - qp)

    assert highest_qp(spare, 22) == border
    assert len(calls) == len(set(calls)) <= 6


@pytest.mark.parametrize(("quality", "target", "qp"), [("0.001 KB", 0.001, 51), ("100 dB", 100, 1)])
def test_targets_out_of_reach_are_said(tmp_path: Path, quality: str, target: float, qp: int) -> None:
    with refuses("bake.target_missed", qp=qp, setting="bake.quality", group=3, expected=target) as caught:
        error = lambda index, decoded: 1e-3  # noqa: E731
        bake_group(turned_bodies(2, 200), tmp_path, 3, 0, BakeSettings(quality=quality), quality=error)
    assert caught.value.value == pytest.approx(30) if qp == 1 else caught.value.value > 0.1


def test_kilobytes(tmp_path: Path) -> None:
    frames = turned_bodies(3, 400)
    rendered = []

    def baked(quality):
        rendered.clear()
        settings = BakeSettings(quality=quality, preset="ultrafast")
        error = lambda index, decoded: rendered.append(index) or 1e-4  # noqa: E731
        return bake_group(frames, tmp_path / "t", 0, 0, settings, quality=error), settings

    target = sum(baked(qp)[0].best.bytes / 3000 for qp in (10, 40)) / 2
    entry, settings = baked(f"{target:.3f} KB")
    assert rendered == [0, 1, 2], "only the last encoding's frames"
    assert entry.best.psnr_to_trained == pytest.approx(40)
    assert 0.85 * target < entry.best.bytes / 3000 < target + 1e-3
    manifest = write_manifest(tmp_path / "t", [entry], 25, settings)
    assert manifest.settings["target_kb_per_frame"] == pytest.approx(target, abs=1e-3)
    with StreamReader.open(tmp_path / "t") as reader:
        assert not check_stream(reader).damage


@pytest.mark.parametrize("level", [*LEVELS, "40.5 dB"])
def test_levels_are_kept_by_the_highest_qp_that_does(tmp_path: Path, level: str) -> None:
    """Opacities stand for images."""
    frames = turned_bodies(20, 400)
    wanted = [np.sort(frame.opacities.numpy()) for frame in frames]
    asked = set()

    def quality(index, decoded):
        asked.add(index)
        return float(np.mean((np.sort(decoded.opacities.numpy()) - wanted[index]) ** 2))

    def baked(value):
        settings = BakeSettings(quality=value, preset="ultrafast")
        folder = tmp_path / str(value)
        entry = bake_group(frames, folder, 0, 0, settings, quality=quality)
        return entry.best, write_manifest(folder, [entry], 25, settings)

    best, manifest = baked(level)
    promised = manifest.settings["target_psnr"]
    assert best.psnr_to_trained >= promised == LEVELS.get(level, 40.5)
    assert len(asked) == 8
    assert {0, 19} < asked
    assert baked(best.qp)[0] == best, "as that QP alone"
    assert baked(best.qp + 1)[0].psnr_to_trained < promised


def test_a_group_that_smoothing_keeps_from_its_level_is_not_smoothed(tmp_path: Path) -> None:
    frames = turned_bodies(6, 300)
    noise = np.random.default_rng(0)
    for frame in frames:
        frame.means += torch.from_numpy(noise.normal(0, 1e-3, frame.means.shape)).float()
    places = [np.sort(frame.means.numpy(), axis=0) for frame in frames]

    def quality(index, decoded):
        return float(np.mean((np.sort(decoded.means.numpy(), axis=0) - places[index]) ** 2))

    told = []

    def baked(value, smooth=None):
        settings = BakeSettings(quality=value, smooth_paths=smooth, preset="ultrafast")
        return bake_group(frames, tmp_path, 0, 0, settings, quality=quality, unsmoothed=lambda: told.append(value)).best

    smoothed, plain = (baked(1, smooth).psnr_to_trained for smooth in (True, False))
    assert smoothed < plain - 3
    goal = f"{(smoothed + plain) / 2:.2f} dB"
    assert baked(goal) == baked(goal, smooth=False)
    assert told == [goal]
    with refuses("bake.target_missed", setting="bake.quality"):
        baked(goal, smooth=True)


def test_a_level_needs_images(tmp_path: Path) -> None:
    with refuses("bake.no_renderer", setting="bake.quality"):
        bake_group(turned_bodies(2, 100), tmp_path, 0, 0, BakeSettings(quality="good"))
