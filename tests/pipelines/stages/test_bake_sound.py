"""The bake stage with sound: only the sound is made again when only the sound has changed."""

import pytest

from studio.stream import StreamReader
from tests.support.sounds import click_times, clicks, write_wav


def heard(take):
    with StreamReader.open(take / "stream") as reader:
        reader.verify()
        sound = reader.sound()
        assert sound.samples == 5 * 48_000 // 25
        times = click_times(sound.read(0, sound.samples))
        sound.close()
    return times


def inodes(take):
    names = {path.name: path.stat().st_ino for path in (take / "stream" / "files").iterdir()}
    return {name: inode for name, inode in names.items() if not name.endswith(".m4a")}


def test_only_the_sound_is_baked_again(here, copied):
    take, wav = copied / "take", copied / "take.wav"
    write_wav(wav, clicks(0.3, [0.08]))
    here("bake", take, "--capture.audio", wav).ok()
    assert heard(take) == pytest.approx([0.08], abs=0.0005)
    frames = inodes(take)
    result = here("bake", take, "--capture.audio_offset", "0.04", "--json").ok()
    assert heard(take) == pytest.approx([0.12], abs=0.0005)
    assert inodes(take) == frames
    assert "bake.short_sound" not in result.stdout, "0.04 s of silence are not worth a warning"
    stages = here("status", take, "--json").ok().result["stages"]
    assert {stages[name]["state"] for name in ("calibrate", "initialize", "train", "bake")} == {"done"}

    assert "up to date" in here("bake", take).ok().stdout.lower()
    write_wav(wav, clicks(0.1, [0.05]))
    result = here("bake", take, "--capture.audio_offset", "0", "--json").ok()
    assert heard(take) == pytest.approx([0.05], abs=0.0005)
    assert "bake.short_sound" in result.stdout
    here("bake", take, "--capture.audio", "null").ok()
    with StreamReader.open(take / "stream") as reader:
        assert reader.audio is None
    assert inodes(take) == frames
    assert not list((take / "stream" / "files").glob("*.m4a"))
