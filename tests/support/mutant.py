"""Loads one module of the project with a changed source, for `make mutation`.

The variable V3STUDIO_MUTANT names a JSON file with `module` and `source`. Programs that tests start read it too, since
they import this package first.
"""

from __future__ import annotations

import importlib.machinery
import json
import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder, SourceLoader
from pathlib import Path
from types import ModuleType

VARIABLE = "V3STUDIO_MUTANT"


class _Loader(SourceLoader):
    def __init__(self, path: str, source: bytes) -> None:
        self._path, self._source = path, source

    def get_filename(self, fullname: str) -> str:
        return self._path

    def get_data(self, path: str) -> bytes:
        if path != self._path:
            raise OSError(f"{path} is not read")  # no cached bytecode of the unchanged source
        return self._source


class MutantFinder(MetaPathFinder):
    """Finds one module, with the given source."""

    def __init__(self, module: str, source: str) -> None:
        self._module, self._source = module, source.encode()

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The spec of the module; None for all others."""
        if fullname != self._module:
            return None
        file = Path(__file__).parents[2].joinpath(*fullname.split("."))
        is_package = file.is_dir()
        place = str(file / "__init__.py" if is_package else file.with_suffix(".py"))
        spec = importlib.machinery.ModuleSpec(fullname, _Loader(place, self._source), origin=place)
        spec.has_location = True
        if is_package:
            spec.submodule_search_locations = [str(file)]
        return spec


def install() -> None:
    """Find the mutant first, if the environment names one."""
    if VARIABLE in os.environ and not any(isinstance(finder, MutantFinder) for finder in sys.meta_path):
        mutant = json.loads(Path(os.environ[VARIABLE]).read_text(encoding="utf-8"))
        sys.meta_path.insert(0, MutantFinder(mutant["module"], mutant["source"]))
