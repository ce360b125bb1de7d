"""The tool that changes the code to see whether tests notice."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

from scripts.mutation import ROOT, TESTS, mirror_of, mutants_of, mutated

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


def test_a_mutant_is_what_programs_import(tmp_path: Path) -> None:
    """In place of the module on the disk, which is not touched."""
    before = FILE.read_bytes()
    changed = {"module": "studio.stream.quantize", "source": FILE.read_text() + "\nCHANGED = True\n"}
    (tmp_path / "mutant.json").write_text(json.dumps(changed))
    code = "import tests.support; import studio.stream.quantize as q; print(q.CHANGED, q.__file__)"
    environment = {**os.environ, "V3STUDIO_MUTANT": str(tmp_path / "mutant.json"), "PYTHONPATH": str(ROOT)}
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
