"""The tool that changes the code to see whether tests notice."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from scripts.mutants import ROOT, concerned, equivalents, key, mutants_of, mutated
from scripts.mutation import TESTS, _Likeliest, files_of, in_programs, mirror_of, survivors

FILE = ROOT / "studio/stream/quantize.py"


def test_every_mutant_differs_in_one_place_and_compiles() -> None:
    source = ast.unparse(ast.parse(FILE.read_text())).splitlines()
    mutants = mutants_of(FILE)
    assert len(mutants) > 20
    for mutant in mutants:
        changed = mutated(mutant)
        compile(changed, mutant.file, "exec")
        assert changed.splitlines() != source
        assert abs(len(changed.splitlines()) - len(source)) <= 1
    assert mutants == mutants_of(FILE)


@pytest.mark.parametrize("first", ["import tests.support; ", ""])
def test_a_mutant_is_what_programs_import(tmp_path: Path, first: str) -> None:
    """In place of the module on the disk, which is not touched; also programs that know nothing of the tests."""
    before = FILE.read_bytes()
    changed = {"module": "studio.stream.quantize", "source": FILE.read_text() + "\nCHANGED = True\n"}
    (tmp_path / "mutant.json").write_text(json.dumps(changed))
    code = f"{first}import studio.stream.quantize as q; print(q.CHANGED, q.__file__)"
    environment = {**os.environ, **in_programs(tmp_path)} if not first else {**os.environ, "PYTHONPATH": str(ROOT)}
    environment["V3STUDIO_MUTANT"] = str(tmp_path / "mutant.json")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.stdout.split() == ["True", str(FILE)], done.stderr
    assert FILE.read_bytes() == before


def test_the_nearest_tests_come_first() -> None:
    chosen = mirror_of("studio/stream", "studio/stream/quantize.py")
    assert chosen[0].endswith("test_quantize.py")
    assert all(Path(path).is_file() for path in chosen)
    every = mirror_of("studio/stream", "studio/stream/quantize.py", every=True)
    assert every == [*chosen, str(ROOT / "tests/studio/stream")]
    for package, places in TESTS.items():
        assert (ROOT / package).is_dir()
        assert all((ROOT / place).exists() for place in places)


def test_equal_changes_of_a_file_are_told_apart() -> None:
    every = [mutant for file in files_of("studio/stream") for mutant in mutants_of(file)]
    assert len({key(mutant) for mutant in every}) == len(every)
    names = {(mutant.file, mutant.what) for mutant in every}
    assert len(names) < len(every), "a name and a change are not enough"


def test_what_is_listed_as_equivalent_exists() -> None:
    listed = equivalents()
    found = {key(mutant) for name in {file for file, *_ in listed} for mutant in mutants_of(ROOT / name)}
    assert set(listed) <= found, "remove what is no longer there"


def test_tests_that_name_the_changed_function_run_first(tmp_path: Path) -> None:
    file = tmp_path / "code.py"
    file.write_text("def _inner():\n    return 1\n\ndef outer():\n    return _inner()\n\ndef other():\n    return 2\n")
    assert concerned(file, 2) == {"_inner", "outer"}
    assert concerned(file, 8) == {"other"}

    def item(path: Path, function: object) -> pytest.Item:
        return cast(pytest.Item, SimpleNamespace(path=path, function=function))

    def far() -> None:
        """Something else."""

    def near() -> None:
        """Calls outer."""

    items = [item(tmp_path / "b", far), item(tmp_path / "b", near), item(tmp_path / "a", near)]
    given = list(items)
    _Likeliest({"outer"}).pytest_collection_modifyitems(items)
    assert items == [given[1], given[0], given[2]]


def test_survivors_are_found_again_after_lines_moved(tmp_path: Path) -> None:
    mutants = mutants_of(FILE)
    twin = next(one for one in mutants if sum(one.what == other.what for other in mutants) > 1)
    row = {**vars(twin), "outcome": "survived", "line": twin.line + 3}
    (tmp_path / "before.json").write_text(json.dumps({"studio/stream": [row, {**row, "outcome": "killed"}]}))
    assert survivors(tmp_path / "before.json") == {"studio/stream": [twin]}
