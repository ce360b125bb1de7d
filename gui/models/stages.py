"""The parts of the pipeline's stages that the window uses. Nothing else in `gui` imports them."""

from v3studio.pipelines.stages import STAGES
from v3studio.pipelines.stages.baking.plan import Part
from v3studio.pipelines.stages.baking.trial import Trial, longest_part, measure
from v3studio.pipelines.stages.camera_file import camera_file
from v3studio.pipelines.stages.compared_view import performer_over
from v3studio.pipelines.stages.inputs import Inputs

__all__ = ["STAGES", "Inputs", "Part", "Trial", "camera_file", "longest_part", "measure", "performer_over"]
