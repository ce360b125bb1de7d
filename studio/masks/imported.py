"""Masks from a source in a Python module of the user's: `capture.masks: MODULE:NAME`."""

import importlib
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from v3studio.studio.errors import StudioError
from v3studio.studio.masks.mask_source import MaskSource

_LOCK = threading.Lock()


def open_imported(path: str) -> tuple[MaskSource, str]:
    """The source that MODULE:NAME names, and its description. Raises StudioError: it cannot be used."""
    name, _, attribute = path.partition(":")
    source = getattr(_module(name, path), attribute, None)
    if isinstance(source, type) or not isinstance(source, MaskSource):
        problem = f"capture.masks is {path}, but {attribute} in the module {name} is not a source of masks"
        fix = (
            "Write @v3studio.FunctionMaskSource above the function, or name an object with the methods of "
            "v3studio.MaskSource."
        )
        raise StudioError("mask.not_a_source", problem, value=path, fix=fix, setting="capture.masks")
    return source, path


def _module(name: str, path: str) -> ModuleType:
    """The module. If it was not imported yet, it is not looked for in the working directory, where anybody's files may
    be, such as a take's: the settings of a take must not run them."""
    main = sys.modules.get("__main__")
    if main is not None and Path(getattr(main, "__file__", None) or "").stem == name:
        return main
    if name in sys.modules:
        return sys.modules[name]
    try:
        with _LOCK, _without_working_directory():
            return importlib.import_module(name)
    except ImportError as error:
        problem = f"capture.masks is {path}, but the module {name} cannot be imported ({error})"
        fix = "Install it, or set PYTHONPATH to its folder."
        raise StudioError("mask.cannot_import", problem, value=path, fix=fix, setting="capture.masks") from None


@contextmanager
def _without_working_directory() -> Iterator[None]:
    wanted = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(entry)]
    before = list(sys.path)
    here = Path.cwd().resolve()
    sys.path[:] = [entry for entry in before if entry in wanted or (entry and Path(entry).resolve() != here)]
    try:
        yield
    finally:
        sys.path[:] = before
