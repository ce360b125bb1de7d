"""What results are made from, as plain values that are compared and digested."""

from typing import Any, TypeAlias

from pipelines.config import Config
from pipelines.takes.atomic_files import digest_of
from studio.json_types import JsonData
from studio.settings import affected

Params: TypeAlias = dict[str, JsonData]  # settings by dotted name, digests of inputs and of other stages' results


def settings_of(config: Config, *names: str) -> Params:
    """Values of settings by dotted name; the name of a section selects all settings in it.

    `capture.root` is never included: a capture may move, and the digest of its files identifies it.
    """
    tree = config.model_dump(mode="json")
    found: Params = {}

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


def settings_affecting(config: Config, *results: str) -> Params:
    """Settings by dotted name that affect any of `results`, as their fields declare with `Affects`."""
    return settings_of(config, *(name for name, own in affected(Config).items() if not set(results).isdisjoint(own)))


def key_of(stage: str, version: int, *parts: Any) -> str:
    """Digest of everything that a unit is made from."""
    return digest_of([stage, version, *parts])


def derived_seed(seed: int, *path: int | str) -> int:
    """A seed for one unit of work, so that a resumed run equals an uninterrupted one."""
    return int(digest_of([seed, *path])[:15], 16) % (2**31)
