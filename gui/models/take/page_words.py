"""Settings, stages and reasons by the names that the window's pages show."""

from functools import cache

from v3studio.gui.models.stage_rows import TITLES, stage_name
from v3studio.gui.models.take.settings import SECTIONS, fields_of
from v3studio.pipelines.runs.staleness import Reason, StageStatus
from v3studio.studio.counts import listed


@cache
def setting_words(setting: str) -> str:
    """A setting by its dotted name: "'quality' in Bake"; the name itself if no page has it."""
    pages = {field.name: f"'{field.label}' in {TITLES[stage]}" for stage in SECTIONS for field in fields_of(stage)}
    return pages.get(setting, setting)


def why_not_done(status: StageStatus) -> str:
    """Why a stage is not up to date; "" if it is."""
    if status.needs:
        return f"Run also runs {listed([*map(stage_name, status.needs)])}."
    return "; ".join(map(_reason_words, status.reasons)) or status.reason


def _reason_words(reason: Reason) -> str:
    if reason.setting:
        return f"{setting_words(reason.setting)} {reason.words}"
    return f"the result of {stage_name(reason.stage)} {reason.words}" if reason.stage else reason.words
