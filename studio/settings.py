"""The base class of all settings models, and the metadata of their fields.

Each package of the library declares its settings once, as fields of a frozen pydantic model in its `settings.py`. A
field has a default, bounds, its documentation (the string below it) and, in `Annotated`, the results that become stale
when it changes (`Affects`), the heading under which it is listed (`Heading`), and what null is called (`Empty`). The
settings file, `v3studio config`, the window and the staleness check all read these models; nothing is declared twice.
"""

import difflib
import json
import os
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache, partial
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo

from v3studio.studio.bounded_files import TextError
from v3studio.studio.errors import Message, StudioError, violation
from v3studio.studio.json_types import JsonObject

COMMAND_LINE = "command line"
OVERRIDES = "overrides"
"""Named in place of a file in errors about what was given there; overrides come from a command or from Python."""


class Affects:
    """Results that become stale when the field changes, by the names with which stages ask for their settings
    (`settings_affecting` in `pipelines.stages.params`), such as "keyframe": keyframes, and with them all frames after
    them. `Affects()`: none. A field without this marker uses `Settings.affects` of its class; if that is None, it
    affects the same results as the field that contains its model."""

    def __init__(self, *results: str) -> None:
        self.results = results


@dataclass(frozen=True)
class Heading:
    """Heading under which this field and the following ones are listed, up to the next heading."""

    text: str


@dataclass(frozen=True)
class Empty:
    """The text that the window shows instead of null, an empty list, an empty mapping or an empty text."""

    text: str


@dataclass(frozen=True)
class Unbounded:
    """Marks a number without bounds, with the reason."""

    reason: str


class Conflict(ValueError):
    """Raised by validators of settings; becomes a StudioError. `problem` is a clause; `fix` a sentence, "" if that is
    obvious; `names` are fields that contradict each other, without their section; none in validators of a single field.
    `secret`: the value must not be shown or logged."""

    def __init__(self, problem: str, fix: str = "", *names: str, secret: bool = False) -> None:
        super().__init__(f"{problem}. {fix}" if fix else problem)
        self.problem, self.fix, self.names, self.secret = problem, fix, names, secret


class Settings(BaseModel):
    """Base class of all settings: frozen, with validated defaults; rejects unknown names, NaN and infinity. StudioError
    on construction: an unknown name (`settings.unknown`), a value outside its bounds, or values that contradict each
    other (`settings.invalid`); its fields `setting` and `settings` name them. On assignment: `settings.immutable`."""

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

    if not TYPE_CHECKING:  # type checkers read the names and types of the fields instead

        def __init__(self, **values: Any) -> None:
            try:
                super().__init__(**values)
            except ValidationError as error:
                raise refused(error, type(self), type(self).__name__) from None

        # nested models are validated with the outer one, whose error names the whole path
        __init__.__pydantic_base_init__ = True

        def __setattr__(self, name: str, value: Any) -> None:
            problem = f"{type(self).__name__}.{name} cannot be assigned, because settings are immutable"
            fix = f"Use .replace({name}=...), which returns a copy."
            raise StudioError("settings.immutable", problem, fix=fix, setting=name)

    affects: ClassVar[Affects | None] = None
    """Results affected by fields without their own `Affects`. None: those of the field that contains the model."""

    def replace(self, **changes: Any) -> Self:
        """A validated copy with some values replaced. Raises StudioError: as on construction."""
        return type(self)(**{name: getattr(self, name) for name in type(self).model_fields} | changes)


_Marker = TypeVar("_Marker", Affects, Empty, Heading, Unbounded)


def as_list(text: str, *, plain: bool = False) -> Any:
    """The items of a list that was written without brackets ("cam05, cam99"); text that cannot be one is returned as it
    is. `plain`: leave every item as the text that it is, so that camera 01 does not become 1."""
    from v3studio.studio.yaml_text import parse_yaml

    if not text.strip() or not set(text).isdisjoint("[]{}&*!:"):  # nothing nested
        return text
    try:
        return parse_yaml(f"[{text}]", plain=plain)
    except TextError:
        return text


def _is_list(field: FieldInfo | None) -> bool:
    """Return whether a field is a list or a tuple, or that or null, and never text."""
    kinds = [field.annotation] if field is not None else []
    if get_origin(field.annotation if field is not None else None) in (Union, UnionType):
        kinds = [part for part in get_args(kinds[0]) if part is not type(None)]
    return bool(kinds) and all(get_origin(part) in (tuple, list) for part in kinds)


def is_list_of_text(field: FieldInfo | None) -> bool:
    """Return whether a field is a list or a tuple (or nested ones) with text, such as names of cameras, or that or
    null."""

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


@cache
def affected(model: type[Settings], prefix: str = "", outer: Affects | None = None) -> dict[str, tuple[str, ...]]:
    """Dotted names of the settings of a model and of the models in it, to the results that each affects; `outer` is
    the default without `Affects`."""
    outer = model.affects or outer
    results: dict[str, tuple[str, ...]] = {}
    for name, field in model.model_fields.items():
        own = marker(field, Affects) or outer
        inner = submodel(field)
        if inner is None:
            results[f"{prefix}{name}"] = own.results if own else ()
        else:
            results |= affected(inner, f"{prefix}{name}.", own)
    return results


def field_named(model: type[Settings], name: str) -> FieldInfo | None:
    """The field with a dotted name; None if there is no such setting."""
    field, section = None, model
    for part in name.split("."):
        field = section.model_fields.get(part) if section is not None else None
        if field is None:
            return None
        section = submodel(field)  # type: ignore[assignment]
    return field


def nearest_sentence(model: type[Settings], name: str) -> str:
    """The fix for an unknown setting: the most similar setting or section, if one is similar."""
    close = partial(difflib.get_close_matches, n=1)
    known = list(affected(model))
    sections = sorted({setting.rpartition(".")[0] for setting in known})
    tails = {setting.rpartition(".")[2]: setting for setting in known}
    last = name.rpartition(".")[2]
    near = (
        ("." not in name and close(name, sections, cutoff=0.5))
        # the usual mistake is a correct name in the wrong section
        or close(name, [setting for setting in known if setting.rpartition(".")[2] == last], cutoff=0.0)
        or close(name, known, cutoff=0.5)
        or [tails[setting] for setting in close(last, tails, cutoff=0.5)]
    )
    return f"Did you mean {near[0]}?" if near else "`v3studio config` lists all settings."


def refused(
    error: ValidationError, model: type[Settings], where: str | os.PathLike[str], given: Collection[str] = ()
) -> StudioError:
    """A pydantic error as a StudioError: one sentence per mistake, with file (`where`, or another source), setting,
    value and fix. Its code is `settings.unknown` or `settings.invalid`; for several mistakes `settings.invalid`, whose
    field `mistakes` contains each as `Message.to_dict()`."""
    mistakes = [_mistake(dict(problem), model, where, given) for problem in error.errors()]
    if len(mistakes) == 1:
        (only,) = mistakes
        return StudioError(only.code, only.problem, file=only.file, value=only.value, fix=only.fix, **only.fields)
    lines = "\n".join(str(mistake) for mistake in mistakes)
    return StudioError("settings.invalid", lines, mistakes=[mistake.to_dict() for mistake in mistakes])


def _mistake(
    problem: JsonObject, model: type[Settings], where: str | os.PathLike[str], given: Collection[str]
) -> Message:
    location = [str(part) for part in problem["loc"]]
    name = ".".join(location)
    known = affected(model)
    setting = next(
        (".".join(location[:n]) for n in range(len(location), 0, -1) if ".".join(location[:n]) in known), name
    )
    if setting in given or name in given:
        where = OVERRIDES
    elif where != OVERRIDES and any(other.startswith(f"{name}.") for other in given):  # a rule across several settings
        where = f"{os.fspath(where)} and {OVERRIDES}"
    kind, given_value = problem["type"], problem.get("input")
    if kind == "extra_forbidden":
        fix = nearest_sentence(model, name)
        return Message("settings.unknown", f"unknown setting {name}", where, given_value, fix, {"setting": name})
    fields: JsonObject = {"setting": setting}
    fix = ""
    cause = problem.get("ctx", {}).get("error")
    if isinstance(cause, Conflict):
        text, fix = cause.problem, cause.fix
        if cause.secret:
            text, given_value = f"{name} {text}", None
        elif cause.names:
            fields["settings"] = [".".join([*location, other]) for other in cause.names]
            text = f"{name}: {text}" if name else text
            given_value = None
        else:
            text = f"{name} = {_plain(given_value)} {'' if text.startswith('must') else 'is invalid: '}{text}"
    elif kind in ("model_type", "model_attributes_type"):
        text = f"{name} = {given_value!r} is not a section"
        fix = f"Indent settings under it, one per line ({name}: ...)."
    else:
        words = violation(problem)
        text = f"{name} = {_plain(given_value)} {'' if words.startswith(('must', 'is ')) else 'is invalid: '}{words}"
        fix = _default_sentence(model, setting)
    return Message("settings.invalid", text, where, given_value, fix, fields)


def _default_sentence(model: type[Settings], name: str) -> str:
    """A sentence on the default of a setting; "" for those of nested models."""
    field = field_named(model, name)
    if field is None or field.is_required():
        return ""
    value = field.get_default(call_default_factory=True)
    items = list(value) if isinstance(value, tuple) else [value]
    plain = all(isinstance(item, str | int | float | None) for item in items)
    return f"The default is {json.dumps(value).strip(chr(34))}." if plain else ""


def _plain(value: Any) -> str:
    return f"'{value}'" if isinstance(value, str) else repr(value)


Name = Annotated[str, Field(min_length=1)]  # text that is never empty: where it is optional, null means none
Unit = Annotated[float, Field(ge=0, le=1)]  # 0 to 1
Color = tuple[Unit, Unit, Unit]  # red, green, blue; 0 to 1
