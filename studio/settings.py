"""What all settings models are. Each room of the library declares its own settings once, on this base."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """Frozen, strict about unknown names, and documented: the text under a field is its documentation everywhere.

    Raises:
        pydantic.ValidationError: (a ValueError) an unknown name, or a value that its field refuses.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, use_attribute_docstrings=True, validate_default=True, allow_inf_nan=False
    )

    headings: ClassVar[dict[str, str]] = {}
    """Heading over a setting and those after it, by the setting's name, for the window and the documentation."""


Color = tuple[
    Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)]
]
"""Red, green, blue; 0 to 1."""
