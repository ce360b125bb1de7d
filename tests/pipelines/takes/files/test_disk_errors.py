import errno
import os
import resource
from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.takes.files.disk_errors import disk_errors


def test_full_disk_is_a_sentence_that_names_the_folder(tmp_path: Path) -> None:
    """Writes to /dev/full fail like those to a full disk."""
    with refuses("take.disk_full", file=tmp_path), disk_errors(tmp_path):
        Path("/dev/full").write_text("x")


def test_a_limit_of_file_sizes_is_a_sentence(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        with refuses("take.file_too_large", file=tmp_path), disk_errors(tmp_path):
            (tmp_path / "large").write_bytes(bytes(200))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("number", [errno.EIO, errno.ESTALE, errno.ETIMEDOUT])
def test_a_disk_that_fails_is_a_sentence(tmp_path: Path, number: int) -> None:
    with refuses("take.disk_failed", file=tmp_path / "x"), disk_errors(tmp_path):
        raise OSError(number, os.strerror(number), str(tmp_path / "x"))
