"""Settings and stages in the words of the window's pages, instead of those of files and the command line."""

import re
from functools import cache

from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.stages import STAGES
from v3studio.gui.models.take.log_words import stage_name
from v3studio.gui.models.take.settings import SECTIONS, fields_of
from v3studio.pipelines.runs.staleness import StageStatus
from v3studio.studio.counts import listed

_SECTIONS = "|".join(section for sections in SECTIONS.values() for section in sections)
_SETTING = re.compile(rf"(?<![\w./'])(?:{_SECTIONS})(?:\.[a-z_0-9]+)+")
_STAGES = "|".join(stage.name for stage in STAGES)
_RESULT = re.compile(rf"(?<=the result of )(?:{_STAGES})\b")
_COMMAND = re.compile(rf"`v3studio (run|{_STAGES})\b([^`]*)`")


def in_page_words(text: str) -> str:
    """A message with what the window shows: "'quality' in Bake", "Run Initialize again"."""
    words = _SETTING.sub(lambda found: setting_words(found[0]), text)
    return _COMMAND.sub(_stage, _RESULT.sub(lambda found: stage_name(found[0]), words))


@cache
def setting_words(setting: str) -> str:
    """A setting by its dotted name: "'quality' in Bake"; the name itself if no page has it."""
    pages = {field.name: f"'{field.label}' in {TITLES[stage]}" for stage in SECTIONS for field in fields_of(stage)}
    return pages.get(setting, setting)


def why_not_done(status: StageStatus) -> str:
    """Why a stage is not up to date; "" if it is."""
    if status.needs:
        return f"Run also runs {listed([*map(stage_name, status.needs)])}."
    return in_page_words(status.reason)


def _stage(command: re.Match[str]) -> str:
    name = "all stages" if command[1] == "run" else stage_name(command[1])
    return f"{name} again" if "--force" in command[2] else name
