"""Results that modules pass to each other are models: no `dict[str, Any]` in what they take, return or hold."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("studio", "pipelines", "gui", "v3studio")
ALIASES = "studio/json_types.py"
READS_OR_WRITES = re.compile(
    r"\b(json\.\w+|(parse|read|write|dump)_(json|yaml|toml)|(to|from)_(json|dict)|model_dump|FileStorage)\b"
)


def annotations(tree: ast.Module) -> Iterator[ast.expr]:
    """Annotations of signatures and of fields of classes and modules, and type aliases; not those of local
    variables."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg]
            yield from (one.annotation for one in arguments if one is not None and one.annotation is not None)
            if node.returns is not None:
                yield node.returns
        elif isinstance(node, ast.ClassDef | ast.Module):
            for part in node.body:
                if isinstance(part, ast.AnnAssign):
                    yield part.annotation
                    if ast.unparse(part.annotation).endswith("TypeAlias") and part.value is not None:
                        yield part.value
                elif isinstance(part, ast.Assign) and isinstance(part.value, ast.Subscript):
                    yield part.value


@pytest.mark.parametrize("package", PACKAGES)
def test_no_untyped_dict_in_signatures_and_fields(package: str) -> None:
    files = [path for path in sorted((ROOT / package).rglob("*.py")) if path != ROOT / ALIASES]
    assert files
    wrong = [
        f"{path.relative_to(ROOT)}:{one.lineno}"
        for path in files
        if "Any" in (source := path.read_text(encoding="utf-8"))
        for one in annotations(ast.parse(source))
        if "dict[str, Any]" in ast.unparse(one)
    ]
    assert not wrong, "\n".join(wrong)


def test_json_objects_stay_with_readers_and_writers() -> None:
    """A file that names an object which no model describes parses or writes JSON itself, or reads camera files."""
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "JsonObject" in text and path != ROOT / ALIASES and ROOT / "studio/camera_files" not in path.parents:
            assert READS_OR_WRITES.search(text), path
