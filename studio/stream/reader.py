"""Reading a stream: verified files to decoded images to Gaussians, the exact inverse of baking."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path

from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.memory_cache import OnDemand
from v3studio.studio.stream.decoder import GroupDecoder
from v3studio.studio.stream.group_index import GroupIndex
from v3studio.studio.stream.manifest import (
    MANIFEST_NAME,
    MAX_MANIFEST_BYTES,
    FileEntry,
    Manifest,
    Rendition,
)
from v3studio.studio.stream.manifest_file import check_growth, parse_manifest
from v3studio.studio.stream.sound import StreamSound
from v3studio.studio.stream.sources.open_source import open_source
from v3studio.studio.stream.sources.source import Source, SourceUnavailable, damaged


def fetch_files(source: Source, files: Sequence[FileEntry]) -> dict[str, bytes]:
    """Content by path of files of a stream; StudioError for the first that is missing or has another size or SHA-256.
    Reads `source.parallel` files at once: over a network, most of the time of a small file is latency."""

    def checked(file: FileEntry) -> bytes:
        data, name = source.read(file.path, file.bytes), f"{source.name}/{file.path}"
        if len(data) != file.bytes:
            problem = f"the file has {len(data)} bytes, the manifest says {file.bytes}"
            raise damaged("stream.wrong_size", problem, name, len(data), expected=file.bytes)
        if hashlib.sha256(data).hexdigest() != file.sha256:
            raise damaged("stream.wrong_checksum", "SHA-256 differs from the manifest", name)
        return data

    if min(source.parallel, len(files)) == 1:
        return {file.path: checked(file) for file in files}
    pool = ThreadPoolExecutor(source.parallel, thread_name_prefix="fetch")
    try:
        reading = [pool.submit(checked, file) for file in files]
        return {file.path: future.result() for file, future in zip(files, reading, strict=True)}
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # after an error, do not wait for the other files


class StreamReader:
    """Random and sequential access to the frames of a stream. Thread safe. Sequential reads decode each frame once. Use
    it as a context manager, or call `close`.

    `manifest_bytes` are those of the manifest that `index` was read from. Copies of a stream use them: meanwhile
    another manifest may have replaced it.
    """

    def __init__(self, source: Source, data: bytes) -> None:
        self.source = source
        self._manifest_name = f"{source.name}/{MANIFEST_NAME}"
        self.index = self._indexed(data)
        self.manifest_bytes = data
        self._lock = threading.Lock()
        self._decoder: GroupDecoder | None = None
        self._files: tuple[Rendition, dict[str, bytes]] | None = None
        self._owns_source = False

    @classmethod
    def open(cls, source: Path | str | Source) -> StreamReader:
        """Read and validate the manifest of a stream.

        Example:
            >>> with v3.StreamReader.open("my-take/stream") as reader:
            ...     splats = reader.gaussians(0)
            >>> reader.frame_count, reader.fps, splats.means.shape[1]
            (5, 25.0, 3)

        Args:
            source: folder, file of a one-file stream, http(s) URL, or a `Source`, which `close` leaves open.

        Raises:
            StudioError: the manifest is missing, damaged, out of bounds or of another version.
        """
        opened = open_source(source)
        try:
            reader = cls(opened, opened.read(MANIFEST_NAME, MAX_MANIFEST_BYTES))
        except BaseException:
            if opened is not source:
                opened.close()
            raise
        reader._owns_source = opened is not source
        return reader

    def _indexed(self, data: bytes) -> GroupIndex:
        return GroupIndex(parse_manifest(data, self._manifest_name), self.source, self._reading)

    @property
    def manifest(self) -> Manifest:
        """The manifest as it was last read."""
        return self.index.manifest

    @property
    def groups(self) -> Sequence[Rendition]:
        """All groups in the best rendition; an item may be read from the source, with the errors of `group`."""
        return OnDemand(range(len(self.index)), self.group)

    @property
    def played_bytes(self) -> int:
        """Bytes that playing the best rendition takes, see `Manifest`."""
        return self.manifest.played_bytes()

    @property
    def live(self) -> bool:
        """Tell whether groups are still being added, so that `refresh` may find more."""
        return self.manifest.live

    def refresh(self) -> int:
        """Read the manifest of a live stream again, and return the number of new groups; known groups stay the same.
        StudioError as `open`, or `stream.live_changed`: the new manifest takes back what the old one published."""
        if not self.live:
            return 0
        data = self.source.read_changed(MANIFEST_NAME, MAX_MANIFEST_BYTES)
        if data is None:
            return 0
        index = self._indexed(data)
        check_growth(self.manifest, index.manifest, self._manifest_name)
        with self._lock:
            grown = len(index) - len(self.index)
            self.index, self.manifest_bytes = index, data
        return grown

    def fetch(self, group: Rendition) -> dict[str, bytes]:
        """Content by path of all files of a group, verified; StudioError: one is missing or damaged, or the stream was
        baked again since it was opened (`stream.replaced`)."""
        with self._reading():
            return fetch_files(self.source, group.files)

    def checked(self, file: FileEntry) -> bytes:
        """Content of one file, verified. Raises StudioError as `fetch`."""
        with self._reading():
            return fetch_files(self.source, (file,))[file.path]

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Distinguishes damaged files from those of another bake, which has replaced the stream since it was opened."""
        try:
            yield
        except SourceUnavailable:
            raise
        except StudioError:
            if self._replaced():
                problem = "the stream was baked again since it was opened"
                raise StudioError("stream.replaced", problem, file=self._manifest_name, fix="Open it again.") from None
            raise

    def _replaced(self) -> bool:
        """Return whether there is another manifest now, which does not only add groups."""
        try:
            data = self.source.read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
            if data == self.manifest_bytes:
                return False
            new = parse_manifest(data, self._manifest_name)
        except StudioError:
            return False  # nothing that could be opened instead
        if not self.live:
            return True
        try:
            check_growth(self.manifest, new, self._manifest_name)
        except StudioError:
            return True
        return False

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """All files of the stream but the manifest, of all renditions, each once, in the order in which a player needs
        them; reads all pages of the index. Raises StudioError: a page is missing or damaged."""
        first, *others = map(self.index.files, range(len(self.index)))
        fixed = (file for file in self.manifest.fixed_files if file not in self.manifest.pages)
        return tuple({file.path: file for file in (*first, *fixed, *(file for own in others for file in own))}.values())

    def group(self, number: int) -> Rendition:
        """Group `number` in the best rendition. StudioError if its page of the index is missing or damaged."""
        return self.index.group(number).renditions[0]

    def group_of(self, frame: int) -> Rendition:
        """The group that contains a frame, in the best rendition; reads the page of that group alone. StudioError if
        there is no such frame, or the page is missing or damaged."""
        return self.group(self.index.group_of(frame))

    def set_splats(self) -> Gaussians | None:
        """The splats behind the performer in all frames, fetched and decoded now; None for a stream without them.
        StudioError if a file is missing or damaged."""
        decoded = []
        for part in self.manifest.set:
            with closing(self.open_group(part)) as decoder:
                decoded.append(decoder.read().gaussians())
        return Gaussians.cat(*decoded) if decoded else None

    def audio_bytes(self) -> bytes:
        """The sound's file, an MP4 with one AAC track. StudioError: none (`stream.no_sound`), or it is damaged."""
        entry = self.manifest.audio
        if entry is None:
            raise StudioError("stream.no_sound", "the stream has no sound", file=self.source.name)
        return self.checked(entry)

    def sound(self) -> StreamSound | None:
        """The decoded sound, for random access; the caller closes it. None for silent streams. StudioError if the file
        is missing, damaged or not what the manifest says."""
        entry = self.manifest.audio
        if entry is None:
            return None
        return StreamSound(self.audio_bytes(), entry, f"{self.source.name}/{entry.path}")

    @property
    def frame_count(self) -> int:
        """Frames in the stream."""
        return self.manifest.frame_count

    @property
    def fps(self) -> float:
        """Frame rate of playback, in frames per second."""
        return self.manifest.fps

    def open_group(self, group: Rendition, files: Mapping[str, bytes] | None = None) -> GroupDecoder:
        """A decoder at the first frame of the group, from `files` as `fetch` returns them, or fetched now."""
        return GroupDecoder(group, files or self.fetch(group), self.source.name, os.cpu_count() or 1)

    def gaussians(self, frame: int) -> Gaussians:
        """One frame, 0-based. The next frame costs one decoded image; seeking decodes from the group's keyframe.
        StudioError if there is no such frame, or a file of its group is missing or damaged."""
        group = self.group_of(frame)
        with self._lock:
            decoder = self._decoder
            if decoder is None or decoder.group.index != group.index or decoder.next_frame > frame:
                self._drop_decoder()
                if self._files is None or self._files[0] is not group:
                    self._files = (group, self.fetch(group))
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

    def _drop_decoder(self) -> None:
        if self._decoder is not None:
            self._decoder.close()
            self._decoder = None

    def end_reads(self) -> None:
        """Abort reads from a source that `open` created; threads that wait for them get a StudioError."""
        if self._owns_source:
            self.source.close()

    def close(self) -> None:
        """Release the decoder."""
        self.end_reads()  # before taking the lock: a thread that waits for the source holds it
        with self._lock:
            self._drop_decoder()
            self._files = None

    def __enter__(self) -> StreamReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
