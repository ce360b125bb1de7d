"""JSON files of a take, as models that are checked when they are read."""

import errno
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from v3studio.studio.atomic_files import write_json
from v3studio.studio.bounded_files import BOUNDS, TextError, parse_json, read_bounded
from v3studio.studio.errors import StudioError, first_violation, reason_of
from v3studio.studio.json_types import JsonObject

_AGAIN = "Delete it and run again."


class Result(BaseModel):
    """Base of the models of JSON files in a take. Unknown keys, written by a later version, are kept."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False, use_attribute_docstrings=True)

    def to_json(self) -> JsonObject:
        """JSON-ready; fields that were never set are left out."""
        return self.model_dump(mode="json", exclude_unset=True)


Model = TypeVar("Model", bound=BaseModel)


def read_json(path: Path, limit: int = BOUNDS.size) -> Any:
    """The values in a file of at most `limit` bytes. Raises StudioError: `take.file_not_found`, `take.damaged`; and, if
    the file may be intact, `take.cannot_read`."""
    try:
        return parse_json(read_bounded(path, limit))
    except FileNotFoundError:
        raise StudioError("take.file_not_found", "no such file", file=path) from None
    except (TextError, OSError) as error:
        if isinstance(error, OSError) and error.errno not in (errno.EFBIG, errno.EISDIR):
            raise cannot_read(path, error) from None
        raise StudioError("take.damaged", f"cannot be read ({reason_of(error)})", file=path, fix=_AGAIN) from None


def cannot_read(path: Path, error: OSError) -> StudioError:
    """The error for a file that may be intact: the disk, the permissions, the memory or the number of open files is
    what failed."""
    fix = "Check the disk and its permissions, close other programs, and try again."
    return StudioError("take.cannot_read", f"cannot be read now ({reason_of(error)})", file=path, fix=fix)


def read_model(path: Path, model: type[Model]) -> Model:
    """Read a JSON file that `write_model` wrote. Raises StudioError: `take.file_not_found`, `take.damaged`."""
    return validated(path, read_json(path), model)


def validated(path: Path, content: Any, model: type[Model]) -> Model:
    """The model of what was read from a JSON file."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        where, problem = first_violation(error)
        raise StudioError("take.damaged", problem, file=path, fix=_AGAIN, key=where) from None


def write_model(path: Path, value: BaseModel, durable: bool = False) -> None:
    """Write a model as indented JSON, atomically, without fields never set. `durable`: as for `atomic_path`."""
    write_json(path, value.model_dump(mode="json", exclude_unset=True), durable)
