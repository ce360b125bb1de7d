"""What the window uses of the pipeline's stages. Nothing else in `gui` imports them."""

from pipelines.stages import STAGES
from pipelines.stages.baking.plan import Part
from pipelines.stages.baking.trial import Trial, longest_part, measure
from pipelines.stages.camera_file import camera_file
from pipelines.stages.compared_view import performer_over
from pipelines.stages.inputs import Inputs

__all__ = ["STAGES", "Inputs", "Part", "Trial", "camera_file", "longest_part", "measure", "performer_over"]
