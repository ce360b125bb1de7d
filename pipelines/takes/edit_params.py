"""The take's edits as parameters of stages."""

from __future__ import annotations

from studio.edits.edit_list import EditList
from studio.json_types import JsonData

PREFIX = "edits."
"""Of the names of parameters that are edits."""


def edit_params(edits: EditList, *names: str) -> dict[str, JsonData]:
    """What is edited, by name, as parameters of a stage: nothing without edits, so that results without them stay as
    they are.

    Args:
        edits: of the take.
        names: of the edits; none: all but the marked details, which only training uses.
    """
    values = edits.model_dump(mode="json")
    if values["crop"] is not None:
        del values["crop"]["training"]  # whether training sees the box, too, changes nothing here
    chosen = names or [name for name in values if name != "details"]
    return {f"{PREFIX}{name}": values[name] for name in chosen if values[name] not in (None, [])}
