"""The changes that `scripts/mutation.py` can make to the code, one place at a time."""

from __future__ import annotations

import ast
import copy
import tomllib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
EQUIVALENTS = ROOT / "scripts" / "equivalent_mutants.toml"
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
        code: the source line, without the indentation.
        nth: 1 for the first such change of such a line in the file, and so on.
        outcome: "killed", "survived", "timed out", "unclear" (the test that failed does so without the change, too), or
            "equivalent", a change that is listed as one without an effect; empty before it ran.
        by: the test that failed, or why the change has no effect.
    """

    file: str
    line: int
    number: int
    what: str
    code: str = ""
    nth: int = 1
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
    changer, source = _Changer(), file.read_text(encoding="utf-8")
    changer.visit(ast.parse(source))
    name, lines = file.relative_to(ROOT).as_posix(), source.split("\n")
    found, seen = [], Counter[tuple[str, str]]()
    for number, (line, what) in enumerate(changer.places):
        code = lines[line - 1].strip()
        seen[what, code] += 1
        found.append(Mutant(name, line, number, what, code, seen[what, code]))
    return found


def mutated(mutant: Mutant) -> str:
    """The source with the change."""
    tree = _Changer(mutant.number).visit(ast.parse((ROOT / mutant.file).read_text(encoding="utf-8")))
    return ast.unparse(ast.fix_missing_locations(tree))


def _short(node: ast.AST) -> str:
    text = ast.unparse(ast.fix_missing_locations(copy.deepcopy(node))).split("\n")[0]
    return text if len(text) <= 60 else text[:57] + "..."


def equivalents() -> dict[tuple[str, str, str, int], str]:
    """Why changes that are listed have no effect, by the `key` of the mutant."""
    rows = tomllib.loads(EQUIVALENTS.read_text(encoding="utf-8"))["mutant"]
    return {(row["file"], row["what"], row["code"], row.get("nth", 1)): row["why"] for row in rows}


def key(mutant: Mutant) -> tuple[str, str, str, int]:
    """What tells a mutant from all others, also when other lines of the file change."""
    return mutant.file, mutant.what, mutant.code, mutant.nth


def concerned(file: Path, line: int) -> set[str]:
    """Names of the function and class that hold a line of a file, and of those in the file that call them, in turn."""
    holders = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    places = [node for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(node, holders)]
    found = {node.name for node in places if node.lineno <= line <= (node.end_lineno or 0)}
    names = {id(node): {word for one in ast.walk(node) if (word := _name(one))} for node in places}
    while more := {node.name for node in places if node.name not in found and names[id(node)] & found}:
        found |= more
    return found


def _name(node: ast.AST) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
