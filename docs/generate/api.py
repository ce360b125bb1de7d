"""Pages of the Python reference: one per public module, filled by mkdocstrings."""

import ast
from pathlib import Path

MODULES = {
    "v3studio": "The public interface",
    "v3studio.stream": "Streams, group by group",
    "v3studio.calibration": "Boards and marked points",
    "v3studio.studio.gaussians": "Gaussians",
    "v3studio.studio.cameras": "Cameras",
    "v3studio.studio.capture": "Files of a capture",
    "v3studio.studio.footage": "Footage",
    "v3studio.studio.masks": "Masks",
    "v3studio.studio.calibration": "Calibration",
    "v3studio.studio.camera_files": "Camera files",
    "v3studio.studio.meshing": "Visual hull and initial points",
    "v3studio.studio.training": "Training",
    "v3studio.studio.rasterizer": "Rasterizer",
    "v3studio.studio.stream": "Stream",
    "v3studio.studio.playback": "Playback",
    "v3studio.studio.formats": "Formats of other programs",
    "v3studio.studio.metrics": "Metrics",
    "v3studio.studio.errors": "Errors",
}

QUICK_START = """import v3studio as v3

take = v3.Take.create("my-take")
figures = v3.run(take, {"capture.root": "footage", "bake.quality": 24}, on_event=print)
print(figures["evaluate"]["psnr_decoded"], "dB")
with v3.StreamReader.open(take.stream) as reader:
    splats, camera = reader.gaussians(0), v3.read_rig(take.rig)["cam0"].undistorted()
    print(v3.rasterize(splats, camera).image.shape)
v3.share(take, "site")
"""

INTRODUCTION = """# Python API

{quick_start}

{promise}

The documentation of every function states shapes, units, ranges and exceptions. These conventions apply throughout:
OpenCV camera axes (x right, y down, z forward), pixel coordinates from the outer corner of the top-left pixel,
quaternions with w first, images as (H, W, C).

"""
PROMISE_PUBLIC = """The package `v3studio` is the public interface for scripts: it is versioned, and the changelog lists
every change. The packages under `v3studio.studio` are the library behind it. Use them if you need more, but they may
change between versions."""
PROMISE_LIBRARY = "The packages under `v3studio.studio` are the library. They may change between versions."


def api_pages(root: Path) -> dict[str, str]:
    """{file name: Markdown} of the overview and of every module that exists."""
    modules = {name: title for name, title in MODULES.items() if _file(root, name) is not None}
    promise = PROMISE_PUBLIC if "v3studio" in modules else PROMISE_LIBRARY
    rows = "".join(f"- [`{name}`]({name}.md): {title}\n" for name, title in modules.items())
    pages = {"index.md": INTRODUCTION.format(quick_start=f"```python\n{QUICK_START}```", promise=promise) + rows}
    for name, title in modules.items():
        pages[f"{name}.md"] = f"# {title}\n\n::: {name}\n{_members(root, name)}"
    return pages


def _members(root: Path, name: str) -> str:
    names = _exported(_file(root, name))
    if not names:
        return ""
    listed = "".join(f"        - {member}\n" for member in names)
    return f"    options:\n      members:\n{listed}"


def _file(root: Path, name: str) -> Path | None:
    whole = root.joinpath(*name.split("."))
    inside = root.joinpath(*name.split(".")[1:])  # its packages lie beside the folder v3studio
    files = (file for path in (whole, inside) for file in (path / "__init__.py", path.with_suffix(".py")))
    return next((file for file in files if file.is_file()), None)


def _exported(file: Path | None) -> list[str]:
    """The names that the stub of a module imports, or else those in its `__all__`; empty where it has neither."""
    if file is None:
        return []
    stub = file.with_suffix(".pyi")
    if stub.is_file():
        imports = ast.walk(ast.parse(stub.read_text(encoding="utf-8")))
        return sorted(alias.name for node in imports if isinstance(node, ast.ImportFrom) for alias in node.names)
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return [str(name) for name in ast.literal_eval(node.value)]
    return []
