"""One-file streams: written, read locally and by ranges, and refused where they are cut."""

import zipfile
from pathlib import Path

import pytest

from tests.studio.stream.conftest import FindStream
from tests.studio.stream.sources.conftest import Server
from tests.support.errors import refuses
from tests.support.splats import same_splats
from tests.support.streams import contents
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import StreamReader, check_stream
from v3studio.studio.stream.write_archive import write_archive


@pytest.fixture(scope="module")
def archive(intact: FindStream, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A stream with a page of its index as one file, and its folder."""
    folder, file = intact("ladder"), tmp_path_factory.mktemp("archive") / "stream.v3s"
    with StreamReader.open(folder) as reader:
        size = write_archive(reader, file)
    assert size == file.stat().st_size
    return file, folder


def test_it_is_a_zip_archive_of_stored_files(archive: tuple[Path, Path]) -> None:
    path, folder = archive
    with zipfile.ZipFile(path) as opened:
        assert opened.testzip() is None
        assert opened.namelist()[0] == "manifest.json"
        assert {entry.compress_type for entry in opened.infolist()} == {zipfile.ZIP_STORED}
        assert {name: opened.read(name) for name in opened.namelist()} == contents(folder)


def test_local_and_by_ranges_it_is_the_same_stream(archive: tuple[Path, Path], server: Server) -> None:
    path, folder = archive
    server.files["/s/stream.v3s"] = path.read_bytes()
    address = f"{server.url}/stream.v3s?token=x"
    with StreamReader.open(folder) as plain, StreamReader.open(path) as local, StreamReader.open(address) as web:
        assert not check_stream(local).damage
        for one, two, three in zip(plain.iterate(), local.iterate(), web.iterate(), strict=True):
            assert same_splats(one, two)
            assert same_splats(one, three)
    assert all(wanted is not None and place.endswith("?token=x") for place, wanted in server.requests)


def test_servers_without_ranges_are_refused(archive: tuple[Path, Path], server: Server) -> None:
    server.files["/s/stream.v3s"], server.ranges = archive[0].read_bytes(), False
    with refuses("source.no_ranges"):
        StreamReader.open(f"{server.url}/stream.v3s")


def test_cut_anywhere(archive: tuple[Path, Path], tmp_path: Path) -> None:
    data = archive[0].read_bytes()
    cut = tmp_path / "cut.v3s"
    for end in (*range(0, len(data), len(data) // 40), len(data) - 1, len(data) - 22):
        cut.write_bytes(data[:end])
        with refuses("source.archive_damaged", file=cut):
            StreamReader.open(cut)
        cut.write_bytes(data[end + 1 :])
        assert outcome(cut) in ("source", "manifest", "damaged")


def test_any_byte_may_be_wrong(archive: tuple[Path, Path], tmp_path: Path) -> None:
    data = archive[0].read_bytes()
    changed = tmp_path / "changed.v3s"
    for at in range(0, len(data), len(data) // 150):
        changed.write_bytes(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
        assert outcome(changed) in ("source", "manifest", "damaged", "whole")


def outcome(path):
    """Area of the error that refuses it, "damaged" if a file in it is, or "whole"."""
    try:
        with StreamReader.open(path) as reader:
            return "damaged" if check_stream(reader).damage else "whole"
    except StudioError as error:
        return error.code.split(".")[0]


@pytest.mark.parametrize("kind", ["deflated", "outside", "twice"])
def test_archives_of_another_kind(archive: tuple[Path, Path], tmp_path: Path, kind: str) -> None:
    other = tmp_path / "other.v3s"
    with zipfile.ZipFile(archive[0]) as opened, zipfile.ZipFile(other, "w") as out:
        for name in opened.namelist():
            out.writestr(name, opened.read(name), zipfile.ZIP_DEFLATED if kind == "deflated" else zipfile.ZIP_STORED)
        if kind == "outside":
            out.writestr("../x", b"x")
        if kind == "twice":
            with pytest.warns(UserWarning, match="Duplicate"):
                out.writestr("manifest.json", b"x")
    with refuses("source.archive_not_stored" if kind == "deflated" else "source.archive_damaged", file=str(other)):
        StreamReader.open(other)
