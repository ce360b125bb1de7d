"""Files of a terabyte that take no room on the disk: refused by every reader before they are in memory."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from pipelines.config.loading import load_config
from pipelines.takes.frame_files import read_frame
from pipelines.takes.take import Take
from studio.bounded_files import read_bounded, read_bounded_text
from studio.calibration.manual.file import read_tie_points
from studio.camera_files import read_rig
from studio.errors import StudioError
from studio.formats import read_splats

TERABYTE = 1 << 40


def test_up_to_the_limit_it_is_the_whole_file(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"one\r\ntwo\n")
    assert read_bounded(file, 9) == b"one\r\ntwo\n"
    assert read_bounded_text(file) == "one\ntwo\n"
    with pytest.raises(OSError, match="more than the 8 bytes"):
        read_bounded(file, 8)


def test_what_has_no_size_takes_no_more_memory_than_it_has_bytes(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    assert read_bounded(tmp_path / "empty", 1 << 60) == b""
    os.mkfifo(tmp_path / "pipe")
    text = bytes(range(256)) * 10_000
    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit((tmp_path / "pipe").write_bytes, text)
        assert read_bounded(tmp_path / "pipe", len(text)) == text
        writing.result()
    with pytest.raises(OSError, match="more than the 3,000,000 bytes"):
        read_bounded(Path("/dev/zero"), 3_000_000)


@pytest.mark.parametrize(
    ("name", "start", "read"),
    [
        ("settings.yaml", b"capture:", load_config),
        ("cameras.json", b"{", read_rig),
        ("calib.toml", b"x = 1", read_rig),
        ("calibration.csv", b"name,w", read_rig),
        ("tie_points.yaml", b"a:", read_tie_points),
        ("take.json", b"{", lambda path: Take.open(path.parent)),
        ("a.splat", b"", read_splats),
        ("a.ksplat", b"\0\1", read_splats),
        ("a.spz", b"NGSP", read_splats),
        ("a.ply", b"ply\nformat ascii 1.0\n", read_splats),
        ("a.safetensors", b"\x02\0\0\0\0\0\0\0{}", read_frame),
    ],
)
def test_a_terabyte_is_refused(tmp_path: Path, name: str, start: bytes, read: Callable[[Path], object]) -> None:
    file = tmp_path / name
    file.write_bytes(start)
    os.truncate(file, TERABYTE)
    with pytest.raises(StudioError) as caught:
        read(file)
    assert name in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_ply_file_needs_the_end_of_its_header_early(tmp_path: Path) -> None:
    """The parser would read a line without an end byte by byte: a megabyte takes it a second."""
    file = tmp_path / "a.ply"
    file.write_bytes(b"ply\nformat ascii 1.0\ncomment " + b"x" * (1 << 20) + b"\nend_header\n")
    with pytest.raises(StudioError, match="no end of the header in the first"):
        read_splats(file)
