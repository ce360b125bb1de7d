"""Reading a stream: verified files to decoded pictures to Gaussians, the exact inverse of baking."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.stream.decode import GroupDecoder, open_decoder
from studio.stream.group_index import GroupIndex, no_such_rendition
from studio.stream.ladder_manifest import RenditionManifest, check_growth, fixed_files, parse_ladder
from studio.stream.ladder_models import AudioEntry, RenditionEntry
from studio.stream.manifest import MANIFEST_NAME, Manifest, parse_head, parse_manifest
from studio.stream.manifest_models import MAX_MANIFEST_BYTES, FileEntry, GroupEntry
from studio.stream.open_source import open_source
from studio.stream.sound import StreamSound
from studio.stream.source import BAKE_AGAIN, Source, SourceUnavailable, close_source, read_files


def fetch_group(source: Source, group: GroupEntry) -> dict[str, bytes]:
    """Content by path of all files of a group, verified against size and SHA-256.

    Raises:
        StudioError: a file is missing, has a different size or a different SHA-256.
    """
    files = read_files(source, [(file.path, file.bytes) for file in group.files])
    for file in group.files:
        check_file(files[file.path], file, source)
    return files


def checked_file(source: Source, file: FileEntry) -> bytes:
    """Content of one file of a stream, verified. Raises StudioError as `fetch_group`."""
    data = source.read(file.path, file.bytes)
    check_file(data, file, source)
    return data


def check_file(data: bytes, file: FileEntry, source: Source) -> None:
    """Raises StudioError unless the bytes have the size and the SHA-256 of the manifest."""
    name = f"{source.name}/{file.path}"
    if len(data) != file.bytes:
        raise StudioError(
            "stream.wrong_size",
            f"the file has {len(data)} bytes, the manifest says {file.bytes}",
            file=name,
            value=len(data),
            fix=BAKE_AGAIN,
            expected=file.bytes,
        )
    if hashlib.sha256(data).hexdigest() != file.sha256:
        raise StudioError("stream.wrong_checksum", "SHA-256 differs from the manifest", file=name, fix=BAKE_AGAIN)


class StreamReader:
    """Random and sequential access to the frames of a stream. Thread safe. Sequential reads decode each frame once.

    Use it as a context manager, or call `close`.

    Attributes:
        source: where the files come from.
        manifest: of the stream; in version 3, of the chosen rendition.
        index: version 3: all groups in all renditions; None in versions 1 and 2.
        manifest_bytes: of the manifest that `manifest` and `index` were read from; b"" if the reader was made without.
            Copies of a stream use them: meanwhile another manifest may have replaced it.
    """

    def __init__(self, source: Source, manifest: Manifest, threads: int = 0, index: GroupIndex | None = None) -> None:
        self.source = source
        self.manifest = manifest
        self.index = index
        self._threads = threads or os.cpu_count() or 1
        self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="decode")
        self._lock = threading.Lock()
        self._decoder: GroupDecoder | None = None
        self._files: tuple[GroupEntry, dict[str, bytes]] | None = None
        self._owns_source = False
        self.manifest_bytes = b""

    @classmethod
    def open(cls, source: Path | str | Source, threads: int = 0, rendition: str | None = None) -> StreamReader:
        """Read and validate the manifest of a stream.

        Args:
            source: folder, file of a one-file stream, http(s) URL, or a `Source` (which `close` leaves open).
            threads: decoding threads; 0 is one per core.
            rendition: id of the rendition to read; None: the best one.

        Raises:
            StudioError: the manifest is missing, damaged, out of bounds, or newer than this program, or there is no
                such rendition.
        """
        opened = open_source(source)
        try:
            data = opened.read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
            name = f"{opened.name}/{MANIFEST_NAME}"
            if parse_head(data, name).get("version") == 3:
                index = GroupIndex(parse_ladder(data, name), opened, len(data))
                reader = cls(opened, index.view(rendition), threads, index)
            else:
                if rendition is not None:
                    raise no_such_rendition(rendition, [], opened.name)
                reader = cls(opened, parse_manifest(data, name), threads)
        except BaseException:
            if opened is not source:
                close_source(opened)
            raise
        reader._owns_source = opened is not source
        reader.manifest_bytes = data
        if reader.index is not None:
            reader.index.reading = reader._reading
        return reader

    @property
    def renditions(self) -> tuple[RenditionEntry, ...]:
        """Renditions to choose from, the best first; empty in versions 1 and 2, which have one."""
        return () if self.index is None else self.index.manifest.renditions

    @property
    def live(self) -> bool:
        """Whether groups are still being added, so that `refresh` may find more."""
        return self.index is not None and self.index.manifest.live

    def refresh(self) -> int:
        """Read the manifest of a live stream again; frames of known groups stay the same.

        Returns:
            Number of new groups.

        Raises:
            StudioError: `stream.live_changed`: the new manifest takes back what the old one published; also as `open`.
        """
        if self.index is None or not self.index.manifest.live:
            return 0
        read = getattr(self.source, "read_changed", self.source.read)
        data = read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
        if data is None:
            return 0
        name = f"{self.source.name}/{MANIFEST_NAME}"
        old, new = self.index.manifest, parse_ladder(data, name)
        check_growth(old, new, name)
        index = GroupIndex(new, self.source, len(data))
        index.reading = self._reading
        rendition = self.manifest.rendition if isinstance(self.manifest, RenditionManifest) else None
        with self._lock:
            grown = len(index) - len(self.index)
            self.index, self.manifest, self.manifest_bytes = index, index.view(rendition), data
        return grown

    def fetch(self, group: GroupEntry) -> dict[str, bytes]:
        """Content by path of all files of a group, verified.

        Raises:
            StudioError: as `fetch_group`; `stream.replaced`: the stream was baked again since it was opened.
        """
        with self._reading():
            return fetch_group(self.source, group)

    def checked(self, file: FileEntry) -> bytes:
        """Content of one file, verified. Raises StudioError as `fetch`."""
        with self._reading():
            return checked_file(self.source, file)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Tells damaged files from those of another bake, which has replaced the stream since it was opened."""
        try:
            yield
        except SourceUnavailable:
            raise
        except StudioError:
            if self._replaced():
                raise StudioError(
                    "stream.replaced",
                    "the stream was baked again since it was opened",
                    file=f"{self.source.name}/{MANIFEST_NAME}",
                    fix="Open it again.",
                ) from None
            raise

    def _replaced(self) -> bool:
        """Whether there is another manifest now, which does not only add groups."""
        name = f"{self.source.name}/{MANIFEST_NAME}"
        try:
            data = self.source.read(MANIFEST_NAME, MAX_MANIFEST_BYTES)
            if data == self.manifest_bytes or not self.manifest_bytes:
                return False
            if parse_head(data, name).get("version") != 3:
                parse_manifest(data, name)
                return True
            new = parse_ladder(data, name)
        except StudioError:
            return False  # nothing that could be opened instead
        if self.index is None or not self.index.manifest.live:
            return True
        try:
            check_growth(self.index.manifest, new, name)
        except StudioError:
            return True
        return False

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """All files of the stream but the manifest, of all renditions, each once; in version 3, reads all pages of the
        index. Raises StudioError: a page is missing or damaged."""
        if self.index is None:
            found = {file.path: file for group in self.manifest.groups for file in group.files}
        else:
            found = {file.path: file for file in fixed_files(self.index.manifest)}
            for number in range(len(self.index)):
                found |= {file.path: file for file in self.index.ladder(number).files}
        return tuple(found.values())

    @property
    def group_starts(self) -> tuple[int, ...]:
        """First frame of each group; reads no page of the index."""
        if self.index is not None:
            return self.index.starts
        return tuple(group.first_frame for group in self.manifest.groups)

    def choose(self, rendition: str) -> None:
        """Read another rendition from the next group on; a group that is being decoded is finished as it is.

        Raises:
            StudioError: there is no such rendition.
        """
        if self.index is None:
            raise no_such_rendition(rendition, [], self.source.name)
        view = self.index.view(rendition)
        with self._lock:
            self.manifest = view

    def group(self, number: int, rendition: str | None = None) -> GroupEntry:
        """Group `number` in a rendition by id; None is the chosen one.

        Raises:
            StudioError: no such rendition, or its page of the index is missing or damaged.
        """
        if rendition is None:
            return self.manifest.groups[number]
        if self.index is None:
            raise no_such_rendition(rendition, [], self.source.name)
        return self.index.ladder(number).renditions[self.index.rendition_number(rendition)]

    @property
    def audio(self) -> AudioEntry | None:
        """What the manifest says of the sound; None for silent streams, as all of versions 1 and 2."""
        return None if self.index is None else self.index.manifest.audio

    def audio_bytes(self) -> bytes:
        """The sound's file, verified: an MP4 with one AAC track.

        Raises:
            StudioError: the stream has none (`stream.no_sound`), or the file is missing or damaged.
        """
        entry = self.audio
        if entry is None:
            raise StudioError("stream.no_sound", "the stream has no sound", file=self.source.name)
        return self.checked(entry)

    def sound(self) -> StreamSound | None:
        """The decoded sound, for random access; the caller closes it. None for silent streams.

        Raises:
            StudioError: the file is missing, damaged or not what the manifest says.
        """
        entry = self.audio
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

    def open_group(self, group: GroupEntry, files: Mapping[str, bytes] | None = None) -> GroupDecoder:
        """A decoder at the first frame of the group, from `files` as returned by `fetch_group`, or fetched now."""
        files = files or self.fetch(group)
        return open_decoder(group, files, self._pool, self.source.name, self.manifest.codec.name, self._threads)

    def gaussians(self, frame: int) -> Gaussians:
        """One frame, 0-based. The next frame costs one decoded picture; seeking decodes from the group's keyframe.

        Raises:
            StudioError: no such frame, or a file of its group is missing or damaged.
        """
        group = self.manifest.group_of(frame)
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

    def verify(self) -> None:
        """Verify size and SHA-256 of every file, of all renditions. Raises StudioError for the first mismatch."""
        if self.index is None:
            for group in self.manifest.groups:
                self.fetch(group)
            return
        sizes: dict[str, int] = {}
        if self.audio is not None:
            self.checked(self.audio)
        for number in range(len(self.index)):
            ladder = self.index.ladder(number)
            sizes.update((file.path, file.bytes) for file in ladder.files)
            for one in ladder.renditions:
                self.fetch(one)
        self.index.check_total(sum(sizes.values()))

    def _drop_decoder(self) -> None:
        if self._decoder is not None:
            self._decoder.close()
            self._decoder = None

    def end_reads(self) -> None:
        """Abort reads from a source that `open` created; threads that wait for them get a StudioError."""
        if self._owns_source:
            close_source(self.source)

    def close(self) -> None:
        """Release decoders and threads."""
        self.end_reads()  # before taking the lock: a thread that waits for the source holds it
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
