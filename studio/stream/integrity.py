"""Finds the damaged files of a stream: compares all of them with the sizes and checksums of its manifest."""

from dataclasses import dataclass

from v3studio.studio.errors import StudioError
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.stream.manifest import MANIFEST_NAME
from v3studio.studio.stream.manifest_file import check_total
from v3studio.studio.stream.reader import StreamReader, fetch_files
from v3studio.studio.stream.sources.source import SourceUnavailable


@dataclass(frozen=True)
class StreamDamage:
    """A file that is missing or not what the manifest says: its path in the stream, what is wrong, and the numbers of
    the groups that cannot be played without it, at least in one rendition; empty for sound and manifest."""

    file: str
    problem: str
    groups: tuple[int, ...]


@dataclass(frozen=True)
class StreamIntegrity:
    """The result of `check_stream`: number of files checked (with the manifest), their size by the manifest, damage."""

    files: int
    bytes: int
    damage: tuple[StreamDamage, ...]


def check_stream(reader: StreamReader, progress: ProgressFn = no_progress) -> StreamIntegrity:
    """Read every file of all renditions and compare it with the size and the SHA-256 in the manifest.

    The manifest itself was checked when the stream was opened, except for its total where groups are in pages. Files
    of groups whose page is damaged cannot be checked, because only the page lists them. `progress` is called with the
    bytes checked, and with how many are known of. SourceUnavailable if the server does not answer.
    """
    files = {file.path: file for file in reader.manifest.fixed_files}
    groups: dict[str, list[int]] = {}
    lost: dict[str, str] = {}  # damaged pages, and what is wrong with them
    for number in range(len(reader.index)):
        try:
            entries = reader.index.files(number)
        except SourceUnavailable:
            raise
        except StudioError as error:
            page = reader.index.page_of(number)
            assert page is not None  # groups in the manifest itself need no file
            lost[page.path], entries = error.problem, (page,)
        for entry in entries:
            files[entry.path] = entry
            groups.setdefault(entry.path, []).append(number)
    damage: list[StreamDamage] = []
    total, done = sum(entry.bytes for entry in files.values()), 0
    if not lost:  # all files are known
        try:
            check_total(reader.manifest, total, len(reader.manifest_bytes), MANIFEST_NAME)
        except StudioError as error:
            damage.append(StreamDamage(MANIFEST_NAME, error.problem, ()))
    for path, entry in files.items():
        problem = lost.get(path)
        try:
            if problem is None:
                fetch_files(reader.source, (entry,))
        except SourceUnavailable:
            raise
        except StudioError as error:
            problem = error.problem
        if problem is not None:
            damage.append(StreamDamage(path, problem, tuple(groups.get(path, ()))))
        done += entry.bytes
        progress(done, total)
    return StreamIntegrity(files=len(files) + 1, bytes=total + len(reader.manifest_bytes), damage=tuple(damage))
