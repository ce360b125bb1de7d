"""Streams for tests: baked from numbered frames, changed and signed again, damaged."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from studio.audio import SoundFile, cut_sound
from studio.gaussians import Gaussians
from studio.stream import BakeSettings, bake_group, bake_sound, write_manifest
from tests.support.sounds import write_wav


def bake_numbered(
    folder: Path,
    lengths: Sequence[int],
    fps: float,
    splats: int = 40,
    settings: BakeSettings | None = None,
    sound: np.ndarray | None = None,
) -> Path:
    """A stream with groups of these lengths. Splat 0 of frame i is at x = i, which identifies the frame. With `sound`,
    (samples, channels) at 48 kHz, for version 3."""
    settings = settings or BakeSettings(profile="planes", qp=0)
    entries, first = [], 0
    for group, length in enumerate(lengths):
        frames = []
        for index in range(first, first + length):
            means = torch.zeros(splats, 3)
            means[:, 0] = index
            quats = torch.tensor([[1.0, 0, 0, 0]]).repeat(splats, 1)
            shape = -3 * torch.ones(splats, 3)
            frames.append(Gaussians(means, quats, shape, torch.zeros(splats), torch.zeros(splats, 1, 3)))
        entries.append(bake_group(frames, folder, group, first, settings))
        first += length
    audio = None
    if sound is not None:
        wav = SoundFile(write_wav(folder.with_suffix(".wav"), sound))
        audio = bake_sound(cut_sound(wav, 0, first / fps), folder)
    write_manifest(folder, entries, fps, settings, audio=audio)
    return folder


def edit_manifest(folder: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change the manifest's JSON, then update its size and checksum."""
    path = folder / "manifest.json"
    values = json.loads(path.read_bytes())
    change(values)
    write_signed(path, values, sum(group["bytes"] for group in values["groups"]))


def write_signed(path: Path, values: dict[str, Any], file_bytes: int) -> None:
    """Write a manifest with a fitting size and checksum; `file_bytes` is the size of all other files."""
    values["manifest_sha256"] = "0" * 64
    while True:
        data = json.dumps(values).encode()
        if values.get("total_bytes") == file_bytes + len(data):
            break
        values["total_bytes"] = file_bytes + len(data)
    path.write_bytes(data.replace(b"0" * 64, hashlib.sha256(data).hexdigest().encode(), 1))


def set_at(path: Sequence[Any], value: object) -> Callable[[dict[str, Any]], None]:
    """A change for `edit_manifest`: set the value at a path of keys."""

    def change(values: Any) -> None:
        for key in path[:-1]:
            values = values[key]
        values[path[-1]] = value

    return change


def replace_file(folder: Path, group: int, key: str, data: bytes, raw_bytes: int | None = None) -> None:
    """Replace the bytes of a group's `side` or `video` and update the checksums, as a faulty or malicious writer
    would."""

    def change(values: dict[str, Any]) -> None:
        entry = values["groups"][group][key]
        (folder / entry["path"]).write_bytes(data)
        values["groups"][group]["bytes"] += len(data) - entry["bytes"]
        entry["bytes"], entry["sha256"] = len(data), hashlib.sha256(data).hexdigest()
        if raw_bytes is not None:
            entry["raw_bytes"] = raw_bytes

    edit_manifest(folder, change)


def damage(file: Path, how: str) -> None:
    """Damage a file: "missing", "flipped" (a bit in the middle) or "truncated"."""
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 4
    if how == "missing":
        file.unlink()
    else:
        file.write_bytes(bytes(data) if how == "flipped" else bytes(data[:-9]))
