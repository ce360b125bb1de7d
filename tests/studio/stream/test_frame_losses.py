"""Lower QPs for single frames, so that encoding costs none of them more than a limit."""

import numpy as np
import pytest

from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.encode.quality import ROUNDS, limited_offsets, loss
from studio.stream.settings import LOSS_QP
from studio.stream.video import PlaneDecoder, PlaneEncoder
from tests.support.errors import refuses
from tests.support.settings import refuses_setting

SIZE = (64, 48)


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
    """Opacities stand for pictures; only frame 3 is said to suffer from encoding."""
    frames = turning_bodies(6, 800)
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
