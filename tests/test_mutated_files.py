"""Mutated files of every kind that people exchange: each is read, or rejected with a bounded sentence."""

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from tests.support.rigs import ring
from tests.support.sounds import write_wav
from tests.support.splats import converted_splats
from tests.support.streams import bake_numbered
from tests.support.tiny_capture import ROOT, SETTINGS
from v3studio.pipelines.config.loading import load_config, parse_override
from v3studio.pipelines.takes.authored.marks import read_marks
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, read_frame, write_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.audio import SoundFile
from v3studio.studio.calibration.manual.file import read_tie_points
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.capture.images import read_image
from v3studio.studio.capture.video import VideoReader
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import BakeSettings

Read = Callable[[Path], object]
EXTREMES = (
    *(b"1e400", b"-1e400", b"NaN", b"true", b"null", b'""', b"[]", b"{}", b"-5", b"1.9", b"9" * 5000, b"\x00", b"\xff"),
    *(b"[" * 20000, b"&a [*a,*a]", b"../../etc/passwd", b"\x1b[31m", b"20000", b"2147483648", b"18446744073709551616"),
)
LONGS = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x00FFFFFF)


def changed(data: bytes, number: int) -> bytes:
    """Mutation `number` of a file; always the same."""
    rng = random.Random(number)
    result = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        if not result:
            break
        at = rng.randrange(len(result))
        if rng.random() < 0.4:  # headers and the beginnings of texts decide most
            at = min(at, rng.randrange(min(len(result), 300)))
        kind = rng.randrange(6)
        if kind == 0:
            result[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            result[at : at + 4] = rng.choice(LONGS).to_bytes(4, rng.choice(("little", "big")))
        elif kind == 2:
            result[at : at + rng.randrange(1, 40)] = rng.choice(EXTREMES)
        elif kind == 3:
            del result[at : at + rng.choice((1, 4, 100, len(result)))]
        elif kind == 4:
            result[at:at] = result[at : at + rng.choice((1, 16, 500))]
        else:  # one value of a text
            end = next((i for i in range(at, len(result)) if result[i] in b",:]} \n"), len(result))
            result[at:end] = rng.choice(EXTREMES)
    return bytes(result)


def override(path: Path) -> object:
    """A setting as given on the command line."""
    return load_config(None, [parse_override(path.read_bytes().decode(errors="replace"))])


def first_frames(path: Path) -> None:
    """The first frames of a video."""
    reader = VideoReader(path)
    for index in range(min(reader.frame_count, 3)):
        reader.read(index)
    reader.close()


def sound(path: Path) -> None:
    """The sound of a file, at most a minute."""
    for number, _ in enumerate(SoundFile(path).blocks()):
        if number > 100:
            break


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, Read]]:
    """A valid file of each kind, and its reader."""
    folder = tmp_path_factory.mktemp("files")
    found: dict[str, tuple[Path, Read]] = {}

    def add(name: str, read: Read) -> Path:
        path = folder / str(len(found)) / name
        path.parent.mkdir()
        found[name] = path, read
        return path

    add("ball.yaml", load_config).write_text(SETTINGS)
    add("override", override).write_text("evaluate.background=[0.5, 0.25, 1.0]")
    for name in ("cameras.json", "calibration.csv", "Calib.toml", "transforms.json"):
        write_rig(ring(3), add(name, read_rig))
    shutil.copy(ROOT / "docs" / "tie_points.yaml", add("tie_points.yaml", read_tie_points))
    marks = {"marks": [{"frame": 1, "note": "here", "author": "me"}, {"frame": 2, "note": "there"}]}
    add("marks.json", read_marks).write_text(json.dumps(marks))
    Take.create(add("take.json", lambda path: Take.open(path.parent)).parent)
    write_frame(add("frame.safetensors", read_frame), converted_splats(0), FrameMetadata(key="k", step=1, frame=0))
    stream = bake_numbered(folder / "stream", (2,), 25, 40, BakeSettings(preset="ultrafast"))
    shutil.copy(next((stream / "files").glob("*.mp4")), add("cam.mp4", first_frames))
    image = Image.fromarray(np.random.RandomState(0).randint(0, 255, (40, 30, 3), np.uint8))
    for ending in ("png", "webp", "tiff", "jpg", "bmp"):
        image.save(add(f"a.{ending}", read_image))
    write_wav(add("a.wav", sound), np.random.RandomState(0).randn(4800, 2).astype(np.float32) / 9)
    return found


KINDS = (
    *("ball.yaml", "override", "cameras.json", "calibration.csv", "Calib.toml", "transforms.json", "tie_points.yaml"),
    *("marks.json", "take.json", "frame.safetensors", "cam.mp4", "a.png", "a.webp", "a.tiff", "a.jpg", "a.bmp"),
    "a.wav",
)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", KINDS)
@given(number=st.integers(0, 2**32))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_mutated_file_is_read_or_rejected(files: dict[str, tuple[Path, Read]], kind: str, number: int) -> None:
    path, read = files[kind]
    original = path.read_bytes()
    try:
        path.write_bytes(changed(original, number))
        read(path)
    except StudioError as error:
        text = str(error)
        assert len(text) <= 3000
        assert all(ord(letter) >= 32 or letter in "\n\t" for letter in text)
    finally:
        path.write_bytes(original)


def test_each_kind_is_tested_and_reads_as_it_is(files: dict[str, tuple[Path, Read]]) -> None:
    assert set(KINDS) == set(files)
    for path, read in files.values():
        read(path)
