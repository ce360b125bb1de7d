"""What a result is made from, as plain values that are compared and digested."""

from __future__ import annotations

from typing import Any

from pipelines.config import Config
from pipelines.takes.atomic_files import digest_of

Ingredients = dict[str, Any]
"""What a result is made from: settings by dotted name, digests of inputs and of other stages' results."""


def settings_of(config: Config, *names: str) -> Ingredients:
    """Settings by dotted name; a section stands for all settings in it (`capture.root` never counts: a capture may
    move, its files' digest tells whether it is the same)."""
    tree = config.model_dump(mode="json")
    found: Ingredients = {}

    def collect(prefix: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                collect(f"{prefix}.{key}", item)
        else:
            found[prefix] = value

    for name in names:
        value: Any = tree
        for part in name.split("."):
            value = value[part]
        collect(name, value)
    return found


def without(ingredients: Ingredients, *names: str) -> Ingredients:
    """Ingredients without the named ones."""
    return {name: value for name, value in ingredients.items() if name not in names}


def key_of(stage: str, version: int, *parts: Any) -> str:
    """Digest that names one unit's recipe."""
    return digest_of([stage, version, *parts])


def derived_seed(seed: int, *path: int | str) -> int:
    """A seed for one unit of work, so that going on after a stop equals never having stopped."""
    return int(digest_of([seed, *path])[:15], 16) % (2**31)
