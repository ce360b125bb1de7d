"""The table of error and warning codes: every place in the source that names one, found in the syntax tree."""

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from generate.markdown import code, escaped, table

INTRODUCTION = """# Error codes

Every error and warning of V3 Studio has a stable code. The meaning of a code never changes; its text may. Programs
should rely on the code and its fields, not on the text.

In Python, an error is a `v3studio.StudioError` with the attributes `code`, `problem`, `file`, `value`, `fix` and
`fields`. With `--json`, the event that the command prints has the same fields.

This page is generated from the source and lists every place that raises a code. Words in *italics* are placeholders.
"""
_CODE = re.compile(r"[a-z][a-z0-9_]*(\.[a-z0-9_]+)+")

MAKERS = ("Error", "Message", "Warned", "warn")
"""Ends of the names of classes and functions that take a code and a problem: errors, `Message`, warnings."""


@dataclass(frozen=True)
class Site:
    """One place in the source that makes a message."""

    code: str
    problem: str
    fix: str


def errors_page(root: Path, packages: tuple[str, ...]) -> str:
    """Markdown of all codes that the packages under `root` name, by area."""
    sites: dict[str, list[Site]] = defaultdict(list)
    files = [file for package in packages for file in sorted((root / package).rglob("*.py"))]
    modules = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    constants = [_constants(module) for module in modules]
    uses = Counter(name for values in constants for name in values)
    unique = {name: value for values in constants for name, value in values.items() if uses[name] == 1}
    for module, own in zip(modules, constants, strict=True):
        for site in _sites(module, {**unique, **own}):
            sites[site.code].append(site)
    areas: dict[str, list[str]] = defaultdict(list)
    for name in sorted(sites):
        areas[name.split(".")[0]].append(name)
    lines = [INTRODUCTION, f"{len(sites)} codes in {len(areas)} areas.", ""]
    for area, names in areas.items():
        lines += [f"## {area} {{ #{area} }}", ""]
        rows = [
            (f'<a id="{name}"></a>{code(name)}', "<br>".join(dict.fromkeys(_words(site) for site in sites[name])))
            for name in names
        ]
        lines += [*table(("Code", "Message and fix"), *rows), ""]
    return "\n".join(lines)


def _words(site: Site) -> str:
    fix = f" **Fix:** {site.fix}" if site.fix.strip("*") not in ("", "fix") else ""
    return f"{site.problem}{fix}"


def sites(source: str) -> Iterator[Site]:
    """Every call in a module's source that makes a message with a code."""
    module = ast.parse(source)
    return _sites(module, _constants(module))


def _sites(module: ast.Module, known: Mapping[str, ast.expr]) -> Iterator[Site]:
    """The messages that a module makes, with the values of constants, and of `problem` and `fix` if they are set just
    before."""
    named = {id(part): words for statement, words in _named(module) for part in ast.walk(statement)}
    for node in ast.walk(module):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        first = node.args[0]
        if not isinstance(first, ast.Constant) or not isinstance(first.value, str) or not _CODE.fullmatch(first.value):
            continue
        keywords = {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg}
        problem = node.args[1] if len(node.args) > 1 else keywords.get("problem")
        if problem is not None and ast.unparse(node.func).endswith(MAKERS):
            words = {**known, **named.get(id(node), {})}
            fix = _text(keywords["fix"], words) if "fix" in keywords else ""
            yield Site(first.value, _text(problem, words), fix)


def _named(module: ast.Module) -> Iterator[tuple[ast.stmt, dict[str, ast.expr]]]:
    """Simple statements, with the `problem` and the `fix` that their block has named before."""
    for node in ast.walk(module):
        for name in ("body", "orelse", "finalbody"):
            words: dict[str, ast.expr] = {}
            for statement in statements if isinstance(statements := getattr(node, name, None), list) else ():
                if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) in ("problem", "fix"):
                    words[ast.unparse(statement.targets[0])] = statement.value
                elif not hasattr(statement, "body"):
                    yield statement, dict(words)


def _constants(module: ast.Module) -> dict[str, ast.expr]:
    """Texts and numbers that a module gives a name in capitals."""
    return {
        node.targets[0].id: node.value
        for node in module.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id.isupper()
        if isinstance(node.value, (ast.Constant, ast.JoinedStr))
    }


def _text(node: ast.expr, known: Mapping[str, ast.expr]) -> str:
    """A string expression as Markdown; what is only known at run time in italics."""
    if isinstance(node, ast.FormattedValue) and not isinstance(node.value, ast.BinOp):
        return _text(node.value, known)
    if isinstance(node, ast.Name) and node.id in known:
        before = {name: value for name, value in known.items() if name != node.id}  # which a text may contain
        return _text(known[node.id], before)
    if isinstance(node, ast.Constant):
        return escaped(f"{node.value:,}" if isinstance(node.value, int) else str(node.value))
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part, known) for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _text(node.left, known) + _text(node.right, known)
    if isinstance(node, ast.IfExp):
        return " / ".join(filter(None, (_text(node.body, known), _text(node.orelse, known))))
    if isinstance(node, ast.Call) and ast.unparse(node.func) in ("len", "sum"):
        return "*n*"
    inner = node.args if isinstance(node, ast.Call) else [node]  # arguments say more than a function's name
    names = [name for scope in (*inner, node) for part in ast.walk(scope) if (name := _name(part))]
    return f"*{escaped(names[0].strip('_').replace('_', ' '))}*" if names else "*...*"


def _name(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
