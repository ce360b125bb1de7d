"""Sound in a stream: in the manifest, read back at any place, carried by what carries the stream."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.studio.stream.conftest import FindStream, MakeLadder
from tests.support.errors import refuses
from tests.support.sounds import click_times
from tests.support.streams import put_file, write_sealed
from v3studio.studio.stream import StreamReader, check_stream

CLICKS = [0.2, 0.7, 1.1]


@pytest.fixture
def stream(make_ladder: MakeLadder) -> Path:
    """30 frames at 25 fps with clicks in frames 5, 17 and 27."""
    return make_ladder((15, 15), splats=30, degree=0, ladder=(), quality=34, clicks=CLICKS)


def test_sound_in_the_manifest_and_decoded(stream: Path) -> None:
    with StreamReader.open(stream) as reader:
        entry = reader.manifest.audio
        assert (entry.codec, entry.sample_rate, entry.channels, entry.start) == ("aac", 48_000, 2, 0)
        assert entry.samples == 30 * 48_000 // 25
        assert entry.path in {file.path for file in reader.files}
        assert not check_stream(reader).damage
        assert reader.played_bytes == sum(p.stat().st_size for p in stream.rglob("*") if p.is_file())
        sound = reader.sound()
        whole = sound.read(0, sound.samples)
        assert whole.shape == (57_600, 2)
        assert whole.dtype == np.float32
        assert click_times(whole) == pytest.approx(CLICKS, abs=0.0005)
        # any part, in any order, is the same as in the whole
        for first, count in ((40_000, 9000), (0, 1), (57_000, 600), (20_000, 1024), (21_024, 5000), (100, 30)):
            assert np.allclose(sound.read(first, count), whole[first : first + count], atol=1e-4), first
        around = sound.read(-100, 57_900)
        assert not around[:100].any()
        assert not around[-200:].any()
        assert np.allclose(around[100:-200], whole, atol=1e-4)
        for first in (-3000, 57_600, 100_000):
            assert not sound.read(first, 2000).any()
        sound.close()


def test_what_is_not_the_sound_of_the_manifest(stream: Path) -> None:
    path = stream / "manifest.json"
    kept = json.loads(path.read_bytes())
    for change in ({"sample_rate": 96_000}, {"channels": 1}):
        write_sealed(path, {**kept, "audio": kept["audio"] | change})
        with StreamReader.open(stream) as reader, refuses("stream.wrong_sound"):
            reader.sound()
    values = json.loads(json.dumps(kept))
    video = stream / values["groups"][0]["renditions"][0]["video"]["path"]
    put_file(stream, values["audio"], video.read_bytes())
    write_sealed(path, values)
    with StreamReader.open(stream) as reader, refuses("stream.wrong_sound"):
        reader.sound()
    write_sealed(path, {**kept, "audio": kept["audio"] | {"samples": 62_000}})  # within the tolerance, but not there
    with StreamReader.open(stream) as reader, refuses("stream.sound_damaged"):
        sound = reader.sound()
        sound.read(60_000, 2000)


def test_damaged_files_are_found(stream: Path) -> None:
    with StreamReader.open(stream) as reader:
        file = stream / reader.manifest.audio.path
        file.write_bytes(bytes(file.read_bytes()[:-1]) + b"x")
        for read in (reader.sound, reader.audio_bytes):
            with refuses("stream.wrong_checksum", file=f"{stream}/{reader.manifest.audio.path}"):
                read()
        (damage,) = check_stream(reader).damage
        assert (damage.file, damage.groups) == (reader.manifest.audio.path, ())


def test_streams_without_sound(intact: FindStream) -> None:
    with StreamReader.open(intact("motion")) as reader:
        assert reader.manifest.audio is None
        assert reader.sound() is None
        with refuses("stream.no_sound"):
            reader.audio_bytes()
