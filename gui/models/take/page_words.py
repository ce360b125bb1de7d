"""Settings, stages and reasons by the names that the window's pages show."""

from functools import cache

from v3studio.gui.models.stage_rows import TITLES, stage_name
from v3studio.gui.models.take.settings import SECTIONS, SettingField, fields_of, setting_value
from v3studio.pipelines.config import Config
from v3studio.pipelines.runs.staleness import Reason, StageStatus
from v3studio.studio.counts import listed
from v3studio.studio.yaml_text import inline_yaml


@cache
def _on_pages() -> dict[str, tuple[str, SettingField]]:
    """The page of each setting, and the setting, by its dotted name."""
    return {field.name: (TITLES[stage], field) for stage in SECTIONS for field in fields_of(stage)}


def setting_words(setting: str) -> str:
    """A setting by its dotted name: "'quality' in Bake"; the name itself if no page has it."""
    page, field = _on_pages().get(setting, ("", None))
    return setting if field is None else f"'{field.label}' in {page}"


def value_words(setting: str, config: Config) -> str:
    """The value of a setting as its page shows it: "all" for `capture.frames` without a value."""
    _, field = _on_pages().get(setting, ("", None))
    return inline_yaml(setting_value(config, setting)) if field is None else field.shown(config)


def why_not_done(status: StageStatus) -> str:
    """Return why a stage is not up to date; "" if it is."""
    if status.needs:
        return f"Run also runs {listed([*map(stage_name, status.needs)])}."
    return "; ".join(map(_reason_words, status.reasons)) or status.reason


def _reason_words(reason: Reason) -> str:
    if reason.setting:
        return f"{setting_words(reason.setting)} {reason.words}"
    return f"the result of {stage_name(reason.stage)} {reason.words}" if reason.stage else reason.words
