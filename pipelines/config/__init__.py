"""Every setting of a run: validated before anything starts, documented where it is declared.

`load_config` reads a YAML file and command-line overrides; `describe` prints all settings with their documentation.
"""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from pipelines.config.config import Config, EvaluateSettings, GroupSettings, RunSettings, TrainStageSettings
    from pipelines.config.description import describe
    from pipelines.config.loading import dump_config, load_config, parse_override

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

# `pipelines.config.renamed` needs neither pydantic nor YAML, so that --help stays fast
lazy_exports(__name__)
