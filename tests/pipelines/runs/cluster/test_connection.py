from pathlib import Path
from types import SimpleNamespace

import pytest

from v3studio.pipelines.runs.cluster import connection


def test_the_working_folder_is_nothing_to_import_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray adds the folder in which it is initialized to the import path of its workers."""
    pytest.importorskip("ray.exceptions", reason="Ray is not installed (extra cluster)")
    folders = []
    ray = SimpleNamespace(
        is_initialized=lambda: False, init=lambda **_: folders.append(Path.cwd()), shutdown=lambda: None
    )
    monkeypatch.setattr(connection, "load_ray", lambda address: ray)
    monkeypatch.chdir(tmp_path)
    with connection.connected("local", 1):
        assert Path.cwd() == tmp_path
    assert folders == [Path("/")]
