import hashlib
import shutil
import threading
from pathlib import Path

from tests.support.streams import bake_numbered
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import BakeSettings, StreamReader, write_manifest

SETTINGS = BakeSettings(quality=20, preset="ultrafast")


class Rebaked:
    """The stream of a take that two bakes take turns to replace, as the stage does; each bake has its own manifest."""

    def __init__(self, folder: Path) -> None:
        self._bakes = [bake_numbered(folder / name, (2, 2), 25, n, SETTINGS) for name, n in (("a", 60), ("b", 90))]
        self.stream = folder / "take" / "stream"
        self.known = {frames_of(bake) for bake in self._bakes}  # of either bake
        assert len(self.known) == 2
        shutil.copytree(self._bakes[0], self.stream)

    def bake(self, number: int) -> None:
        """Replace the stream by the other bake: first its files, then its manifest."""
        bake = self._bakes[number % 2]
        shutil.copytree(bake / "files", self.stream / "files", dirs_exist_ok=True)
        with StreamReader.open(bake) as reader:
            groups = [reader.index.group(number) for number in range(len(reader.index))]
        write_manifest(self.stream, groups, 25, SETTINGS, {"round": number})


def frames_of(place: Path | str) -> str:
    """SHA-256 of the numbers of all frames, with the last one first, so that both groups are read."""
    found = hashlib.sha256()
    with StreamReader.open(place) as reader:
        for frame in (3, 0, 1, 2):
            for _, values in reader.gaussians(frame).items():
                found.update(values.numpy().tobytes())
    return found.hexdigest()


def test_readers_get_one_bake_or_a_sentence(tmp_path: Path) -> None:
    rebaked, done = Rebaked(tmp_path), threading.Event()
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
        for number in range(1, 31):
            rebaked.bake(number)
    finally:
        done.set()
        for reader in readers:
            reader.join()
    read.append(frames_of(rebaked.stream))
    assert set(read) <= rebaked.known
    assert set(refused) <= {"stream.replaced"}
