"""Writes wheels of a few bytes; also the build backend of the small project in test_install.py."""

import zipfile
from pathlib import Path


def write_wheel(folder: Path, name: str, version: str, files: dict[str, str]) -> str:
    """Write a pure Python wheel with `files` (path to text) to `folder`; returns its file name."""
    module = name.replace("-", "_")
    info = f"{module}-{version}.dist-info"
    files = files | {
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: small\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    files[f"{info}/RECORD"] = "".join(f"{path},,\n" for path in [*files, f"{info}/RECORD"])
    file = f"{module}-{version}-py3-none-any.whl"
    with zipfile.ZipFile(folder / file, "w") as wheel:
        for path, text in files.items():
            wheel.writestr(path, text)
    return file


def build_editable(wheel_directory: str, config_settings: object = None, metadata_directory: object = None) -> str:
    """PEP 660; called by pip in the project's folder."""
    files = {
        "v3studio.pth": f"{Path.cwd()}\n",
        "v3studio-0.1.dist-info/entry_points.txt": "[console_scripts]\nv3studio = hello:main\n",
    }
    return write_wheel(Path(wheel_directory), "v3studio", "0.1", files)
