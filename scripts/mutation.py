"""Mutation testing: change one place of the code at a time and see whether a test fails.

    python scripts/mutation.py [--package studio/stream ...] [--count 30] [--seed 0] [--minutes 60] [--json FILE]
                               [--all] [--quick] [--again FILE]

Mutants are drawn at random, the same ones for the same seed and code, in turn of each package. A mutant runs the tests
of its package that are nearest to its file (`mirror_of`); with --all, all tests of its package.
They run in processes forked from one that has imported the libraries; nothing on the disk is changed. The test that
fails runs again without the change, and must pass. What survives is a test that is missing or a change without an
effect: those that a person has read and found to have none are listed in `scripts/equivalent_mutants.toml`, and are not
counted in the score. Prints every mutant and a table, and with --json writes them to a file. `--again FILE` runs what
survived in such a file. It exits with 0 when it could measure: the score is for people to judge.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import json
import os
import random
import re
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import zip_longest
from pathlib import Path

ROOT = Path(__file__).parents[1]
TESTS = {
    "studio/stream": ("tests/studio/stream",),
    "studio/training": ("tests/studio/training",),
    "studio/rasterizer": ("tests/studio/rasterizer",),
    "studio/calibration": ("tests/studio/calibration/test_alignment.py", "tests/studio/calibration"),
    "studio/capture": ("tests/studio/capture",),
    "studio/playback": ("tests/studio/playback", "tests/studio/stream/test_http_source.py"),
    "pipelines": ("tests/pipelines",),
    "gui/presenters": ("tests/gui/presenters",),
}
"""Packages and the tests that are run for them."""

EQUIVALENTS = ROOT / "scripts" / "equivalent_mutants.toml"
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+(?: \S+)*?)(?: - .*)?$", re.MULTILINE)
USERS = 6
_MARKS = ("not slow and not window", "slow and not window")
_PASSED = (0, 5)  # of pytest: all passed, no such tests
_FEW = 2
_GPU = ("cuda.py",)
_WORDS = {"from", "import", "class", "return", "annotations", "raise", "with", "__all__"}
_LIBRARIES = ("torch.optim", "cv2", "av", "scipy.optimize", "pydantic", "pytest", "rich.console")
_SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.LShift: ast.RShift, ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change.

    Attributes:
        file: relative to the repository.
        line: of the place, 1-based.
        number: of the place in the file.
        what: what was changed, as code.
        outcome: "killed", "survived", "timed out", or "equivalent", a change that is listed as one without an effect;
            empty before it ran.
        by: the test that failed, or why the change has no effect.
    """

    file: str
    line: int
    number: int
    what: str
    outcome: str = ""
    by: str = ""


class _Changer(ast.NodeTransformer):
    """Visits every place that can be changed, and changes the one with number `target`."""

    def __init__(self, target: int = -1) -> None:
        self.places: list[tuple[int, str]] = []
        self._target = target

    def _at(self, node: ast.AST, make: Callable[[], ast.AST]) -> ast.AST:
        changed = make()
        self.places.append((getattr(node, "lineno", 0), f"{_short(node)}  ->  {_short(changed)}"))
        if len(self.places) - 1 == self._target:
            return ast.copy_location(changed, node)
        return node

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        return self._at(node, ast.Pass)  # what it says is not changed

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_arguments(self, node: ast.arguments) -> ast.AST:
        node.defaults = [self.visit(value) for value in node.defaults]
        node.kw_defaults = [value and self.visit(value) for value in node.kw_defaults]
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.args = self.visit(node.args)
        node.body = [self.visit(statement) for statement in node.body]
        return node

    def visit_If(self, node: ast.If) -> ast.AST:
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return node
        self.generic_visit(node)
        return self._at(node, lambda: ast.If(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse))

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        if isinstance(node.value, ast.Constant):
            return node  # a docstring
        self.generic_visit(node)
        return self._at(node, ast.Pass) if isinstance(node.value, ast.Call) else node

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        self.generic_visit(node)
        return self._swapped(node, node.op, "op")

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        for index, operator in enumerate(node.ops):
            changed = copy.copy(node)
            changed.ops = list(node.ops)
            changed.ops[index] = _SWAPS[type(operator)]()  # type: ignore[call-overload]
            node_or_changed = self._at(node, lambda made=changed: made)  # type: ignore[misc]
            if node_or_changed is not node:
                return node_or_changed
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        return self._swapped(node, node.op, "op")

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        return self._swapped(node, node.op, "op")

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        return self._at(node, lambda: node.operand) if isinstance(node.op, (ast.Not, ast.USub)) else node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if isinstance(node.value, bool):
            return self._at(node, lambda: ast.Constant(not node.value))
        if isinstance(node.value, int):
            value: int = node.value
            return self._at(node, lambda: ast.Constant(value + 1))
        if isinstance(node.value, float):
            number: float = node.value
            return self._at(node, lambda: ast.Constant(2 * number or 1.0))
        return node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        return node  # a message

    def _swapped(self, node: ast.AST, operator: ast.AST, field: str) -> ast.AST:
        other = _SWAPS.get(type(operator))
        if other is None:
            return node
        changed = copy.copy(node)
        setattr(changed, field, other())
        return self._at(node, lambda: changed)


def mutants_of(file: Path) -> list[Mutant]:
    """All mutants of a file, in the order of the source."""
    changer = _Changer()
    changer.visit(ast.parse(file.read_text(encoding="utf-8")))
    name = file.relative_to(ROOT).as_posix()
    return [Mutant(name, line, number, what) for number, (line, what) in enumerate(changer.places)]


def mutated(mutant: Mutant) -> str:
    """The source with the change."""
    tree = _Changer(mutant.number).visit(ast.parse((ROOT / mutant.file).read_text(encoding="utf-8")))
    return ast.unparse(ast.fix_missing_locations(tree))


def _short(node: ast.AST) -> str:
    text = ast.unparse(ast.fix_missing_locations(copy.deepcopy(node))).split("\n")[0]
    return text if len(text) <= 60 else text[:57] + "..."


def files_of(package: str) -> Iterator[Path]:
    """Source files of a package."""
    yield from sorted(path for path in (ROOT / package).rglob("*.py") if path.name != "__init__.py")


def equivalents() -> dict[tuple[str, str], str]:
    """Why changes that are listed have no effect, by file and change."""
    rows = tomllib.loads(EQUIVALENTS.read_text(encoding="utf-8"))["mutant"]
    return {(row["file"], row["what"]): row["why"] for row in rows}


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
    why = equivalents().get((mutant.file, mutant.what))
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
            if run(None, [failed[1]], seconds)[0] != "survived":
                raise RuntimeError(f"{failed[1]} fails without a change:\n{output[-3000:]}")
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
    for number, place in enumerate((os.devnull, scratch / "output", scratch / "output")):
        os.dup2(os.open(place, os.O_RDWR | os.O_CREAT | os.O_APPEND), number)
    sys.path.insert(0, str(ROOT))
    if mutant is not None:
        module = mutant.file.removesuffix(".py").replace("/", ".")
        (scratch / "mutant.json").write_text(json.dumps({"module": module, "source": mutated(mutant)}))
        os.environ["V3STUDIO_MUTANT"] = str(scratch / "mutant.json")
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", marks]
    try:
        import_module("tests.support")  # finds the mutant before anything else is imported
        return int(pytest.main([*options, "--basetemp", str(scratch / "pytest"), *tests]))
    except BaseException:
        return 99


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
                near = sorted(same, key=lambda one, number=row["number"]: abs(one.number - number))  # type: ignore[misc]
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
        done = judge(mutant, package, chosen.limit, chosen.all, chosen.quick)
        results[package].append(done)
        print(f"{done.outcome:10} {done.file}:{done.line}  {done.what}  {done.by}", flush=True)
        if chosen.json:
            rows = {name: [vars(one) for one in found] for name, found in results.items()}
            chosen.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print("\npackage               mutants  equivalent  killed  timed out  survived  score")
    for package, found in results.items():
        kinds = ("equivalent", "killed", "timed out", "survived")
        same, killed, late, alive = (sum(one.outcome == kind for one in found) for kind in kinds)
        score = f"{100 * (killed + late) / (len(found) - same):.0f} %" if len(found) > same else "not run"
        print(f"{package:21} {len(found):7} {same:11} {killed:7} {late:10} {alive:9}  {score}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
