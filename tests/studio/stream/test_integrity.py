"""Every damaged file of a stream is found and named, whatever the stream is kept in."""

from pathlib import Path

import pytest

from tests.studio.stream.conftest import MakeLadder
from tests.support.streams import flip
from v3studio.pipelines.cli import execute
from v3studio.studio.stream import StreamReader, check_stream
from v3studio.studio.stream.write_archive import write_archive


@pytest.fixture
def ladder(make_ladder: MakeLadder) -> Path:
    """Three renditions, and the second and third group in a page of the index."""
    return make_ladder((2, 2, 1), splats=60, paged=True)


def checked(place):
    with StreamReader.open(place) as reader:
        return check_stream(reader)


def test_a_stream_as_it_was_written_is_whole(ladder: Path, tmp_path: Path) -> None:
    files = [path for path in ladder.rglob("*") if path.is_file()]
    report = checked(ladder)
    assert (report.files, report.damage) == (len(files), ())
    assert report.bytes == sum(path.stat().st_size for path in files)
    with StreamReader.open(ladder) as reader:
        write_archive(reader, tmp_path / "one.v3s")
    assert checked(tmp_path / "one.v3s") == report


def test_each_file_is_named_once_with_the_groups_that_need_it(ladder: Path) -> None:
    with StreamReader.open(ladder) as reader:
        pages = {page.path for page in reader.index.manifest.pages}
        users = {}
        for number in range(3):
            for file in reader.index.group(number).files:
                users.setdefault(file.path, []).append(number)
    for path, numbers in users.items():
        flip(ladder / path)
        (damage,) = checked(ladder).damage
        assert (damage.file, damage.groups) == (path, tuple(numbers))
        assert "SHA-256" in damage.problem
        flip(ladder / path)
    for path in pages:
        flip(ladder / path)
        (damage,) = checked(ladder).damage
        assert damage.file == path
        assert damage.groups
        flip(ladder / path)


def test_the_command_checks_and_refuses_to_remove(
    ladder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with StreamReader.open(ladder) as reader:
        write_archive(reader, tmp_path / "one.v3s")
    assert execute(["check", str(ladder)]) == 0
    assert execute(["check", str(tmp_path / "one.v3s")]) == 0
    video = sorted(path for path in (ladder / "files").iterdir() if path.suffix == ".mp4")[0]
    flip(tmp_path / "one.v3s", (tmp_path / "one.v3s").read_bytes().index(video.read_bytes()) + 9)
    flip(video)
    for place in (ladder, tmp_path / "one.v3s"):
        capsys.readouterr()
        assert execute(["check", str(place)]) == 1
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].startswith(f"files/{video.name} (group")
        assert "1 damaged" in lines[1]
    assert execute(["check", str(ladder), "--remove"]) == 2
    assert video.exists()
    assert "--remove" in capsys.readouterr().err
