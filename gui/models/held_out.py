"""The cameras that a take holds out: by name, or every n-th of its footage."""

from collections.abc import Collection, Iterable
from functools import lru_cache

from v3studio.gui.models.stages import Inputs
from v3studio.pipelines.takes.results.camera_uses import camera_uses
from v3studio.studio.errors import StudioError


def held_out_cameras(context: Inputs | None) -> tuple[str, ...]:
    """The cameras that are not trained on; those that the settings name while the footage cannot be read."""
    if context is None:
        return ()
    try:
        return _in_footage(context)
    except StudioError:  # the Capture view shows the error
        return context.config.capture.held_out


@lru_cache(maxsize=1)
def _in_footage(context: Inputs) -> tuple[str, ...]:
    """The footage is asked once for each state of the settings: every draw wants this, and it lists a folder."""
    return tuple(name for name, use in camera_uses(context.capture).items() if use == "held out")


def held_out_first(names: Iterable[str], held_out: Collection[str]) -> list[str]:
    """Names of cameras as every list has them."""
    return sorted(names, key=lambda name: name not in held_out)
