"""Results that modules pass to each other are models: no `dict[str, Any]` in what they take, return or hold."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("studio", "pipelines", "gui", "v3studio")
ALIASES = "studio/json_types.py"
READERS_AND_WRITERS = {
    "gui/state.py",  # v3studio-gui --log-state
    "pipelines/config/loading.py",  # a user's YAML
    "pipelines/estimate/estimate.py",  # v3studio estimate --json
    "pipelines/events/__init__.py",  # a line of JSON
    "pipelines/reports/calibration.py",  # figures of an event
    "pipelines/runs/status.py",  # v3studio status --json
    "pipelines/share/sharing.py",  # v3studio share --json
    "pipelines/takes/atomic_files.py",
    "pipelines/takes/kept_bakes.py",  # v3studio bake list --json
    "studio/bounded_files.py",  # any TOML
    "studio/calibration/manual/file.py",
    "studio/camera_files/annots_npy.py",
    "studio/camera_files/common.py",
    "studio/camera_files/dynamic_gaussians.py",
    "studio/camera_files/easymocap.py",
    "studio/camera_files/json_rigs.py",
    "studio/camera_files/opencv_storage.py",
    "studio/camera_files/rig_json.py",
    "studio/camera_files/toml_rigs.py",
    "studio/camera_files/transforms_json.py",
    "studio/cameras.py",  # a camera of rig.json
    "studio/coverage.py",  # from where a stream can be looked at, in its manifest
    "studio/errors.py",  # a message as JSON
    "studio/formats/camera_path.py",
    "studio/formats/videogs.py",
    "studio/playback/statistics.py",  # v3studio play --json
    "studio/settings.py",  # mistakes as pydantic lists them
    "studio/similarity.py",
    "studio/formats/glb.py",
    "studio/formats/sog.py",  # meta.json
    "studio/stream/encode/bake.py",  # entries of a manifest
    "studio/stream/encode/write_manifest.py",  # a manifest's metadata
    "studio/stream/manifest.py",
    "studio/stream/manifest_file.py",
    "studio/stream/metadata.py",
    "studio/stream/settings.py",
}
"""Files that may name a JSON object which no model describes, each a reader or writer of a file."""


def annotations(tree: ast.Module) -> Iterator[ast.expr]:
    """Those of signatures and of fields of classes and modules, and type aliases; not those of local variables."""
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


def with_untyped_dict(source: str) -> list[int]:
    """Lines whose annotation contains `dict[str, Any]`."""
    return [one.lineno for one in annotations(ast.parse(source)) if "dict[str, Any]" in ast.unparse(one)]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_untyped_dict_in_signatures_and_fields(package: str) -> None:
    files = [path for path in sorted((ROOT / package).rglob("*.py")) if path != ROOT / ALIASES]
    assert files
    wrong = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in files
        for line in with_untyped_dict(path.read_text(encoding="utf-8"))
    ]
    assert not wrong, "\n".join(wrong)


def test_json_objects_stay_with_readers_and_writers() -> None:
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    users = {path.relative_to(ROOT).as_posix() for path in files if "JsonObject" in path.read_text(encoding="utf-8")}
    assert users - {ALIASES} == READERS_AND_WRITERS
