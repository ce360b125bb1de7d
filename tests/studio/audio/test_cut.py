"""Cutting a sound to frames: a click stays at its time, whatever the file, its rate and where the take begins."""

from pathlib import Path

import av
import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.sounds import click_times, clicks, write_wav
from v3studio.studio.audio import SAMPLE_RATE, Cut, SoundFile, cut_sound, encode_sound


def read(cut: Cut) -> np.ndarray:
    samples = np.concatenate(list(cut.blocks()))
    assert samples.shape == (cut.samples, cut.channels)
    return samples


@pytest.mark.parametrize(("rate", "channels"), [(48_000, 1), (44_100, 2), (8_000, 1)])
def test_clicks_stay_at_their_times(tmp_path: Path, rate: int, channels: int) -> None:
    file = SoundFile(write_wav(tmp_path / "a.wav", clicks(3.0, [0.5, 1.25, 2.5], rate, channels), rate))
    assert file.channels == channels
    assert file.duration == pytest.approx(3.0)
    cut = cut_sound(file, 0.4, 1.5)
    assert click_times(read(cut)) == pytest.approx([0.1, 0.85], abs=0.0005)
    assert cut.missing_before == cut.missing_after == 0


def test_what_is_missing_is_silent(tmp_path: Path) -> None:
    file = SoundFile(write_wav(tmp_path / "a.wav", clicks(1.0, [0.25])))
    cut = cut_sound(file, -0.5, 2.0)
    samples = read(cut)
    assert click_times(samples) == pytest.approx([0.75], abs=0.0005)
    assert not samples[: SAMPLE_RATE // 2].any()
    assert not samples[-SAMPLE_RATE // 2 :].any()
    assert (cut.missing_before, cut.missing_after) == pytest.approx((0.5, 0.5))


def test_a_sound_outside_of_the_take_is_refused(tmp_path: Path) -> None:
    file = SoundFile(write_wav(tmp_path / "a.wav", clicks(1.0, [])))
    for start in (1.0, 500.0, -2.0):
        with refuses("audio.outside", file=tmp_path / "a.wav", setting="capture.audio_offset"):
            read(cut_sound(file, start, 2.0))


def test_files_that_are_not_sounds(tmp_path: Path) -> None:
    (tmp_path / "a.wav").write_text("not a sound")
    with refuses("audio.unreadable", file=tmp_path / "a.wav"):
        SoundFile(tmp_path / "a.wav")
    with refuses("audio.unreadable"):
        SoundFile(tmp_path / "none.wav")
    unknown = write_wav(tmp_path / "unknown.wav", clicks(0.2, [0.1]))
    data = unknown.read_bytes()
    unknown.write_bytes(data[:20] + b"\x33\x33" + data[22:])  # the codec's number
    with refuses("audio.unreadable", file=unknown):
        SoundFile(unknown)


def test_encoding_is_exact_in_time_and_reproducible(tmp_path: Path) -> None:
    sound = clicks(1.2345, [0.0, 0.7, 1.2], channels=2)
    for name in ("a.m4a", "b.m4a"):
        blocks = np.array_split(sound, 7)
        assert encode_sound(blocks, str(tmp_path / name), SAMPLE_RATE, 2) == len(sound)
    assert (tmp_path / "a.m4a").read_bytes() == (tmp_path / "b.m4a").read_bytes()
    with av.open(str(tmp_path / "a.m4a")) as container:
        assert container.streams.audio[0].codec_context.profile == "LC"
        decoded = np.concatenate([frame.to_ndarray() for frame in container.decode(audio=0)], axis=1).T
    assert len(decoded) >= len(sound)
    assert click_times(decoded) == pytest.approx([0.0, 0.7, 1.2], abs=0.0005)
    assert np.abs(decoded[: len(sound)] - sound).max() < 0.2


def test_a_playlist_with_the_name_of_a_sound_is_refused(tmp_path: Path) -> None:
    write_wav(tmp_path / "real.wav", clicks(0.2, []))
    trap = tmp_path / "sound.wav"
    trap.write_text("ffconcat version 1.0\nfile real.wav\n")
    with refuses("audio.unreadable", file=trap):
        SoundFile(trap)


def test_samples_that_are_not_numbers_are_silent(tmp_path: Path) -> None:
    samples = clicks(0.2, [0.1]).T.copy()
    samples[:, 100:200] = np.nan
    path = tmp_path / "nan.wav"
    with av.open(str(path), "w", format="wav") as out:
        stream = out.add_stream("pcm_f32le", rate=48_000, layout="mono")
        frame = av.AudioFrame.from_ndarray(samples, format="flt", layout="mono")
        frame.sample_rate = 48_000
        out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    blocks = np.concatenate([block for _, block in SoundFile(path).blocks()])
    assert np.isfinite(blocks).all()
    assert encode_sound([blocks], str(tmp_path / "out.m4a"), 48_000, 1) == len(blocks)
