"""Streams for tests: baked from numbered frames, changed and signed again, damaged."""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tests.support.sounds import write_wav
from v3studio.studio.audio import SoundFile, cut_sound
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream import BakeSettings, CapturePlace, StreamReader, bake_group, bake_sound, write_manifest


def bake_numbered(
    folder: Path,
    lengths: Sequence[int],
    fps: float,
    splats: int = 40,
    settings: BakeSettings | None = None,
    sound: np.ndarray | None = None,
    distinct: bool = False,
    live: bool = False,
) -> Path:
    """A stream with groups of these lengths. Splat 0 of frame i is at x = i, which identifies the frame. With `sound`,
    (samples, channels) at 48 kHz. With `distinct`, each group has a video of its own; otherwise groups
    of the same length share all files."""
    settings = settings or BakeSettings(quality=0, preset="ultrafast")
    entries, first = [], 0
    for group, length in enumerate(lengths):
        frames = []
        for index in range(first, first + length):
            means = torch.zeros(splats, 3)
            means[:, 0] = index
            quats = torch.tensor([[1.0, 0, 0, 0]]).repeat(splats, 1)
            shape = -3 * torch.ones(splats, 3)
            random = torch.Generator().manual_seed(group)
            seen = torch.randn(splats, generator=random) if distinct else torch.zeros(splats)
            frames.append(Gaussians(means, quats, shape, seen, torch.zeros(splats, 1, 3)))
        entries.append(bake_group(frames, folder, group, first, settings))
        first += length
    audio = None
    if sound is not None:
        wav = SoundFile(write_wav(folder.with_suffix(".wav"), sound))
        audio = bake_sound(cut_sound(wav, 0, first / fps), folder)
    write_manifest(folder, entries, fps, settings, audio=audio, live=live)
    return folder


def only(reader: StreamReader, rendition: str) -> StreamReader:
    """Let a reader read a rendition other than the best, by id."""
    number = [one.id for one in reader.manifest.renditions].index(rendition)
    setattr(reader, "group", lambda group: reader.index.group(group).renditions[number])  # noqa: B010
    return reader


def edit_manifest(folder: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change the manifest's JSON, then update its size and checksum."""
    path = folder / "manifest.json"
    values = json.loads(path.read_bytes())
    change(values)
    write_sealed(path, values)


def set_capture(folder: Path, place: CapturePlace) -> None:
    """Make a stream one that was baked from a trimmed or placed take."""
    edit_manifest(folder, lambda values: values.setdefault("metadata", {}).update(capture=place.to_json()))


def write_sealed(path: Path, values: dict[str, Any]) -> None:
    """Write a manifest with `total_bytes` and checksum that fit, as far as its values allow it. Each file counts once;
    groups in pages are left out."""
    sizes: dict[str, int] = {}
    stack: list[Any] = [values]
    while stack:
        item = stack.pop()
        if isinstance(item, dict):
            if isinstance(item.get("path"), str) and isinstance(item.get("bytes"), int):
                sizes[item["path"]] = item["bytes"]
            stack += item.values()
        elif isinstance(item, list):
            stack += item
    values["manifest_sha256"], data = "0" * 64, b""
    for _ in range(5):
        values["total_bytes"] = sum(sizes.values()) + len(data)
        data = json.dumps(values).encode()
    path.write_bytes(data.replace(b"0" * 64, hashlib.sha256(data).hexdigest().encode(), 1))


def set_at(path: Sequence[Any], value: object) -> Callable[[dict[str, Any]], None]:
    """A change for `edit_manifest`: set the value at a path of keys."""

    def change(values: Any) -> None:
        for key in path[:-1]:
            values = values[key]
        values[path[-1]] = value

    return change


def best_of(group: dict[str, Any]) -> dict[str, Any]:
    """The best rendition in a group's JSON in the manifest."""
    best: dict[str, Any] = group["renditions"][0]
    return best


def group_files(folder: Path, group: int) -> list[Path]:
    """A group's files in the best rendition: side file and video."""
    with StreamReader.open(folder) as reader:
        return [folder / file.path for file in reader.groups[group].files]


def video_file(folder: Path, group: int) -> Path:
    """A group's video in the best rendition."""
    return group_files(folder, group)[1]


def replace_file(folder: Path, group: int, key: str, data: bytes, raw_bytes: int | None = None) -> None:
    """Replace the bytes of a group's `side` or `video` in the best rendition and update name and checksums, as a faulty
    or malicious writer would."""

    def change(values: dict[str, Any]) -> None:
        best = best_of(values["groups"][group])
        entry = best[key]
        best["bytes"] += len(data) - entry["bytes"]
        put_file(folder, entry, data)
        if raw_bytes is not None:
            entry["raw_bytes"] = raw_bytes

    edit_manifest(folder, change)


def put_file(folder: Path, entry: dict[str, Any], data: bytes) -> None:
    """Store other content for a file of a stream, under its own name, and update its entry."""
    digest = hashlib.sha256(data).hexdigest()
    entry.update(path=f"files/{digest[:32]}.{entry['path'].rsplit('.', 1)[1]}", bytes=len(data), sha256=digest)
    (folder / entry["path"]).write_bytes(data)


def damage(file: Path, how: str) -> None:
    """Damage a file: "missing", "flipped" (a bit in the middle) or "truncated"."""
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 4
    if how == "missing":
        file.unlink()
    else:
        file.write_bytes(bytes(data) if how == "flipped" else bytes(data[:-9]))


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a folder by their path in it."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def flip(path: Path, place: int = -5) -> None:
    """Change one bit of a file."""
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)
