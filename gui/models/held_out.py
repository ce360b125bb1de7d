"""Which cameras a take holds out: by name, or every n-th of its footage."""

from __future__ import annotations

from gui.models.stages import Inputs
from pipelines.takes.camera_uses import CameraUses
from studio.errors import StudioError


class HeldOut:
    """Asks the footage once for each state of the settings: it is asked at every draw, and lists a folder."""

    def __init__(self) -> None:
        self._of: Inputs | None = None
        self._names: tuple[str, ...] = ()

    def of(self, context: Inputs | None) -> tuple[str, ...]:
        """The cameras that are not trained on; those that the settings name if the footage is gone."""
        if context is not self._of:
            self._of, self._names = context, () if context is None else _found(context)
        return self._names


def _found(context: Inputs) -> tuple[str, ...]:
    try:
        uses = CameraUses.of(context.footage.capture).uses
        return tuple(name for name, use in uses.items() if use == "held out")
    except StudioError:  # the Capture view shows the error
        return context.config.capture.held_out
