"""Names for JSON values that no model describes."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

JsonObject: TypeAlias = dict[str, Any]
"""A JSON or YAML mapping as it was parsed, before a model or a reader checks it, or as a writer writes it.

Only readers and writers of files use it (see tests/test_types.py); what modules pass to each other are models.
"""

JsonData: TypeAlias = "bool | int | float | str | Sequence[JsonData] | Mapping[str, JsonData] | None"
"""A JSON value of any kind, where the set of names is open: settings by dotted name, figures by name."""
