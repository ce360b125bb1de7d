"""The torch device of a run."""

from __future__ import annotations

from studio.errors import StudioError


def choose_device(name: str) -> str:
    """An available torch device.

    Args:
        name: "auto", "cpu", "cuda" or "cuda:N".

    Returns:
        "cpu", "cuda" or "cuda:N".

    Raises:
        StudioError: a GPU that torch does not see (`run.no_gpu`).
    """
    import torch

    from studio.rasterizer import preferred_device

    if name == "auto":
        return preferred_device().type
    if name.startswith("cuda"):
        count = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if int(name.partition(":")[2] or 0) >= count:
            found = f"torch found {count} GPUs, numbered from 0" if count else "torch found no GPU"
            raise StudioError(
                "run.no_gpu",
                f"run.device is {name}, but {found}",
                value=name,
                fix="Set run.device to cpu or auto.",
                setting="run.device",
                gpus=count,
            )
    return name
