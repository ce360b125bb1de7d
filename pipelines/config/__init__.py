"""Every setting of a run: validated before anything starts, documented where it is declared.

`load_config` reads a YAML file and command-line overrides; `describe` prints all settings with their documentation.
"""

from pipelines.config.calibrate_section import BoardSection, CalibrateSection
from pipelines.config.capture_section import CaptureSection
from pipelines.config.description import describe
from pipelines.config.loading import dump_config, load_config, parse_override
from pipelines.config.sections import BakeSection, Config, EvaluateSection, InitializeSection, RunSection
from pipelines.config.train_section import TrainSection

__all__ = [
    "BakeSection",
    "BoardSection",
    "CalibrateSection",
    "CaptureSection",
    "Config",
    "EvaluateSection",
    "InitializeSection",
    "RunSection",
    "TrainSection",
    "describe",
    "dump_config",
    "load_config",
    "parse_override",
]
