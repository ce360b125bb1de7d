"""Reading a stream: checked files to planes to Gaussians, exactly the inverse of baking."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from types import TracebackType

import numpy as np

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.stream.layout import ComponentArrays
from studio.stream.manifest import MANIFEST_NAME, MAX_MANIFEST_BYTES, GroupEntry, Manifest, parse_manifest
from studio.stream.quantise import LEVELS_8, LEVELS_16, dequantise, join_bytes
from studio.stream.source import FolderSource, Source
from studio.stream.video import PlaneDecoder


def fetch_group(source: Source, group: GroupEntry) -> dict[str, bytes]:
    """All files of a group, each checked for its size and SHA-256.

    Raises:
        StudioError: names the file that is missing, has another size or other bytes.
    """
    files: dict[str, bytes] = {}
    for plane in group.planes:
        data = source.read(plane.path, plane.bytes)
        name = f"{source.name}/{plane.path}"
        if len(data) != plane.bytes:
            raise StudioError(
                f"{name}: {len(data)} bytes found, the manifest says {plane.bytes}; bake or fetch it again."
            )
        if hashlib.sha256(data).hexdigest() != plane.sha256:
            raise StudioError(f"{name}: the bytes do not fit their SHA-256; bake or fetch it again.")
        files[plane.path] = data
    return files


class GroupDecoder:
    """Decodes one group's frames in order, all planes of a frame at once on a few threads.

    Args:
        group: its entry in the manifest.
        files: what `fetch_group` returned.
        pool: threads to decode on.
        name: the stream, for messages.
    """

    def __init__(self, group: GroupEntry, files: Mapping[str, bytes], pool: ThreadPoolExecutor, name: str) -> None:
        self.group = group
        self.next_frame = group.first_frame
        """Index in the stream of the frame that `read` gives next."""
        self._pool = pool
        # Opening decodes each file's first picture to learn what it is, so it is worth the threads, too.
        opening = [
            pool.submit(PlaneDecoder, files[plane.path], f"{name}/{plane.path}", group.side) for plane in group.planes
        ]
        wait(opening)
        self._decoders = [future.result() for future in opening if future.exception() is None]
        for future in opening:
            if (error := future.exception()) is not None:
                self.close()
                raise error

    def read(self) -> np.ndarray:
        """The next frame's planes, (P, side, side) uint8 in the order of `group.planes`.

        Raises:
            StudioError: a file is damaged, or there is no further frame in the group.
        """
        if self.next_frame >= self.group.end_frame:
            raise StudioError(
                f"Group {self.group.index} has {self.group.frame_count} frames; there is none after them."
            )
        planes = np.empty((len(self._decoders), self.group.side, self.group.side), dtype=np.uint8)
        reading = [
            self._pool.submit(decoder.read, plane) for decoder, plane in zip(self._decoders, planes, strict=True)
        ]
        wait(reading)  # all of them, before an error of one is raised: the caller may then close the decoders
        for future in reading:
            future.result()
        self.next_frame += 1
        return planes

    def close(self) -> None:
        """Free the decoders."""
        for decoder in self._decoders:
            decoder.close()
        self._decoders = []


def dequantise_planes(group: GroupEntry, planes: np.ndarray) -> Gaussians:
    """One frame's planes to Gaussians.

    Args:
        group: ranges and layout.
        planes: (P, side, side) uint8 from `GroupDecoder.read`.

    Returns:
        Gaussians in the stream's order (Morton order of the keyframe), float32 on the CPU.
    """
    flat = planes.reshape(len(planes), -1)[:, : group.splats]
    arrays = ComponentArrays(group.splats, group.sh_degree)
    index = 0
    for row, entry in zip(arrays.rows, group.components, strict=True):
        if len(entry.planes) == 1:
            row[:] = dequantise(flat[index], entry.min, entry.max, LEVELS_8)
        else:
            mirrored = entry.planes[1].part == "low_mirrored"
            row[:] = dequantise(join_bytes(flat[index], flat[index + 1], mirrored), entry.min, entry.max, LEVELS_16)
        index += len(entry.planes)
    return arrays.gaussians()


class StreamReader:
    """Random and sequential access to a stream's frames. Thread safe; frames in order are decoded once each.

    Use as a context manager, or `close` it.
    """

    def __init__(self, source: Source, manifest: Manifest, threads: int = 0) -> None:
        self.source = source
        self.manifest = manifest
        self._pool = ThreadPoolExecutor(threads or os.cpu_count() or 1, thread_name_prefix="decode")
        self._lock = threading.Lock()
        self._decoder: GroupDecoder | None = None
        self._files: tuple[int, dict[str, bytes]] | None = None

    @classmethod
    def open(cls, source: Path | str | Source, threads: int = 0) -> StreamReader:
        """Read and check the manifest of a stream.

        Args:
            source: the stream's folder, or another source.
            threads: decoding threads; 0 means one a core.

        Raises:
            StudioError: no manifest there, or one that is damaged, newer than this program, or out of bounds.
        """
        if isinstance(source, str | Path):
            if not Path(source).is_dir():
                raise StudioError(f"{source}: there is no such folder; give the folder of a baked stream.")
            source = FolderSource(source)
        data = source.read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
        return cls(source, parse_manifest(data, f"{source.name}/{MANIFEST_NAME}"), threads)

    @property
    def frame_count(self) -> int:
        """Frames in the stream."""
        return self.manifest.frame_count

    @property
    def fps(self) -> float:
        """Frames a second to play at."""
        return self.manifest.fps

    def open_group(self, group: GroupEntry, files: Mapping[str, bytes] | None = None) -> GroupDecoder:
        """A decoder at the group's first frame, from files fetched before or from the source (checked)."""
        return GroupDecoder(group, files or fetch_group(self.source, group), self._pool, self.source.name)

    def gaussians(self, frame: int) -> Gaussians:
        """One frame, 0-based. Frames in order cost one decoded picture each, others start at their group's keyframe.

        Raises:
            StudioError: no such frame, or its group is missing or damaged.
        """
        group = self.manifest.group_of(frame)
        with self._lock:
            decoder = self._decoder
            if decoder is None or decoder.group.index != group.index or decoder.next_frame > frame:
                self._drop_decoder()
                if self._files is None or self._files[0] != group.index:
                    self._files = (group.index, fetch_group(self.source, group))
                decoder = self._decoder = self.open_group(group, self._files[1])
            try:
                while True:
                    planes = decoder.read()
                    if decoder.next_frame > frame:
                        break
            except BaseException:
                self._drop_decoder()
                raise
        return dequantise_planes(group, planes)

    def iterate(self, start: int = 0, stop: int | None = None) -> Iterator[Gaussians]:
        """Frames `start` to `stop` (exclusive; all by default), in order."""
        for frame in range(start, self.frame_count if stop is None else min(stop, self.frame_count)):
            yield self.gaussians(frame)

    def verify(self) -> None:
        """Check size and SHA-256 of every file. Raises StudioError at the first that does not fit."""
        for group in self.manifest.groups:
            fetch_group(self.source, group)

    def _drop_decoder(self) -> None:
        if self._decoder is not None:
            self._decoder.close()
            self._decoder = None

    def close(self) -> None:
        """Free decoders and threads."""
        with self._lock:
            self._drop_decoder()
            self._files = None
        self._pool.shutdown(wait=True)

    def __enter__(self) -> StreamReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
