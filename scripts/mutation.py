"""Mutation testing: change one place of the code at a time and see whether a test fails.

    python scripts/mutation.py [--package studio/stream ...] [--count 30] [--seed 0] [--minutes 60] [--json FILE]

Mutants are drawn at random, the same ones for the same seed and code. Each runs the tests that mirror its package, in a
process forked from one that has imported the libraries; nothing on the disk is changed. What survives is either a test
that is missing or a change without an effect; the score counts both as survived. Prints a table and every survivor,
and with --json writes them to a file. It always exits with 0 when it could measure: the score is for people to judge.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
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
        outcome: "killed", "survived" or "timed out"; empty before it ran.
    """

    file: str
    line: int
    number: int
    what: str
    outcome: str = ""


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


def mirror_of(package: str, file: str) -> list[str]:
    """The tests of a package, those named after the file first."""
    stem = Path(file).stem
    found = [path for place in TESTS[package] for path in sorted((ROOT / place).rglob(f"test_*{stem}*.py"))]
    folders = [ROOT / place / Path(file).relative_to(package).parent for place in TESTS[package]]
    nearer = [folder for folder in folders if folder.is_dir()]
    places = [*found, *nearer, *(ROOT / place for place in TESTS[package])]
    return list(dict.fromkeys(str(place) for place in places))


def run(mutant: Mutant | None, tests: list[str], seconds: float) -> tuple[str, str]:
    """Run tests with a mutant, or without one, in a forked process.

    Returns:
        killed, survived or timed out; and what pytest printed.
    """
    with tempfile.TemporaryDirectory() as scratch:
        pid = os.fork()
        if pid == 0:
            os._exit(_child(mutant, tests, Path(scratch)))
        outcome, ended = "timed out", time.monotonic() + seconds
        while time.monotonic() < ended:
            done, status = os.waitpid(pid, os.WNOHANG)
            if done:
                outcome = "survived" if os.waitstatus_to_exitcode(status) == 0 else "killed"
                break
            time.sleep(0.1)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)  # programs that the tests started
        if outcome == "timed out":
            os.waitpid(pid, 0)
        return outcome, (Path(scratch) / "output").read_text(errors="replace")


def _child(mutant: Mutant | None, tests: list[str], scratch: Path) -> int:
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
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not window and not colmap"]
    try:
        import_module("tests.support")  # finds the mutant before anything else is imported
        return int(pytest.main([*options, "--basetemp", str(scratch / "pytest"), *tests]))
    except BaseException:
        return 99


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--package", action="append", choices=sorted(TESTS), help="default: all")
    parser.add_argument("--count", type=int, default=30, help="mutants of each package")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60, help="no mutant is started after this time")
    parser.add_argument("--json", type=Path, help="write the results to this file")
    chosen = parser.parse_args()
    for name in _LIBRARIES:
        import_module(name)
    end = time.monotonic() + 60 * chosen.minutes
    results: dict[str, list[Mutant]] = {}
    for package in chosen.package or TESTS:
        every = [mutant for file in files_of(package) for mutant in mutants_of(file)]
        drawn = random.Random(f"{chosen.seed} {package}").sample(every, min(chosen.count, len(every)))
        results[package] = []
        started = time.monotonic()
        outcome, output = run(None, mirror_of(package, drawn[0].file), 3600)
        if outcome != "survived":
            print(f"{package}: its tests fail without a change:\n{output[-3000:]}")
            return 1
        limit = 60 + 5 * (time.monotonic() - started)
        for mutant in drawn:
            if time.monotonic() > end:
                break
            done = replace(mutant, outcome=run(mutant, mirror_of(package, mutant.file), limit)[0])
            results[package].append(done)
            print(f"{done.outcome:9} {done.file}:{done.line}  {done.what}", flush=True)
            if chosen.json:
                rows = {name: [vars(one) for one in found] for name, found in results.items()}
                chosen.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print("\npackage               mutants  killed  timed out  survived  score")
    for package, found in results.items():
        counts = [sum(one.outcome == outcome for one in found) for outcome in ("killed", "timed out", "survived")]
        score = f"{100 * sum(counts[:2]) / len(found):.0f} %" if found else "not run"
        print(f"{package:21} {len(found):7} {counts[0]:7} {counts[1]:10} {counts[2]:9}  {score}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
