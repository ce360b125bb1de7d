"""What the window uses of the pipeline's stages. Nothing else in `gui` imports them."""

from __future__ import annotations

from pipelines.stages import STAGES
from pipelines.stages.baking.measures import RenderedError, rendered_contribution
from pipelines.stages.baking.plan import Part, edited_group, planned_parts, stream_cameras
from pipelines.stages.camera_file import camera_file_text
from pipelines.stages.footage import performer_over
from pipelines.stages.inputs import Inputs

__all__ = [
    "STAGES",
    "Inputs",
    "Part",
    "RenderedError",
    "camera_file_text",
    "edited_group",
    "performer_over",
    "planned_parts",
    "rendered_contribution",
    "stream_cameras",
]
