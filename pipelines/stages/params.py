"""The parameters that results are made from, as plain values that are compared and digested."""

from typing import Any, TypeAlias

from v3studio.pipelines.config.config import Config, values_of
from v3studio.pipelines.takes.files.digests import digest_of
from v3studio.studio.json_types import JsonData
from v3studio.studio.settings import affected

Params: TypeAlias = dict[str, JsonData]  # settings by dotted name, digests of inputs and of other stages' results


def settings_affecting(config: Config, *results: str) -> Params:
    """Settings by dotted name that affect any of `results`, as their fields declare with `Affects`; those of a record
    by the names of its items. `capture.root` is never among them: a capture may move, and the digest of its files
    identifies it."""
    affecting: Params = {}
    for name, value in values_of(config).items():
        if not set(results).isdisjoint(affected(Config)[name]):
            affecting |= (
                {f"{name}.{key}": item for key, item in value.items()} if isinstance(value, dict) else {name: value}
            )
    return affecting


def key_of(stage: str, version: int, *parts: Any) -> str:
    """Digest of everything that a unit is made from."""
    return digest_of([stage, version, *parts])


def derived_seed(seed: int, *path: int | str) -> int:
    """A seed for one unit of work, so that a resumed run equals an uninterrupted one."""
    return int(digest_of([seed, *path])[:15], 16) % (2**31)
