"""Finding QPs: for a target of a group, and of single frames so that encoding costs none more than a limit."""

import numpy as np
import pytest

from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.encode.quality import ROUNDS, limited_offsets, loss, search_qp
from studio.stream.settings import LOSS_QP
from studio.stream.video import PlaneDecoder, PlaneEncoder
from tests.support.errors import refuses
from tests.support.settings import refuses_setting

SIZE = (64, 48)


@pytest.mark.parametrize("target", [3.0, 10.0, 17.5, 40.0, 50.0])
def test_bisection_finds_the_border(target):
    calls = []

    def falling(qp):
        calls.append(qp)
        return 51.0 - qp  # 50 at QP 1, 0 at QP 51

    lowest = search_qp(falling, target, "group 0", "KB per frame", at_most=True)
    assert falling(lowest) <= target + 1e-3
    assert lowest == 1 or falling(lowest - 1) > target
    calls.clear()
    highest = search_qp(falling, target, "group 0", "dB", at_most=False)
    assert falling(highest) >= target
    assert highest == 51 or falling(highest + 1) < target
    assert len(calls) <= 12


def test_targets_out_of_reach_are_said():
    with refuses("bake.target_missed", value=9.0, qp=51, expected=5.0, setting="bake.quality") as caught:
        search_qp(lambda qp: 60.0 - qp, 5.0, "group 7", "KB per frame", at_most=True)
    assert "9 KB per frame at QP 51" in str(caught.value)
    with refuses("bake.target_missed", value=59.0, qp=1, expected=70.0, setting="bake.quality"):
        search_qp(lambda qp: 60.0 - qp, 70.0, "group 7", "dB", at_most=False)


def test_kilobytes(tmp_path, turning_bodies):
    frames = turning_bodies(3, 400)
    sizes = {}
    for qp in (10, 40):
        settings = BakeSettings(quality=qp, preset="ultrafast")
        sizes[qp] = bake_group(frames, tmp_path / str(qp), 0, 0, settings).best.bytes / 3000
    target = (sizes[10] + sizes[40]) / 2
    settings = BakeSettings(quality=f"{target:.3f} KB", preset="ultrafast")
    entry = bake_group(frames, tmp_path / "t", 0, 0, settings)
    assert 0.85 * target < entry.best.bytes / 3000 <= target + 1e-3
    manifest = write_manifest(tmp_path / "t", [entry], 25, settings)
    assert manifest.settings["target_kb_per_frame"] == pytest.approx(target, abs=1e-3)
    with StreamReader.open(tmp_path / "t") as reader:
        reader.verify()


def test_psnr_by_the_callers_measure(tmp_path, turning_bodies):
    """With opacities in place of pictures: decoded frames are passed, and the QP found is the highest that suffices."""
    frames = turning_bodies(5, 400)
    wanted = np.sort(frames[0].opacities.numpy())
    asked = []

    def quality(index, decoded):
        asked.append(index)
        return float(np.mean((np.sort(decoded.opacities.numpy()) - wanted) ** 2))

    settings = BakeSettings(quality="40 dB", preset="ultrafast")
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
        return BakeSettings(quality=qp, preset="ultrafast")

    qp = entry.best.video.qp
    assert psnr(qp) >= 40 > psnr(qp + 1)
    with refuses("bake.no_renderer", setting="bake.quality"):
        bake_group(frames, tmp_path, 0, 0, settings)


def test_a_loss_is_the_difference_of_two_psnrs():
    assert loss(1e-3, 2e-3) == pytest.approx(10 * np.log10(2))
    assert loss(2e-3, 1e-3) == pytest.approx(-10 * np.log10(2))
    assert loss(0.0, 0.0) == 0


def encoder_of(weights, qp):
    """`measure` of a codec whose squared error doubles every three QPs, and the offsets that it was called with."""
    calls = []

    def measure(offsets):
        calls.append(offsets)
        return [
            (1e-3, 1e-3 + weight * 1e-5 * 2 ** ((qp + offset) / 3))
            for weight, offset in zip(weights, offsets, strict=True)
        ]

    return measure, calls


def test_only_frames_above_the_limit_get_a_lower_qp_and_none_remains_above():
    measure, calls = encoder_of((0.05, 0.5, 4.0, 0.08), 20)
    offsets = limited_offsets(measure, 4, 20, 0.4)
    assert offsets == calls[-1]
    assert len(calls) <= ROUNDS
    assert offsets[0] == offsets[3] == 0
    assert offsets[2] < offsets[1] < 0
    assert all(loss(*pair) <= 0.4 for pair in measure(offsets))
    one_more = [offset + 1 if offset else 0 for offset in offsets]
    assert [loss(*pair) > 0.4 for pair in measure(one_more)] == [False, True, True, False], "no lower than needed"


def test_frames_within_the_limit_are_encoded_once():
    measure, calls = encoder_of((0.05, 0.05), 20)
    assert limited_offsets(measure, 2, 20, 0.4) == (0, 0)
    assert calls == [(0, 0)]


def test_a_loss_that_no_qp_removes_ends_after_some_rounds():
    calls = []

    def measure(offsets):
        calls.append(offsets)
        return [(1e-3, 2e-3)]

    assert limited_offsets(measure, 1, 8, 0.4) == calls[-1] == (-7,), "QP 1"
    assert len(calls) <= ROUNDS


def encoded(path, pictures, tiles, b_frames, offsets, qp=30):
    """Mean squared error of each decoded picture."""
    encoder = PlaneEncoder(path, SIZE, qp, "veryfast", tiles, b_frames=b_frames, fps=25, offsets=offsets)
    for picture in pictures:
        encoder.add(picture)
    encoder.close()
    decoder = PlaneDecoder(path.read_bytes(), "test", SIZE, len(pictures))
    errors, found = [], np.empty(SIZE[::-1], dtype=np.uint8)
    for picture in pictures:
        decoder.read(found)
        errors.append(float(((found.astype(float) - picture) ** 2).mean()))
    decoder.close()
    return np.array(errors)


@pytest.mark.parametrize(("tiles", "b_frames"), [("h264", 0), ("h264", 3), ("h264", 5), (None, 0)])
def test_the_encoder_takes_the_qp_of_single_pictures(tmp_path, tiles, b_frames):
    noise = np.random.default_rng(0)
    base = noise.integers(20, 235, SIZE[::-1])
    pictures = [np.clip(base + noise.normal(0, 12, base.shape), 0, 255).astype(np.uint8) for _ in range(12)]
    file = tmp_path / "a.mp4"
    plain = encoded(file, pictures, tiles, b_frames, ())
    size = file.stat().st_size
    for lowered in ([5], [0], [11], [4, 5, 6]):
        offsets = [-12 if index in lowered else 0 for index in range(12)]
        ratio = encoded(file, pictures, tiles, b_frames, offsets) / plain
        assert (ratio[lowered] < 0.2).all(), "12 QPs are a sixteenth of the squared error"
        others = np.delete(ratio, lowered)
        assert (others > 0.8).all()
        assert (others < 1.2).all()
        assert size < file.stat().st_size < size * (1 + 0.2 * len(lowered))
    ratio = encoded(file, pictures, tiles, b_frames, [-40] + [0] * 6 + [-6] + [0] * 4) / plain
    assert ratio[0] < 0.1, "as low as QP 1"
    assert 0.05 < ratio[7] < 0.5
    lossless = encoded(file, pictures, tiles, b_frames, [-3] + [0] * 11, qp=0)
    assert (lossless == 0).all()


def test_a_group_gives_the_bytes_to_the_frames_that_need_them(tmp_path, turning_bodies):
    """Opacities stand for images; only frame 3 is said to suffer from encoding."""
    frames = turning_bodies(6, 300)
    wanted = [np.sort(frame.opacities.numpy()) for frame in frames]

    def measured(index, decoded):
        return float(np.mean((np.sort(decoded.opacities.numpy()) - wanted[index]) ** 2))

    def baked(name, error, quality):
        settings = BakeSettings(quality=quality, preset="veryfast", smooth_paths=False)
        entry = bake_group(frames, tmp_path / name, 0, 0, settings, error=error)
        manifest = write_manifest(tmp_path / name, [entry], 25, settings)
        with StreamReader.open(tmp_path / name) as reader:
            return manifest, [measured(index, reader.gaussians(index)) for index in range(6)]

    plain, errors = baked("plain", None, LOSS_QP)

    def error(index, decoded):
        return 1.0, 1.0 + (measured(index, decoded) / errors[3] if index == 3 else 0)  # 3 dB as encoded above

    limited, fewer = baked("limited", error, "1 dB loss")
    assert loss(1.0, 1.0 + fewer[3] / errors[3]) <= 1.0
    assert plain.total_bytes < limited.total_bytes < 1.6 * plain.total_bytes
    assert fewer[0] == pytest.approx(errors[0], rel=0.3)
    assert "max_loss" not in plain.settings
    assert limited.settings["max_loss"] == 1.0
    with refuses("bake.no_footage", setting="bake.quality"):
        bake_group(frames, tmp_path / "none", 0, 0, BakeSettings(quality="0.4 dB loss"))


def test_it_requires_h264():
    with refuses_setting("quality", "codec"):
        BakeSettings(quality="0.4 dB loss", codec="hevc")
