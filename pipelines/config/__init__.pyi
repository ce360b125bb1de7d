from .config import Config, EvaluateSettings, GroupSettings, RunSettings, TrainStageSettings
from .description import describe
from .loading import dump_config, load_config, parse_override

__all__ = [
    "Config",
    "EvaluateSettings",
    "GroupSettings",
    "RunSettings",
    "TrainStageSettings",
    "describe",
    "dump_config",
    "load_config",
    "parse_override",
]
