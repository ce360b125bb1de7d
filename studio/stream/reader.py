"""Reading a stream: checked files to pictures to Gaussians, exactly the inverse of baking."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import TracebackType

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.stream.decode import GroupDecoder, open_decoder
from studio.stream.manifest import MANIFEST_NAME, Manifest, parse_manifest
from studio.stream.manifest_models import MAX_MANIFEST_BYTES, GroupEntry
from studio.stream.open_source import open_source
from studio.stream.source import Source, close_source, read_files


def fetch_group(source: Source, group: GroupEntry) -> dict[str, bytes]:
    """All files of a group, each checked for its size and SHA-256.

    Raises:
        StudioError: names the file that is missing, has another size or other bytes.
    """
    files = read_files(source, [(file.path, file.bytes) for file in group.files])
    for file in group.files:
        data = files[file.path]
        name = f"{source.name}/{file.path}"
        if len(data) != file.bytes:
            raise StudioError(
                f"{name}: {len(data)} bytes found, the manifest says {file.bytes}; bake or fetch it again."
            )
        if hashlib.sha256(data).hexdigest() != file.sha256:
            raise StudioError(f"{name}: the bytes do not fit their SHA-256; bake or fetch it again.")
    return files


class StreamReader:
    """Random and sequential access to a stream's frames. Thread safe; frames in order are decoded once each.

    Use as a context manager, or `close` it.
    """

    def __init__(self, source: Source, manifest: Manifest, threads: int = 0) -> None:
        self.source = source
        self.manifest = manifest
        self._threads = threads or os.cpu_count() or 1
        self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="decode")
        self._lock = threading.Lock()
        self._decoder: GroupDecoder | None = None
        self._files: tuple[int, dict[str, bytes]] | None = None
        self._owns_source = False

    @classmethod
    def open(cls, source: Path | str | Source, threads: int = 0) -> StreamReader:
        """Read and check the manifest of a stream.

        Args:
            source: the stream's folder, its http:// or https:// address, or another source (left open by `close`).
            threads: decoding threads; 0 means one a core.

        Raises:
            StudioError: no manifest there, or one that is damaged, newer than this program, or out of bounds.
        """
        opened = open_source(source)
        try:
            data = opened.read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
            reader = cls(opened, parse_manifest(data, f"{opened.name}/{MANIFEST_NAME}"), threads)
        except BaseException:
            if opened is not source:
                close_source(opened)
            raise
        reader._owns_source = opened is not source
        return reader

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
        files = files or fetch_group(self.source, group)
        return open_decoder(group, files, self._pool, self.source.name, self.manifest.codec.name, self._threads)

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
                    decoded = decoder.read()
                    if decoder.next_frame > frame:
                        break
            except BaseException:
                self._drop_decoder()
                raise
        return decoded.gaussians()

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

    def end_reads(self) -> None:
        """End what is being read from a source that `open` made; whoever waits for it gets a StudioError."""
        if self._owns_source:
            close_source(self.source)

    def close(self) -> None:
        """Free decoders and threads."""
        self.end_reads()  # before the lock, which whoever waits for the source holds
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
