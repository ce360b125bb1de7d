"""Every setting of a run: validated before anything starts, documented where it is declared.

`load_config` reads a YAML file and command-line overrides; `describe` prints all settings with their documentation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipelines.config.calibrate_section import BoardSection, CalibrateSection
    from pipelines.config.capture_section import CaptureSection
    from pipelines.config.description import describe
    from pipelines.config.loading import dump_config, load_config, parse_override
    from pipelines.config.sections import BakeSection, Config, EvaluateSection, InitializeSection, RunSection
    from pipelines.config.train_section import TrainSection

_HOMES = {
    "BakeSection": "pipelines.config.sections",
    "BoardSection": "pipelines.config.calibrate_section",
    "CalibrateSection": "pipelines.config.calibrate_section",
    "CaptureSection": "pipelines.config.capture_section",
    "Config": "pipelines.config.sections",
    "EvaluateSection": "pipelines.config.sections",
    "InitializeSection": "pipelines.config.sections",
    "RunSection": "pipelines.config.sections",
    "TrainSection": "pipelines.config.train_section",
    "describe": "pipelines.config.description",
    "dump_config": "pipelines.config.loading",
    "load_config": "pipelines.config.loading",
    "parse_override": "pipelines.config.loading",
}


def __getattr__(name: str) -> Any:
    """Loads pydantic and YAML when a setting is first asked for: `pipelines.config.renamed` needs neither, and `--help`
    answers at once."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


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
