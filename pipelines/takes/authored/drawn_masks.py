"""Garbage masks that were drawn in the window: their place in the settings is the take, wherever it is."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.takes.take import Take

if TYPE_CHECKING:
    from v3studio.pipelines.config import Config
    from v3studio.studio.capture import CaptureSettings

_TAKE = "take:"

DRAWN = f"{_TAKE}garbage.yaml"
"""`capture.garbage_masks` of a take whose garbage masks were drawn in the window. A path would no longer fit when the
take is moved or copied."""


def file_of_garbage(capture: CaptureSettings, take: Take) -> Path | None:
    """The file in the take that `capture.garbage_masks` names; None if it names none in the take."""
    named = capture.garbage_masks
    if named is None or not named.startswith(_TAKE):
        return None
    return take.root.absolute() / named.removeprefix(_TAKE)


def with_garbage_of(capture: CaptureSettings, take: Take) -> CaptureSettings:
    """The settings with the path of a file in the take in place of its name."""
    path = file_of_garbage(capture, take)
    return capture if path is None else capture.replace(garbage_masks=str(path))


def for_another_take(config: Config, path: Path | None, other: Path | None = None) -> Config:
    """Settings of a take, from the file `path` (None: the defaults), for another take: its garbage masks stay those
    that were drawn in the first. They stay as they are if the file is in `other`, the other take's folder, if there is
    one."""
    if path is None or (other is not None and os.path.realpath(path.absolute().parent) == os.path.realpath(other)):
        return config
    capture = with_garbage_of(config.capture, Take(path.absolute().parent))
    return config if capture is config.capture else config.replace(capture=capture)
