"""Every setting of a run: validated before anything starts, documented where it is declared.

`load_config` reads a YAML file and command-line overrides; `describe` prints all settings with their documentation.
"""

from pipelines.config.description import describe
from pipelines.config.loading import dump_config, load_config, parse_override
from pipelines.config.sections import (
    BakeSection,
    BoardSection,
    CalibrateSection,
    CaptureSection,
    Config,
    EvaluateSection,
    InitialiseSection,
    RunSection,
    TrainSection,
)

__all__ = [
    "BakeSection",
    "BoardSection",
    "CalibrateSection",
    "CaptureSection",
    "Config",
    "EvaluateSection",
    "InitialiseSection",
    "RunSection",
    "TrainSection",
    "describe",
    "dump_config",
    "load_config",
    "parse_override",
]
