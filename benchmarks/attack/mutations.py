"""Mutated files of every kind that people exchange, read by the library in processes with bounded memory."""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import resource
import shutil
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import hostile_reader
import numpy as np
import torch
from hostile_streams import mutate, read_stream
from outcome import Outcome
from PIL import Image

from pipelines.config.loading import load_config, parse_override
from pipelines.takes.frame_files import FrameMetadata, read_frame, write_frame
from pipelines.takes.marks import read_marks
from pipelines.takes.records import read_record
from pipelines.takes.take import Take
from pipelines.takes.videos import decoded_video
from studio.audio import SoundFile
from studio.calibration.manual.file import read_tie_points
from studio.camera_files import read_rig, write_rig
from studio.capture.images import read_image
from studio.capture.settings import OnnxSettings
from studio.capture.video import VideoReader
from studio.errors import StudioError
from studio.export.videogs import export_videogs
from studio.gaussians import Gaussians
from studio.imports import open_import
from studio.masks.onnx_model import OnnxModel
from studio.splat_files import READERS, ending_of, write_splats
from studio.stream import BakeSettings, StreamReader
from tests.support.rigs import ring
from tests.support.sounds import write_wav
from tests.support.splats import converted_splats
from tests.support.streams import bake_numbered
from tests.support.tiny_capture import ROOT, SETTINGS

MEMORY = 3 << 30
"""Bytes of address space that a process may take beyond what it has with all libraries loaded."""

BATCH = 500
"""Mutations that one process reads; a crash ends the batch."""

PATIENCE = 60.0
"""Seconds per mutation, on a busy machine, after which it counts as hanging."""

MODELS = ROOT / "tests" / "studio" / "masks" / "data"
NO_MODELS = {
    "an empty file": b"",
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(1000),
    "a script": b"#!/bin/sh\necho hello\n",
    "zeros": bytes(1 << 20),
    "a pickle": b"cos\nsystem\n(S'true'\ntR.",
    "lengths without end": b"\x3a\xff\xff\xff\xff\x0f" * 1000,
}
"""Files that are named like a model."""

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
        kind = rng.randrange(7)
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
        elif kind == 5:
            result[at : at + 8] = rng.randbytes(rng.randrange(20))
        else:  # one value of a text
            end = next((i for i in range(at, len(result)) if result[i] in b",:]} \n"), len(result))
            result[at:end] = rng.choice(EXTREMES)
    return bytes(result)


class Kind:
    """Files of one kind: a folder with what belongs together, the file of it that is changed, and its reader."""

    def __init__(self, name: str, folder: Path, file: str, read: Callable[[Path], object]) -> None:
        self.name, self.folder, self.file, self.read = name, folder, file, read


def kinds(folder: Path) -> list[Kind]:
    """Valid files of all kinds, written below a folder."""
    found: list[Kind] = []

    def add(name: str, file: str, read: Callable[[Path], object]) -> Path:
        place = folder / name.replace(" ", "_")
        place.mkdir(parents=True, exist_ok=True)
        found.append(Kind(name, place, file, read))
        return place

    (add("config", "ball.yaml", load_config) / "ball.yaml").write_text(SETTINGS)
    (add("override", "text", override) / "text").write_text("capture.background=[0.5, 0.25, 1.0]")
    for file in ("cameras.json", "calibration.csv", "Calib.toml", "transforms.json"):
        place = add(f"cameras {file}", file, read_rig)
        write_rig(ring(3), place / file)
    shutil.copy(ROOT / "docs" / "tie_points.yaml", add("tie points", "tie_points.yaml", read_tie_points))
    marks = {"marks": [{"frame": 1, "note": "here", "author": "me"}, {"frame": 2, "note": "there"}]}
    (add("marks", "marks.json", read_marks) / "marks.json").write_text(json.dumps(marks))
    add("take", "take.json", lambda path: Take.open(path.parent))
    Take.create(found[-1].folder)
    record = {
        "format": 4,
        "stage": "train",
        "params": {},
        "files": {"a": 1},
        "digests": {"a": "b"},
        "written": {"a": 1},
    }
    place = add("record", ".v3studio/stages/train.json", lambda path: read_record(Take.open(path.parents[2]), "train"))
    Take.create(place).record("train").parent.mkdir(parents=True, exist_ok=True)
    (place / ".v3studio" / "stages" / "train.json").write_text(json.dumps(record))
    for file in sorted((ROOT / "tests" / "data" / "splats").iterdir()):
        if file.is_file() and ending_of(file) in READERS:
            shutil.copy(file, add(f"splats {file.name}", file.name, drawable_splats))
    place = add("splats plain.ply", "plain.ply", drawable_splats)
    write_splats(place / "plain.ply", converted_splats(1))
    write_frame(
        add("trained frame", "frame.safetensors", read_frame) / "frame.safetensors",
        converted_splats(0),
        FrameMetadata(key="k", step=1, frame=0),
    )
    settings = BakeSettings(preset="ultrafast")
    stream = bake_numbered(folder / "stream", (2,), 25, 40, settings)
    for file in ("group_info.json", "viewer_min_max.json", "group0/0.mp4"):
        place = add(f"VideoGS {file}", file, videogs)
        shutil.rmtree(place)
        with StreamReader.open(stream) as reader:
            export_videogs(decoded_video(reader), place, preset="ultrafast")
    video = next((stream / "files").glob("*.mp4"))
    shutil.copy(video, add("video", "cam.mp4", all_frames) / "cam.mp4")
    picture = Image.fromarray(np.random.RandomState(0).randint(0, 255, (40, 30, 4), np.uint8))
    for ending in ("png", "webp", "tiff", "jpg", "bmp"):
        part = picture if ending != "jpg" else picture.convert("RGB")
        part.save(add(f"image {ending}", f"a.{ending}", read_image) / f"a.{ending}")
    noise = np.random.RandomState(0).randn(4800, 2).astype(np.float32) / 9
    write_wav(add("sound", "a.wav", all_sound) / "a.wav", noise)
    return found


def override(path: Path) -> object:
    """A setting as given on the command line."""
    return load_config(None, [parse_override(path.read_bytes().decode(errors="replace"))])


def drawable_splats(path: Path) -> Gaussians:
    """Splats of a file; their numbers are finite or they are refused."""
    splats = READERS[ending_of(path)](path)
    for name, values in splats.items():
        if not bool(torch.isfinite(values).all()):
            raise ValueError(f"{name} are not finite")
    return splats


def videogs(path: Path) -> None:
    """All frames of a VideoGS folder."""
    place = path.parent if path.parent.name.startswith("VideoGS") else path.parent.parent
    video = open_import(place)
    for index in range(min(video.frame_count, 10)):
        video.read(index)


def all_frames(path: Path) -> None:
    """The first frames of a video."""
    reader = VideoReader(path)
    for index in range(min(reader.frame_count, 5)):
        reader.read(index)
    reader.close()


def all_sound(path: Path) -> None:
    """The sound of a file, at most a minute."""
    for number, _ in enumerate(SoundFile(path).blocks()):
        if number > 1000:
            break


def batches(total: int) -> Iterator[range]:
    """Mutation numbers, in batches."""
    for first in range(0, total, BATCH):
        yield range(first, min(first + BATCH, total))


def bound_process(memory: int) -> None:
    """Let this process grow by this many bytes at most, without warnings."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGESIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
    warnings.simplefilter("ignore")


def in_process(work: Callable[[int], str], numbers: range, outcome: Outcome, found: Counter[str]) -> None:
    """Do `work` for all numbers in a forked process with bounded memory; what it raises is a broken promise."""
    receive, send = multiprocessing.Pipe(duplex=False)

    def run() -> None:
        receive.close()
        bound_process(MEMORY)
        for number in numbers:
            send.send((number, None))
            try:
                send.send((number, work(number)))
            except BaseException:
                send.send((number, f"WRONG {traceback.format_exc(limit=-4)}"))

    process = multiprocessing.get_context("fork").Process(target=run)
    process.start()
    send.close()
    last = numbers[0]
    try:
        while True:
            if not receive.poll(PATIENCE):
                outcome.failed(f"mutation {last} hangs")
                process.kill()
                break
            last, result = receive.recv()
            if result is None:
                continue
            outcome.count += 1
            if result.startswith("WRONG"):
                outcome.failed(f"mutation {last}: {result}")
            else:
                found[result] += 1
    except EOFError:
        pass
    process.join()
    if process.exitcode not in (0, -9):
        outcome.failed(f"mutation {last}: the process ended with {process.exitcode}")


def summary(found: Counter[str]) -> str:
    """What happened, in words."""
    refused = sum(count for name, count in found.items() if name.startswith("refused"))
    return f"{found.total() - refused:,} read, {refused:,} refused with {len(found) - 1} kinds of sentences"


def checked_sentence(error: StudioError) -> str:
    """The code; raises ValueError for a sentence that is not bounded or has control characters."""
    text = str(error)
    if len(text) > 3000 or any(ord(letter) < 32 and letter not in "\n\t" for letter in text):
        raise ValueError(f"a sentence of {len(text)} characters, or with control characters: {text[:300]!r}")
    return f"refused {error.code}"


def files(folder: Path, total: int, outcome: Outcome) -> None:
    """`total` mutations over all kinds of files, the same number of each."""
    mutated(kinds(folder / "files"), total, outcome)


def models(folder: Path, total: int, outcome: Outcome) -> None:
    """`total` mutations of matting models, and files that are none."""
    every = []
    for path in sorted(MODELS.glob("*.onnx")):
        if path.name in ("free.onnx", "fixed.onnx"):
            (folder / "models").mkdir(exist_ok=True)
            shutil.copy(path, folder / "models")
            every.append(Kind(path.name, folder / "models", path.name, mask))
    mutated(every, total, outcome)
    for name, content in NO_MODELS.items():
        path = folder / "models" / "none.onnx"
        path.write_bytes(content)
        found: Counter[str] = Counter()
        in_process(lambda _, path=path: refusal(mask, path), range(1), outcome, found)
        if not outcome.wrong and not next(iter(found)).startswith("refused"):
            outcome.failed(f"{name} was taken for a model")


def mask(path: Path) -> None:
    """A mask of a small picture."""
    OnnxModel(path, OnnxSettings(mask_model_mean=(0, 0, 0), mask_model_std=(1, 1, 1)), device="cpu", threads=1)(
        np.zeros((64, 64, 3), np.uint8)
    )


def refusal(read: Callable[[Path], object], path: Path) -> str:
    """ "read", or the code of the sentence with which a file is refused."""
    try:
        read(path)
        return "read"
    except StudioError as error:
        return checked_sentence(error)


def mutated(every: list[Kind], total: int, outcome: Outcome) -> None:
    """`total` mutations over some kinds of files, the same number of each."""
    found: Counter[str] = Counter()

    def work(number: int) -> str:
        kind = every[number % len(every)]
        file = kind.folder / kind.file
        original = originals[kind.name]
        try:
            file.write_bytes(changed(original, number))
            return refusal(kind.read, file)
        except BaseException as error:
            error.add_note(f"in {kind.name}")
            raise
        finally:
            file.write_bytes(original)

    originals = {kind.name: (kind.folder / kind.file).read_bytes() for kind in every}
    for kind in every:
        kind.read(kind.folder / kind.file)  # what is not mutated is read
    for numbers in batches(total):
        in_process(work, numbers, outcome, found)
    outcome.note(summary(found))


def streams(folder: Path, total: int, outcome: Outcome) -> None:
    """`total` mutations of a small stream with sound, as `hostile_reader.py` makes them."""
    sound = np.random.RandomState(0).randn(9600, 1).astype(np.float32) / 9
    original = read_stream(bake_numbered(folder / "stream", (3, 2), 25, 60, BakeSettings(preset="ultrafast"), sound))
    found: Counter[str] = Counter()

    def work(number: int) -> str:
        sounds = number % hostile_reader.SOUND_SHARE == 0
        return hostile_reader.read_all(
            hostile_reader.mutated_sound(original, number) if sounds else mutate(original, number)[1]
        )

    for numbers in batches(total):
        in_process(work, numbers, outcome, found)
    outcome.note(summary(found))
