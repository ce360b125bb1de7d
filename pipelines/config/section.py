"""What all sections of the settings are."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import BaseModel, ConfigDict, Field


class Section(BaseModel):
    """Common rules: unknown keys are refused, values are checked strictly, models cannot be changed."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, use_attribute_docstrings=True, validate_default=True, allow_inf_nan=False
    )

    headings: ClassVar[dict[str, str]] = {}
    """Heading over a setting and those after it, by the setting's name."""


Color = tuple[
    Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)]
]
