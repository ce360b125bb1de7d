"""Packages whose exports are imported on first use (PEP 562).

Importing `studio.training.settings` runs `studio/training/__init__.py` first. If that file imported all its exports,
reading a settings file would load torch, OpenCV and FFmpeg. Therefore, packages with heavy modules list their exports
under `if TYPE_CHECKING:`, where type checkers and documentation tools read them, and `lazy_exports` imports each on
first use.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import sys
from types import ModuleType
from typing import Any


class _LazyPackage(ModuleType):
    __exports__: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        if name not in self.__exports__:
            raise AttributeError(f"module '{self.__name__}' has no attribute '{name}'")
        value = getattr(importlib.import_module(self.__exports__[name]), name)
        setattr(self, name, value)
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # the import system binds a submodule to its package; an export of the same name has precedence
        if name in self.__exports__ and isinstance(value, ModuleType):
            return
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.__exports__})


def lazy_exports(package: str) -> None:
    """Import the names that a package's `__init__.py` lists under `if TYPE_CHECKING:` on first use.

    Args:
        package: `__name__` of the package; only `from module import name` statements are read.
    """
    module = sys.modules[package]
    exports = {
        alias.name: node.module
        for block in ast.parse(inspect.getsource(module)).body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for node in block.body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    module.__dict__["__exports__"] = exports
    module.__class__ = _LazyPackage
