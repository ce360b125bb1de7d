"""Trained Gaussians on disk: one safetensors file per frame, with metadata on how it was made."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.takes.files.json_files import Result
from v3studio.studio.atomic_files import atomic_path
from v3studio.studio.errors import StudioError, reason_of

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
    """Read the Gaussians of a frame, on the CPU."""
    from safetensors import SafetensorError

    from v3studio.studio.gaussians import Gaussians

    try:
        return Gaussians.from_state_dict(_load(path))
    except FileNotFoundError:
        problem = "no such file"
        raise StudioError("take.not_trained", problem, file=path, fix="Run `v3studio train`.", stage="train") from None
    except (SafetensorError, OSError) as error:
        problem = f"cannot be read ({reason_of(error)})"
        fix = "Delete it and run `v3studio train`."
        raise StudioError("take.damaged", problem, file=path, fix=fix, stage="train") from None


def read_tensors(path: Path, key: str, since: int = 0) -> dict[str, Tensor] | None:
    """Tensors that `write_tensors` wrote, by name, on the CPU; None if missing, damaged, of another `key` or older."""
    from safetensors import SafetensorError

    if not has_key(path, key, since):
        return None
    try:
        return _load(path)
    except (SafetensorError, OSError):
        return None


def intact(path: Path) -> bool:
    """Whether a file can be read and its tensors are those that were written."""
    from safetensors import SafetensorError

    try:
        _load(path)
    except (SafetensorError, OSError):
        return False
    return True


def read_about(path: Path) -> FrameMetadata | None:
    """The metadata that `write_frame` wrote; None if there is no such file, it is damaged or has no such metadata."""
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        return None
    try:
        with safe_open(path, framework="np") as file:
            return FrameMetadata.model_validate_json((file.metadata() or {})[_ENTRY])
    except (SafetensorError, OSError, KeyError, ValueError):  # pydantic's ValidationError is a ValueError
        return None


def has_key(path: Path, key: str, since: int = 0) -> bool:
    """Whether a file was made from what `key` is the digest of, and not before `since` (modification time in ns)."""
    about = read_about(path)
    return about is not None and about.key == key and path.stat().st_mtime_ns >= since


def _load(path: Path) -> dict[str, Tensor]:
    """Raises SafetensorError for a damaged file."""
    from safetensors import SafetensorError, safe_open
    from safetensors.torch import load

    try:
        with safe_open(path, framework="np"):
            pass  # its header fits its size: nothing larger than what it says is read
        data = path.read_bytes()
        tensors = load(data)
    except MemoryError:
        raise SafetensorError("it does not fit into memory") from None
    about = _metadata(data)
    if about.digest != _digest(data):
        raise SafetensorError("checksum differs")
    return tensors


def _metadata(data: bytes) -> FrameMetadata:
    """What `write_frame` noted in a file's header; from its bytes, since the file may be replaced meanwhile."""
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
