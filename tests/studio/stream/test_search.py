"""Search for QPs that reach a target."""

import numpy as np
import pytest

from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.encode.quality import search_qp
from tests.support.errors import refuses


@pytest.mark.parametrize("target", [3.0, 10.0, 17.5, 40.0, 50.0])
def test_bisection_finds_the_border(target):
    calls = []

    def falling(qp):
        calls.append(qp)
        return 51.0 - qp  # 50 at QP 1, 0 at QP 51

    lowest = search_qp(falling, target, "group 0", "KB per frame", at_most=True)
    assert falling(lowest) <= target
    assert lowest == 1 or falling(lowest - 1) > target
    calls.clear()
    highest = search_qp(falling, target, "group 0", "dB", at_most=False)
    assert falling(highest) >= target
    assert highest == 51 or falling(highest + 1) < target
    assert len(calls) <= 12


def test_targets_out_of_reach_are_said():
    with refuses("bake.target_missed", value=9.0, qp=51, expected=5.0, setting="bake.quality") as caught:
        search_qp(lambda qp: 60.0 - qp, 5.0, "group 7", "KB per frame", at_most=True)
    assert str(caught.value) == (
        "group 7 has 9 KB per frame at QP 51, which misses the target of 5. Raise the target, or train fewer splats."
    )
    with refuses("bake.target_missed", value=59.0, qp=1, expected=70.0, setting="bake.quality"):
        search_qp(lambda qp: 60.0 - qp, 70.0, "group 7", "dB", at_most=False)


@pytest.mark.parametrize("profile", ["motion", "planes"])
def test_kilobytes(tmp_path, turning_bodies, profile):
    frames = turning_bodies(4, 800)
    sizes = {}
    for qp in (10, 40):
        settings = BakeSettings(profile=profile, quality=qp, preset="veryfast")
        sizes[qp] = bake_group(frames, tmp_path / str(qp), 0, 0, settings).bytes / 4000
    target = (sizes[10] + sizes[40]) / 2
    settings = BakeSettings(profile=profile, quality=f"{target:.3f} KB", preset="veryfast")
    entry = bake_group(frames, tmp_path / "t", 0, 0, settings)
    assert 0.85 * target < entry.bytes / 4000 <= target + 1e-3
    manifest = write_manifest(tmp_path / "t", [entry], 25, settings)
    assert manifest.settings["target_kb_per_frame"] == pytest.approx(target, abs=1e-3)
    with StreamReader.open(tmp_path / "t") as reader:
        reader.verify()
        assert len(list(reader.iterate())) == 4


def test_psnr_by_the_callers_measure(tmp_path, turning_bodies):
    """With opacities in place of pictures: decoded frames are passed, and the QP found is the highest that suffices."""
    frames = turning_bodies(5, 800)
    wanted = np.sort(frames[0].opacities.numpy())
    asked = []

    def quality(index, decoded):
        asked.append(index)
        return float(np.mean((np.sort(decoded.opacities.numpy()) - wanted) ** 2))

    settings = BakeSettings(quality="40 dB", preset="veryfast")
    entry = bake_group(frames, tmp_path, 0, 0, settings, quality=quality)
    assert set(asked) == {0, 2, 4}

    def psnr(qp):
        errors = []
        place = tmp_path / f"qp{qp}"
        write_manifest(place, [bake_group(frames, place, 0, 0, settings_at(qp))], 25, settings_at(qp))
        with StreamReader.open(place) as reader:
            errors = [quality(index, reader.gaussians(index)) for index in (0, 2, 4)]
        return -10 * np.log10(np.mean(errors))

    def settings_at(qp):
        return BakeSettings(quality=qp, preset="veryfast")

    qp = entry.best.video.qp
    assert psnr(qp) >= 40 > psnr(qp + 1)
    with refuses("bake.no_renderer", setting="bake.quality"):
        bake_group(frames, tmp_path, 0, 0, settings)
