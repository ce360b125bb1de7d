"""Takes of format 1: read as is, and migrated to format 2 by a run, even after an interrupted migration."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from pipelines.config import Config, dump_config, load_config
from pipelines.config.loading import digest_text
from pipelines.runs.staleness import assess_all
from pipelines.stages import STAGES
from pipelines.stages.inputs import Inputs
from pipelines.stages.params import derived_seed, key_of
from pipelines.takes import migration
from pipelines.takes.atomic_files import digest_of, digest_of_file, read_json, write_json, write_text
from pipelines.takes.records import read_record, result_of
from pipelines.takes.take import Take


def old_take(root: Path) -> Path:
    """A small take of format 1, as written by earlier versions: old names, and digests over the old names."""
    config = Config.model_validate({"train": {"strategy": "mcmc"}})
    group = root / "initialise" / "group_000"
    group.mkdir(parents=True)
    (group / "mesh.ply").write_bytes(b"mesh")
    (group / "points.ply").write_bytes(b"points")
    write_json(group / "report.json", {"key": "k", "files": {"mesh.ply": digest_of_file(group / "mesh.ply")}})
    files = [group / "mesh.ply", group / "points.ply"]
    names = [path.relative_to(root).as_posix() for path in files]
    record = {
        "stage": "initialise",
        "ingredients": {"initialise.points": 50_000, "result of calibrate": "c", "train.density": "mcmc"},
        "result": digest_of(dict(zip(names, map(digest_of_file, files), strict=True))),
        "files": {name: path.stat().st_size for name, path in zip(names, files, strict=True)},
        "written": {name: path.stat().st_mtime_ns for name, path in zip(names, files, strict=True)},
        "seconds": 1.0,
        "summary": {"explained": 0.9},
    }
    write_json(root / ".v3studio" / "stages" / "initialise.json", record)
    write_json(
        root / ".v3studio" / "stages" / "train.json", {"ingredients": {"result of initialise": "i"}, "result": "t"}
    )
    write_json(root / "calibrate" / "report.json", {"explained": 0.9, "geometry": {"neighbours": {}}})
    write_text(root / "config.yaml", digest_text(config))
    write_json(root / "take.json", {"format": 1, "created_by": "v3studio 0.1.0"})
    return root


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return old_take(tmp_path / "take")


def listing(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def seen(root: Path) -> tuple[object, ...]:
    take = Take.open(root)
    record = read_record(take, "initialize")
    assert record is not None
    return (
        record.params,
        record.summary,
        sorted(record.files),
        result_of(take, "train"),
        (take.initialize_group(0) / "points.ply").read_bytes(),
        load_config(take.config).train.strategy,
    )


def test_reading_changes_nothing(root: Path) -> None:
    before = listing(root)
    params, summary, files, trained, points, strategy = seen(root)
    assert params == {"initialize.points": 50_000, "result of calibrate": "c", "train.strategy": "mcmc"}
    assert summary == {"match_inlier_ratio": 0.9}
    assert files == ["initialize/group_000/mesh.ply", "initialize/group_000/points.ply"]
    assert (trained, points, strategy) == ("t", b"points", "mcmc")
    assert listing(root) == before


def test_migration_keeps_results_and_says_the_same(root: Path) -> None:
    before = seen(root)
    assert migration.migrate(Take.open(root))
    assert not migration.migrate(Take.open(root)), "once"
    assert seen(root) == before
    assert not (root / "initialise").exists()
    assert (root / "initialize" / "group_000" / "mesh.ply").read_bytes() == b"mesh"
    assert read_json(root / "take.json")["format"] == 2
    assert "strategy: mcmc" in (root / "config.yaml").read_text()
    assert "density" not in (root / "config.yaml").read_text()
    assert read_json(root / "calibrate" / "report.json") == {"match_inlier_ratio": 0.9, "geometry": {"neighbors": {}}}


SETTINGS_OF_FORMAT_1 = """\
# my take
capture:
  root: "/data"  # the disk in the rack

# what starts each group
initialise:
  points: 45000 # enough

train:
  # tried both
  density: gradient  # as in 3DGS
  motion_neighbours: 8
  group_size: 15

calibrate:
  keep_known: no
"""


def test_migration_keeps_the_comments_of_the_settings(root: Path) -> None:
    (root / "config.yaml").write_text(SETTINGS_OF_FORMAT_1)
    before = load_config(root / "config.yaml")
    assert migration.migrate(Take.open(root))
    assert (root / "config.yaml").read_text() == (
        SETTINGS_OF_FORMAT_1.replace("initialise:", "initialize:")
        .replace("density: gradient", "strategy: default")
        .replace("motion_neighbours", "motion_neighbors")
        .replace("keep_known: no", "fix_intrinsics: false")
    )
    assert load_config(root / "config.yaml") == before


def test_a_migration_that_was_killed_anywhere_goes_on(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = seen(root)
    whole = root.with_name("whole")
    shutil.copytree(root, whole)
    migration.migrate(Take.open(whole))
    wanted = listing(whole)

    class Killed(BaseException):
        pass

    left = 0
    for steps in range(20):
        broken = root.with_name(f"broken{steps}")
        shutil.copytree(root, broken)
        with monkeypatch.context() as patch:
            count = 0

            def counted(real, steps=steps):
                def call(*arguments):
                    nonlocal count
                    if count == steps:
                        raise Killed
                    count += 1
                    return real(*arguments)

                return call

            patch.setattr(migration, "write_json", counted(migration.write_json))
            patch.setattr(migration, "write_text", counted(migration.write_text))
            patch.setattr(migration.os, "rename", counted(os.rename))
            try:
                migration.migrate(Take.open(broken))
            except Killed:
                left += 1
        assert seen(broken) == before
        migration.migrate(Take.open(broken))
        assert listing(broken) == wanted
    assert left >= 6


def test_a_stage_that_has_not_changed_is_not_stale(root: Path) -> None:
    """Old and current names in a stage's record compare equal."""
    take = Take.open(root)
    context = Inputs(take, load_config(take.config))
    found = assess_all(STAGES[:1], context)["calibrate"]
    assert found.state == "missing"
    from pipelines.runs.staleness import differences

    now = {"initialize.points": 50_000, "result of calibrate": "c", "train.strategy": "mcmc"}
    record = read_record(take, "initialize")
    assert record is not None
    assert differences(record.params, now) == []
    assert differences(record.params, {**now, "train.strategy": "default"}) != []


def test_keys_and_seeds_are_those_of_format_1() -> None:
    old = {"initialise.points": 5, "train.density": "gradient", "calibrate.shared_lens": None}
    new = {"initialize.points": 5, "train.strategy": "default", "calibrate.shared_intrinsics": None}
    assert key_of("initialize", 1, new, "r", 0, 7) == digest_of(["initialise", 1, old, "r", 0, 7])
    assert derived_seed(3, "initialize", 2) == int(digest_of([3, "initialise", 2])[:15], 16) % 2**31


def test_what_is_written_is_format_2(tmp_path: Path) -> None:
    take = Take.create(tmp_path / "new")
    assert json.loads((take.root / "take.json").read_text())["format"] == 2
    assert take.initialize_group(0).relative_to(take.root).as_posix() == "initialize/group_000"
    assert dump_config(Config()) != digest_text(Config())
