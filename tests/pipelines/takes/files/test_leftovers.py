import os
from pathlib import Path

from v3studio.pipelines.takes.files.leftovers import sweep_partial
from v3studio.studio.atomic_files import machine_name, write_text


def test_sweep_takes_leftovers_only(tmp_path: Path) -> None:
    write_text(tmp_path / "deep" / "kept.txt", "x")
    alive = f".marks.{os.getppid()}-{machine_name()}-00000000.partial.json"
    (tmp_path / "deep" / f".kept.999999999-{machine_name()}-00000000.partial.txt").write_text("half")
    (tmp_path / alive).write_text("another process is writing it")
    (tmp_path / ".group_000.partial").mkdir()
    (tmp_path / ".group_000.partial" / "x.mp4").write_text("half")
    for name in ("report.json", "000001.ply", "edits.json", "notes.txt"):
        (tmp_path / "deep" / name).touch()  # a power cut leaves empty files, but a person made the edits
    assert sweep_partial(tmp_path) == 4
    left = [path.name for path in sorted(tmp_path.rglob("*"))]
    assert left == [alive, "deep", "edits.json", "kept.txt", "notes.txt"]
