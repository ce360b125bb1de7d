import re
from pathlib import Path

import pytest

from tests.support.errors import refuses
from tests.support.streams import bake_numbered, contents
from tests.support.tiny_capture import Here
from v3studio.studio.formats.sequence import open_import
from v3studio.studio.stream import BakeSettings, Rung, StreamReader, check_stream


@pytest.fixture
def stream(tmp_path: Path) -> Path:
    """A stream of two groups."""
    settings = BakeSettings(ladder=(Rung(qp=24), Rung(qp=34)), preset="ultrafast")
    return bake_numbered(tmp_path / "stream", (2, 2), 25, 60, settings)


def test_publish_copies_what_is_missing(here: Here, stream: Path, tmp_path: Path) -> None:
    done = here("publish", stream, tmp_path / "web").ok()
    assert f"{len(contents(stream)) - 1} files copied" in done.stdout  # and the manifest
    again = here("publish", stream, tmp_path / "web", "--page", "--title", "A <walk>")
    assert "0 files copied" in again.stdout, again.stderr
    page = (tmp_path / "web" / "index.html").read_text()
    assert 'src="manifest.json"' in page
    assert "<title>A &lt;walk&gt;</title>" in page
    for name in re.findall(r'(?:src|poster)="([^"]+)"', page):
        assert (tmp_path / "web" / name).is_file(), name
    with StreamReader.open(tmp_path / "web") as reader:
        assert not check_stream(reader).damage


def test_a_stream_in_one_file_plays(here: Here, stream: Path, tmp_path: Path) -> None:
    out = tmp_path / "one.v3s"
    done = here("export", stream, "--format", "v3", "--out", out).ok()
    assert "4 frames" in done.stdout
    here("play", out).ok()
    here("export", out, "--format", "ply", "--out", tmp_path / "plys").ok()
    assert len(list((tmp_path / "plys").iterdir())) == 4
    here("serve", out).fails("v3studio share")
    with refuses("import.is_a_stream", file=out):
        open_import(out)


def test_options_that_do_not_fit(here: Here, stream: Path) -> None:
    export = ("export", stream, "--format", "v3", "--out")
    here(*export, "x.zip").fails("writes a .v3s file", code=2)
    here(*export, "x.v3s", "--frames", "0:2").fails("does not take --frames", code=2)
    here(*export, "x.v3s", "--of", "trained").fails("no --of", code=2)
