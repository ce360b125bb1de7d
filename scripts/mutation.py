"""Mutation testing: change one place of the code at a time and see whether a test fails.

    python scripts/mutation.py [--package studio/stream ...] [--count 30] [--seed 0] [--minutes 60] [--json FILE]
                               [--all] [--quick] [--again FILE]

Mutants are drawn at random, the same ones for the same seed and code, in turn of each package. A mutant runs the tests
of its package that are nearest to its file (`mirror_of`), those of a file that name the changed function first, up to
the first failure; with --all, all tests of its package. They run in processes forked from one that has imported the
libraries; nothing on the disk is changed. The test that fails runs again without the change, once, and must pass. What
survives is a test that is missing or a change without an effect: those that a person has read and found to have none
are listed in `scripts/equivalent_mutants.toml`, and are not counted in the score. Neither are those whose failing test
fails without the change, too. Prints every mutant and a table, and with --json writes them to a file. `--again FILE`
runs what survived in such a file. It exits with 0 when it could measure: the score is for people to judge.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import json
import os
import random
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from scripts.mutants import ROOT, Mutant, concerned, equivalents, key, mutants_of, mutated

if TYPE_CHECKING:
    import pytest

TESTS = {
    "studio/stream": ("tests/studio/stream",),
    "studio/training": ("tests/studio/training",),
    "studio/rasterizer": ("tests/studio/rasterizer",),
    "studio/calibration": ("tests/studio/calibration/test_alignment.py", "tests/studio/calibration"),
    "studio/capture": ("tests/studio/capture",),
    "studio/playback": ("tests/studio/playback", "tests/studio/stream/test_http_source.py"),
    "pipelines": ("tests/pipelines",),
    "gui/models": ("tests/gui/models",),
}
"""Packages and the tests that are run for them."""

_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+(?: \S+)*?)(?: - .*)?$", re.MULTILINE)
USERS = 6
_MARKS = ("not slow and not window", "slow and not window")
_PASSED = (0, 5)  # of pytest: all passed, no such tests
_FEW = 2
_GPU = ("cuda.py",)
_WORDS = {"from", "import", "class", "return", "annotations", "raise", "with", "__all__"}
_LIBRARIES = ("torch.optim", "cv2", "av", "scipy.optimize", "pydantic", "pytest", "rich.console")
_known_to_pass: set[str] = set()
_IN_PROGRAMS = """
from importlib.util import module_from_spec, spec_from_file_location
spec = spec_from_file_location("v3studio_mutant", {!r})
mutant = module_from_spec(spec)
spec.loader.exec_module(mutant)
mutant.install()
"""
"""Python runs this as it starts, also in programs that do not import `tests.support`."""


def files_of(package: str) -> Iterator[Path]:
    """Source files of a package."""
    yield from sorted(path for path in (ROOT / package).rglob("*.py") if path.name != "__init__.py")


def mirror_of(package: str, file: str, every: bool = False) -> list[str]:
    """Tests of a package: those named after the file, those that name most of what it defines, and, if these are few,
    those named after a part of its name or after files that import it; then all, if asked for."""
    places = [ROOT / place for place in TESTS[package]]
    tests = sorted({path for place in places for path in (place.rglob("test_*.py") if place.is_dir() else (place,))})
    found = [path for path in tests if Path(file).stem in path.stem]
    defined = set(re.findall(r"^(?:class |def )?(\w{4,})", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE))
    uses = {path: _mentions(path, defined - _WORDS) for path in tests}
    found += sorted((path for path in tests if uses[path]), key=lambda path: -uses[path])[:USERS]
    if len(set(found)) < _FEW:
        module = file.removesuffix(".py").replace("/", ".")
        importers = {path.stem for path in files_of(package) if re.search(rf"\b{module}\b", path.read_text("utf-8"))}
        parts = {part for part in Path(file).stem.split("_") if len(part) > 3} | importers
        found += [path for path in tests if any(part in path.stem for part in parts)][:USERS]
    if len(set(found)) < _FEW:
        found += [path for path in tests if path.parent == ROOT / "tests" / Path(file).parent][:USERS]
    return list(dict.fromkeys(map(str, (*found, *(places if every else ())))))


def _mentions(path: Path, names: set[str]) -> int:
    words = Counter(re.findall(r"\w+", path.read_text(encoding="utf-8")))
    return sum(words[name] for name in names)


def judge(mutant: Mutant, package: str, seconds: float, every: bool = False, quick: bool = False) -> Mutant:
    """Run the tests with a mutant until one fails that passes without it.

    Raises:
        RuntimeError: if the test that fails does so without the mutant, too.
    """
    why = equivalents().get(key(mutant))
    if why is not None:
        return replace(mutant, outcome="equivalent", by=why)
    tests = mirror_of(package, mutant.file, every)
    for marks in _MARKS[: 1 if quick else 2] if tests else ():
        outcome, output = run(mutant, tests, seconds, marks)
        if outcome == "timed out":
            return replace(mutant, outcome=outcome)
        if outcome == "killed":
            failed = _FAILED.search(output)
            if failed is None or failed[1].endswith(".py"):  # not even the tests can be imported
                return replace(mutant, outcome=outcome, by=failed[1] if failed else "")
            if failed[1] not in _known_to_pass and run(None, [failed[1]], seconds)[0] != "survived":
                raise RuntimeError(f"{failed[1]} fails without a change:\n{output[-3000:]}")
            _known_to_pass.add(failed[1])
            return replace(mutant, outcome=outcome, by=failed[1])
    return replace(mutant, outcome="survived")


def run(mutant: Mutant | None, tests: list[str], seconds: float, marks: str = "") -> tuple[str, str]:
    """Run tests with a mutant, or without one, in a forked process.

    Returns:
        killed, survived or timed out; and what pytest printed.
    """
    with tempfile.TemporaryDirectory() as scratch:
        pid = os.fork()
        if pid == 0:
            os._exit(_child(mutant, tests, Path(scratch), marks))
        outcome, ended = "timed out", time.monotonic() + seconds
        while time.monotonic() < ended:
            done, status = os.waitpid(pid, os.WNOHANG)
            if done:
                outcome = "survived" if os.waitstatus_to_exitcode(status) in _PASSED else "killed"
                break
            time.sleep(0.1)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)  # programs that the tests started
        if outcome == "timed out":
            os.waitpid(pid, 0)
        return outcome, (Path(scratch) / "output").read_text(errors="replace")


def _child(mutant: Mutant | None, tests: list[str], scratch: Path, marks: str) -> int:
    import pytest

    os.setpgid(0, 0)
    os.chdir(ROOT)
    for number, place in enumerate((os.devnull, str(scratch / "output"), str(scratch / "output"))):
        os.dup2(os.open(place, os.O_RDWR | os.O_CREAT | os.O_APPEND), number)
    sys.path.insert(0, str(ROOT))
    if mutant is not None:
        module = mutant.file.removesuffix(".py").replace("/", ".")
        (scratch / "mutant.json").write_text(json.dumps({"module": module, "source": mutated(mutant)}))
        os.environ["V3STUDIO_MUTANT"] = str(scratch / "mutant.json")
        os.environ |= in_programs(scratch)
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", marks]
    try:
        import_module("tests.support")  # finds the mutant before anything else is imported
        plugins = [] if mutant is None else [_Likeliest(concerned(ROOT / mutant.file, mutant.line))]
        return int(pytest.main([*options, "--basetemp", str(scratch / "pytest"), *tests], plugins))
    except BaseException:
        return 99


def in_programs(folder: Path) -> dict[str, str]:
    """Variables for programs that must load the mutant as they start; writes what Python looks for to a folder."""
    (folder / "sitecustomize.py").write_text(_IN_PROGRAMS.format(str(ROOT / "tests/support/mutant.py")))
    return {"PYTHONPATH": os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH"))))}


class _Likeliest:
    """Within each file of tests, runs those first that name most of what is changed; the order of the files stays."""

    def __init__(self, names: set[str]) -> None:
        self._names = names

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        files = {path: place for place, path in enumerate(dict.fromkeys(item.path for item in items))}
        items.sort(key=lambda item: (files[item.path], -self._mentions(item)))

    def _mentions(self, item: pytest.Item) -> int:
        words = re.findall(r"\w+", inspect.getsource(item.function))  # type: ignore[attr-defined]
        return len(self._names.intersection(words))


def drawn(package: str, count: int, seed: int) -> list[Mutant]:
    """Mutants of a package, at random; without a GPU, none of the code for GPUs."""
    import torch

    files = [file for file in files_of(package) if file.name not in _GPU or torch.cuda.is_available()]
    every = [mutant for file in files for mutant in mutants_of(file)]
    return random.Random(f"{seed} {package}").sample(every, min(count, len(every)))


def survivors(file: Path) -> dict[str, list[Mutant]]:
    """What survived by package, of a file that --json wrote; of the present code, so line numbers may differ."""
    found: dict[str, list[Mutant]] = {}
    for package, rows in json.loads(file.read_text(encoding="utf-8")).items():
        for row in rows:
            if row["outcome"] == "survived":
                same = [one for one in mutants_of(ROOT / row["file"]) if one.what == row["what"]]
                near = sorted(same, key=lambda one, row=row: (one.code != row["code"], abs(one.number - row["number"])))  # type: ignore[misc]
                found.setdefault(package, []).extend(near[:1])
    return found


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--package", action="append", choices=sorted(TESTS), help="default: all")
    parser.add_argument("--count", type=int, default=30, help="mutants of each package")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60, help="no mutant is started after this time")
    parser.add_argument("--limit", type=float, default=1800, help="seconds for the tests of a mutant")
    parser.add_argument("--all", action="store_true", help="run all tests of the package for what else would survive")
    parser.add_argument("--quick", action="store_true", help="leave out tests that are marked as slow")
    parser.add_argument("--json", type=Path, help="write the results to this file")
    parser.add_argument("--again", type=Path, help="run what survived in this file")
    chosen = parser.parse_args()
    for name in _LIBRARIES:
        import_module(name)
    end = time.monotonic() + 60 * chosen.minutes
    packages = chosen.package or list(TESTS)
    again = survivors(chosen.again) if chosen.again else None
    results: dict[str, list[Mutant]] = {package: [] for package in packages}
    chances = {
        name: drawn(name, chosen.count, chosen.seed) if again is None else again.get(name, []) for name in packages
    }
    turns = zip_longest(*([(name, mutant) for mutant in chances[name]] for name in packages))
    for package, mutant in (one for turn in turns for one in turn if one is not None):
        if time.monotonic() > end:
            break
        try:
            done = judge(mutant, package, chosen.limit, chosen.all, chosen.quick)
        except RuntimeError as error:  # one such test must not end the measurement
            done = replace(mutant, outcome="unclear", by=str(error).splitlines()[0])
        results[package].append(done)
        print(f"{done.outcome:10} {done.file}:{done.line}  {done.what}  {done.by}", flush=True)
        if chosen.json:
            rows = {name: [vars(one) for one in found] for name, found in results.items()}
            chosen.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print("\npackage               mutants  equivalent  unclear  killed  timed out  survived  score")
    for package, found in results.items():
        kinds = ("equivalent", "unclear", "killed", "timed out", "survived")
        same, unclear, killed, late, alive = (sum(one.outcome == kind for one in found) for kind in kinds)
        judged = len(found) - same - unclear
        score = f"{100 * (killed + late) / judged:.0f} %" if judged else "not run"
        print(f"{package:21} {len(found):7} {same:11} {unclear:8} {killed:7} {late:10} {alive:9}  {score}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
