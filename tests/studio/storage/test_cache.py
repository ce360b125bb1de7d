"""The cache on the disk."""

import os
import shutil
from pathlib import Path

import pytest

from v3studio.studio.storage.cache import DiskCache


def test_it_may_be_deleted_while_it_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache, stat = DiskCache(tmp_path / "cache"), Path.stat
    for key in ("aa1", "bb2", "cc3"):
        cache.path(key).parent.mkdir(parents=True)
        cache.path(key).write_bytes(b"1")

    def deleted(path: Path, **how: bool) -> os.stat_result:
        if path.parent.parent.name == "objects":
            shutil.rmtree(cache.folder, ignore_errors=True)
        return stat(path, **how)

    monkeypatch.setattr(Path, "stat", deleted)
    cache.added(1)
    assert not any(map(os.path.exists, map(cache.path, ("aa1", "bb2", "cc3"))))
