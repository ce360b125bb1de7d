"""Measures the card of a take before anything is made from its footage: time, cameras, masks and color."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING

from v3studio.pipelines.reports.images import encode
from v3studio.pipelines.stages.params import key_of
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.results.stage_files import StoredCard
from v3studio.studio.atomic_files import remove, write_bytes
from v3studio.studio.camera_files import read_rig
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.own_frame import in_own_frame

if TYPE_CHECKING:
    from v3studio.pipelines.stages.initialize_plan import InitializePlan
    from v3studio.pipelines.stages.reporter import StageReporter

_VERSION = 1  # of what is measured: another one measures again
_SETTINGS = {"time": "capture.offsets", "masks": "capture.masks", "color": "capture.color_matrix"}


def check_card(plan: InitializePlan, reporter: StageReporter) -> None:
    """Measure the card unless it is there, write it, log its lines, and warn of what is wrong; of wrong cameras,
    `check_rig` does. A frame that cannot be read leaves no card: what needs the frame raises."""
    from v3studio.studio.card import draw, measure

    take = plan.take
    key = key_of("card", _VERSION, plan.seen, plan.cameras, list(plan.frames))
    card = read_model(take.card, StoredCard) if plan.is_current(take.card) else None
    if card is None or card.key != key or not take.card_picture.is_file():
        try:
            rig = in_own_frame(read_rig(take.rig))
            with closing(plan.inputs.opened(rig, votes=False)) as footage:
                measured = measure(footage, reporter.part("measuring the card", 0.0, 0.02))
        except StudioError as error:
            reporter.log(f"card: not measured. {error}")
            for path in (take.card, take.card_picture):
                remove(path)
            return
        card = StoredCard(key=key, **measured.card.model_dump())
        take.card.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(take.card_picture, encode(draw(measured), ".jpg"))
        write_model(take.card, card)
    for check in card.checks:
        if check.grade == "wrong" and check.name in _SETTINGS:
            fields = {"check": check.name, "cameras": list(check.cameras), "setting": _SETTINGS[check.name]}
            reporter.warn(Message("card.wrong", f"{check.name}: {check.words}", fix=check.fix, fields=fields))
        else:
            reporter.log(check.line)
