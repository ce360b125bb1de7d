"""The bake stage with sound: only the sound is made again when only the sound has changed."""

import json
import shutil

import pytest

from studio.stream import StreamReader
from tests.support.events import result_of
from tests.support.sounds import click_times, clicks, write_wav


@pytest.fixture
def take(finished, tmp_path):
    shutil.copytree(finished, tmp_path / "project")
    write_wav(wav(tmp_path / "project" / "take"), clicks(0.3, [0.08]))
    return tmp_path / "project" / "take"


def wav(take):
    return take.parent / "take.wav"


def done(result):
    assert result.returncode == 0, result.stderr
    return result


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


def test_only_the_sound_is_baked_again(here, take):
    done(here("bake", take, "--capture.audio", wav(take)))
    assert heard(take) == pytest.approx([0.08], abs=0.0005)
    frames = inodes(take)
    result = done(here("bake", take, "--capture.audio_offset", "0.04", "--json"))
    assert heard(take) == pytest.approx([0.12], abs=0.0005)
    assert inodes(take) == frames
    events = [json.loads(line) for line in result.stdout.splitlines()]
    warned = [event for event in events if event.get("code") == "bake.short_sound"]
    assert not warned  # 0.04 s of silence are not worth a warning
    stages = result_of(done(here("status", take, "--json")).stdout)["stages"]
    assert {stages[name]["state"] for name in ("calibrate", "initialize", "train", "bake")} == {"done"}

    assert "up to date" in done(here("bake", take)).stdout.lower()
    write_wav(wav(take), clicks(0.1, [0.05]))
    result = done(here("bake", take, "--capture.audio_offset", "0", "--json"))
    assert heard(take) == pytest.approx([0.05], abs=0.0005)
    assert "bake.short_sound" in result.stdout
    done(here("bake", take, "--capture.audio", "null"))
    with StreamReader.open(take / "stream") as reader:
        assert reader.audio is None
    assert inodes(take) == frames
    assert not list((take / "stream" / "files").glob("*.m4a"))
