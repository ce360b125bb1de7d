"""Streams that are read while they are baked again: frames of one bake, or a sentence that says so."""

from __future__ import annotations

import hashlib
import shutil
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pipelines.share.serving import serve
from pipelines.stages.bake import BakeStage
from pipelines.takes.atomic_files import remove
from studio.errors import StudioError
from studio.stream import BakeSettings, StreamReader
from studio.stream.manifest import MANIFEST_NAME
from tests.support.errors import refuses
from tests.support.streams import bake_numbered, edit_manifest, set_at

KINDS = {
    "planes 2": BakeSettings(profile="planes", qp=0, preset="ultrafast", stream_version=2),
    "motion 2": BakeSettings(qp=20, preset="ultrafast", stream_version=2),
    "motion 3": BakeSettings(qp=20, preset="ultrafast"),
}


class Rebaked:
    """The stream of a take that two bakes take turns to replace, as the stage does it; every bake has its own manifest.

    Attributes:
        stream: its folder.
        known: SHA-256 of all frames of either bake.
    """

    def __init__(self, folder: Path, settings: BakeSettings) -> None:
        self.folder, self.version, self._round = folder, settings.stream_version, 0
        self.bakes = [
            bake_numbered(folder / name, (2, 2), 25, splats, settings) for name, splats in (("a", 60), ("b", 90))
        ]
        self.stream = folder / "take" / "stream"
        self.known = {frames_of(bake) for bake in self.bakes}
        assert len(self.known) == 2
        shutil.copytree(self.bakes[0], self.stream)

    def bake(self) -> None:
        """Replace the stream by the other bake."""
        self._round += 1
        new = self.folder / "take" / "work" / "stream"
        remove(new)
        shutil.copytree(self.bakes[self._round % 2], new)
        edit_manifest(new, set_at(("metadata",), {"round": self._round}))
        take = SimpleNamespace(stream=self.stream, work=lambda _: new.parent)
        context: Any = SimpleNamespace(take=take)
        stage = BakeStage()
        stage._update(context, new) if self.version == 3 else stage._put_in_place(context, new)


def frames_of(place: Path | str) -> str:
    """SHA-256 of the numbers of all frames, with the last one first, so that both groups are read."""
    found = hashlib.sha256()
    with StreamReader.open(place, threads=1) as reader:
        for frame in (3, 0, 1, 2):
            for _, values in reader.gaussians(frame).items():
                found.update(values.numpy().tobytes())
    return found.hexdigest()


@pytest.mark.parametrize("kind", KINDS)
def test_readers_get_one_bake_or_a_sentence(tmp_path: Path, kind: str) -> None:
    rebaked, done = Rebaked(tmp_path, KINDS[kind]), threading.Event()
    read: list[str] = []
    refused: list[str] = []

    def reads() -> None:
        while not done.is_set():
            try:
                read.append(frames_of(rebaked.stream))
            except StudioError as error:
                refused.append(error.code)

    readers = [threading.Thread(target=reads) for _ in range(2)]
    for reader in readers:
        reader.start()
    try:
        for _ in range(30):
            rebaked.bake()
    finally:
        done.set()
        for reader in readers:
            reader.join()
    read.append(frames_of(rebaked.stream))
    assert set(read) <= rebaked.known
    assert set(refused) <= {"stream.replaced"}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("served", [False, True])
def test_a_reader_of_the_old_bake_says_what_happened(tmp_path: Path, kind: str, served: bool) -> None:
    rebaked = Rebaked(tmp_path, KINDS[kind])
    with serve(rebaked.stream) as server:
        place = server.address if served else rebaked.stream
        with StreamReader.open(place, threads=1) as reader:
            reader.gaussians(0)
            rebaked.bake()
            with refuses("stream.replaced") as caught:
                reader.gaussians(2)
        assert str(caught.value).endswith(
            f"{MANIFEST_NAME}: the stream was baked again since it was opened. Open it again."
        )
        assert frames_of(place) in rebaked.known


def test_damage_is_still_called_damage(tmp_path: Path) -> None:
    stream = bake_numbered(tmp_path / "a", (2, 2), 25, settings=KINDS["motion 2"])
    with StreamReader.open(stream) as reader:
        (stream / "group_001" / "video.mp4").unlink()
        with refuses("source.file_missing"):
            reader.gaussians(2)
        (stream / MANIFEST_NAME).unlink()
        with refuses("source.file_missing"):
            reader.gaussians(2)


def test_where_folders_cannot_be_swapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rebaked = Rebaked(tmp_path, KINDS["motion 2"])
    monkeypatch.setattr("pipelines.stages.bake.exchange", lambda *_: False)
    rebaked.bake()
    assert frames_of(rebaked.stream) in rebaked.known
    assert sorted(path.name for path in (tmp_path / "take" / "work").iterdir()) == []
