"""Trained Gaussians on disk: one safetensors file per frame, with metadata on how it was made."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safetensors import SafetensorError

from v3studio.pipelines.takes.files.json_files import Result, cannot_read
from v3studio.studio.atomic_files import atomic_path
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from torch import Tensor

    from v3studio.studio.gaussians import Gaussians

# A single metadata entry: safetensors does not keep the order of several, and equal runs must give equal bytes.
_ENTRY = "v3studio"


class FrameMetadata(Result):
    """The metadata of a file: what its tensors are."""

    key: str = ""  # digest of everything that it was made from
    group: int | None = None  # number of the group, counted from 0
    index: int | None = None  # of the frame in the take, counted from 0
    frame: int | None = None  # frame number in the footage
    step: int | None = None  # training step of a checkpoint
    digest: str = ""  # BLAKE2b-128 of the tensors' bytes, all that follows the file's header


def write_frame(path: Path, gaussians: Gaussians, about: FrameMetadata) -> None:
    """Write the Gaussians of a frame atomically, with metadata that `read_about` returns."""
    write_tensors(path, gaussians.state_dict(), about)


def write_tensors(path: Path, tensors: dict[str, Tensor], about: FrameMetadata) -> None:
    """Write tensors by name (a checkpoint, a network) atomically, with metadata that `read_about` returns."""
    from safetensors.torch import save

    contiguous = {name: value.contiguous() for name, value in tensors.items()}
    about = about.model_copy(update={"digest": _digest(save(contiguous))})
    data = save(contiguous, metadata={_ENTRY: json.dumps(about.to_json(), sort_keys=True)})
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)  # unlike safetensors' save_file, raises OSError on a full disk


def read_frame(path: Path) -> Gaussians:
    """Read the Gaussians of a frame, on the CPU. Raises StudioError: `take.not_trained`, `take.damaged`; and, if the
    file may be intact, `take.cannot_read`; MemoryError if it does not fit."""
    from v3studio.studio.gaussians import Gaussians

    try:
        return Gaussians.from_state_dict(_load(path))
    except FileNotFoundError:
        problem = "no such file"
        raise StudioError("take.not_trained", problem, file=path, fix="Run `v3studio train`.", stage="train") from None
    except SafetensorError as error:
        problem = f"cannot be read ({error})"
        fix = "Delete it and run `v3studio train`."
        raise StudioError("take.damaged", problem, file=path, fix=fix, stage="train") from None
    except OSError as error:
        raise cannot_read(path, error) from None


def read_tensors(path: Path, key: str, since: int = 0) -> dict[str, Tensor] | None:
    """Tensors that `write_tensors` wrote, by name, on the CPU; None if missing, damaged, of another `key` or older.
    Raises OSError or MemoryError if the file may be intact, but cannot be read."""
    if not has_key(path, key, since):
        return None
    try:
        return _load(path)
    except (SafetensorError, FileNotFoundError):
        return None


def intact(path: Path) -> bool:
    """Return whether the tensors in a file are those that were written. Raises OSError or MemoryError if it cannot be
    read."""
    try:
        _load(path)
    except SafetensorError:
        return False
    return True


def read_about(path: Path) -> FrameMetadata | None:
    """The metadata that `write_frame` wrote; None if there is no such file, it is damaged or has no such metadata.
    Raises OSError or MemoryError if it cannot be read."""
    try:
        with _header(path) as file:
            return FrameMetadata.model_validate_json((file.metadata() or {})[_ENTRY])
    except (SafetensorError, FileNotFoundError, IsADirectoryError, KeyError, ValueError):
        return None  # pydantic's ValidationError is a ValueError


def has_key(path: Path, key: str, since: int = 0) -> bool:
    """Return whether a file was made from what `key` is the digest of, and not before `since` (modification time in
    ns)."""
    about = read_about(path)
    return about is not None and about.key == key and path.stat().st_mtime_ns >= since


@contextmanager
def _header(path: Path) -> Iterator[Any]:
    """A file whose header fits its size. Raises SafetensorError for a damaged file, OSError, MemoryError."""
    from safetensors import safe_open

    with path.open("rb"):
        pass  # safetensors takes a file for missing that could not be opened for other reasons
    with safe_open(path, framework="np") as file:
        yield file


def _load(path: Path) -> dict[str, Tensor]:
    """The tensors in a file. Raises SafetensorError for a damaged file, OSError, MemoryError."""
    from safetensors.torch import load

    with _header(path):
        pass  # nothing larger than what the header says is read
    data = path.read_bytes()
    tensors = load(data)
    about = _metadata(data)
    if about.digest != _digest(data):
        raise SafetensorError("checksum differs")
    return tensors


def _metadata(data: bytes) -> FrameMetadata:
    """The metadata in a file's header; from its bytes, since the file may be replaced meanwhile."""
    try:
        header = json.loads(data[_HEADER : _HEADER + _header_bytes(data)])
        return FrameMetadata.model_validate_json(header.get("__metadata__", {}).get(_ENTRY, "{}"))
    except ValueError:  # pydantic's ValidationError is one
        return FrameMetadata()


_HEADER = 8  # bytes of the length that the file begins with (safetensors' format)


def _header_bytes(data: bytes) -> int:
    return int.from_bytes(data[:_HEADER], "little")


def _digest(data: bytes) -> str:
    """BLAKE2b-128 of what follows the header."""
    return hashlib.blake2b(memoryview(data)[_HEADER + _header_bytes(data) :], digest_size=16).hexdigest()
