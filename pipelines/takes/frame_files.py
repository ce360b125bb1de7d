"""Trained Gaussians on disk: safetensors, one file a frame, with the recipe that made them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.takes.atomic_files import atomic_path
from studio.errors import StudioError

if TYPE_CHECKING:
    from torch import Tensor

    from studio.gaussians import Gaussians

# One entry, because safetensors writes several in an order of its own, and equal runs must give equal bytes.
_ENTRY = "v3studio"


def write_frame(path: Path, gaussians: Gaussians, about: dict[str, Any]) -> None:
    """Atomic. `about` is JSON-ready: key of the recipe, group, index, frame number."""
    write_tensors(path, gaussians.state_dict(), about)


def write_tensors(path: Path, tensors: dict[str, Tensor], about: dict[str, Any]) -> None:
    """Atomic: any tensors by name (a checkpoint, a network), with what `read_about` gives back."""
    from safetensors.torch import save

    contiguous = {name: value.contiguous() for name, value in tensors.items()}
    data = save(contiguous, metadata={_ENTRY: json.dumps(about, sort_keys=True)})
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)  # a full disk is then an OSError like everywhere else


def read_frame(path: Path) -> Gaussians:
    """Gaussians on the CPU.

    Raises:
        StudioError: not there, or damaged.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    from studio.gaussians import Gaussians

    try:
        return Gaussians.from_state_dict(load_file(path))
    except FileNotFoundError:
        raise StudioError(f"{path}: there is no such file; run `v3studio train`.") from None
    except (SafetensorError, OSError) as error:
        raise StudioError(f"{path}: cannot be read ({error}); delete it and run `v3studio train`.") from None


def read_tensors(path: Path, key: str) -> dict[str, Tensor] | None:
    """What `write_tensors` wrote there about the recipe `key`; None if there is no such file, or it is damaged or of
    another recipe: then it is of no use, and what it would have saved is made again."""
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    about = read_about(path)
    if about is None or about.get("key") != key:
        return None
    try:
        return load_file(path)
    except (SafetensorError, OSError):
        return None


def read_about(path: Path) -> dict[str, Any] | None:
    """What `write_frame` was told about the frame; None if the file is not there, damaged, or another's."""
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        return None
    try:
        with safe_open(path, framework="np") as file:
            about = json.loads((file.metadata() or {})[_ENTRY])
    except (SafetensorError, OSError, KeyError, ValueError):
        return None
    return about if isinstance(about, dict) else None
