"""The base class of all settings models, and the metadata of their fields.

Each package of the library declares its settings once, as fields of a frozen pydantic model in its `settings.py`. A
field has a default, bounds, its documentation (the string below it) and, in `Annotated`, the results that become stale
when it changes (`Affects`) and the heading under which it is listed (`Heading`). The settings file, `v3studio config`,
the window and the staleness check all read these models; nothing is declared twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, ClassVar, Self, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic.fields import FieldInfo

RESULTS = {
    "cameras_from_file": "cameras read from the capture's calibration file",
    "cameras_from_images": "cameras calibrated from the footage by structure from motion",
    "cameras_from_target": "cameras calibrated from footage of a calibration target",
    "cameras_from_points": "cameras calibrated from manually marked tie points",
    "calibration_masks": "masks used to restrict feature detection during calibration",
    "training_views": "images, masks and cameras as training sees them",
    "grouping": "which frames form a group",
    "initial_points": "the initial points of each keyframe",
    "keyframe": "trained keyframes, and with them all frames after them",
    "later_frames": "trained frames after a keyframe",
    "joint_frames": "frames of a group after joint training",
    "videos": "the encoded groups of the stream",
    "manifest": "the stream's manifest",
    "sound": "the stream's sound",
    "evaluation": "the evaluation and its report",
}
"""Results that settings can affect: name to description. A result is stale when a setting that affects it changes."""


@dataclass(frozen=True)
class Affects:
    """Results that become stale when the field changes. `Affects()`: none.

    A field without this marker uses `Settings.affects` of its class; if that is None, it affects the same results as
    the field that contains its model.

    Raises:
        ValueError: a name is not in `RESULTS`.
    """

    results: tuple[str, ...]

    def __init__(self, *results: str) -> None:
        unknown = [name for name in results if name not in RESULTS]
        if unknown:
            raise ValueError(f"'{unknown[0]}' is not a result; known results: {', '.join(RESULTS)}")
        object.__setattr__(self, "results", results)


@dataclass(frozen=True)
class Heading:
    """Heading under which this field and the following ones are listed, up to the next heading."""

    text: str


@dataclass(frozen=True)
class Unbounded:
    """Marks a number without bounds, with the reason."""

    reason: str


class Conflict(ValueError):
    """Raised by validators of settings; pydantic wraps it in a ValidationError.

    Attributes:
        problem: what is wrong, as a clause.
        fix: what to do, as a sentence; "" if that is obvious.
        names: fields that contradict each other, without their section; empty in validators of a single field.
        secret: whether the value must not be shown or logged.
    """

    def __init__(self, problem: str, fix: str = "", *names: str, secret: bool = False) -> None:
        super().__init__(f"{problem}. {fix}" if fix else problem)
        self.problem, self.fix, self.names, self.secret = problem, fix, names, secret


class Settings(BaseModel):
    """Base class of all settings: frozen, with validated defaults; rejects unknown names, NaN and infinity.

    Raises:
        pydantic.ValidationError: (a ValueError) on construction: an unknown name, a value outside its bounds, or values
            that contradict each other. `error.errors()` has the field's name as `loc`.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, use_attribute_docstrings=True, validate_default=True, allow_inf_nan=False,
        hide_input_in_errors=True,  # it may contain credentials
    )  # fmt: skip

    @model_validator(mode="before")
    @classmethod
    def _lists_without_brackets(cls, values: Any) -> Any:
        """`cam05, cam99` is the list [cam05, cam99] where a list is meant."""
        if not isinstance(values, dict):
            return values
        return {
            name: as_list(value, plain=is_list_of_text(field)) if isinstance(value, str) and _is_list(field) else value
            for name, value in values.items()
            for field in [cls.model_fields.get(name)]
        }

    affects: ClassVar[Affects | None] = None
    """Results affected by fields without their own `Affects`. None: those of the field that contains the model."""

    def replace(self, **changes: Any) -> Self:
        """A validated copy with some values replaced.

        Raises:
            pydantic.ValidationError: as on construction.
        """
        return type(self).model_validate({name: getattr(self, name) for name in type(self).model_fields} | changes)


_Marker = TypeVar("_Marker", Affects, Heading, Unbounded)


def as_list(text: str, *, plain: bool = False) -> Any:
    """The items of a list that was written without brackets; text that cannot be one is returned as it is.

    Args:
        text: such as "cam05, cam99".
        plain: leave every item as the text that it is, so that camera 01 does not become 1.
    """
    from studio.yaml_text import YamlError, parse_yaml

    if not text.strip() or not set(text).isdisjoint("[]{}&*!:"):  # nothing nested
        return text
    try:
        return parse_yaml(f"[{text}]", plain=plain)
    except YamlError:
        return text


def _is_list(field: FieldInfo | None) -> bool:
    """Whether a field is a list or a tuple, or that or null, and never text."""
    kinds = [field.annotation] if field is not None else []
    if get_origin(field.annotation if field is not None else None) in (Union, UnionType):
        kinds = [part for part in get_args(kinds[0]) if part is not type(None)]
    return bool(kinds) and all(get_origin(part) in (tuple, list) for part in kinds)


def is_list_of_text(field: FieldInfo | None) -> bool:
    """Whether a field is a list or a tuple (or nested ones) with text, such as names of cameras, or that or null."""

    def has_text(kind: Any) -> bool:
        if get_origin(kind) is Annotated:
            return has_text(get_args(kind)[0])
        return kind is str or (get_origin(kind) in (tuple, list) and any(map(has_text, get_args(kind))))

    kinds = (field.annotation, *get_args(field.annotation)) if field is not None and _is_list(field) else ()
    return any(map(has_text, kinds))


def marker(field: FieldInfo, kind: type[_Marker]) -> _Marker | None:
    """The field's marker of the given kind in `Annotated`; None if there is none."""
    return next((item for item in field.metadata if isinstance(item, kind)), None)


def submodel(field: FieldInfo) -> type[Settings] | None:
    """The field's settings model; None for a plain value."""
    kind = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, Settings) else None


def affected(model: type[Settings], prefix: str = "", outer: Affects | None = None) -> dict[str, tuple[str, ...]]:
    """Results that each field of a model affects.

    Args:
        model: fields of nested models are included.
        prefix: put before each name.
        outer: default for fields and models without `Affects`.

    Returns:
        dotted field name to names of results, for all fields that are not models themselves.
    """
    outer = model.affects or outer
    found: dict[str, tuple[str, ...]] = {}
    for name, field in model.model_fields.items():
        own = marker(field, Affects) or outer
        inner = submodel(field)
        if inner is None:
            found[f"{prefix}{name}"] = own.results if own else ()
        else:
            found |= affected(inner, f"{prefix}{name}.", own)
    return found


Name = Annotated[str, Field(min_length=1)]
"""Text that is never empty: where it is optional, null means none."""
Unit = Annotated[float, Field(ge=0, le=1)]
"""0 to 1."""
Color = tuple[Unit, Unit, Unit]
"""Red, green, blue; 0 to 1."""
