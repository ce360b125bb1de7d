"""The splats of the set behind the performer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.take import Take

if TYPE_CHECKING:
    from v3studio.studio.gaussians import Gaussians


def take_set(take: Take) -> Gaussians | None:
    """The set of a take, in the take's own frame like its trained frames; None if there is none. Raises StudioError:
    `take.damaged`, `take.cannot_read`."""
    return read_frame(take.set_splats) if take.set_splats.is_file() else None
