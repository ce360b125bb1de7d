from html import unescape
from pathlib import Path

import numpy as np

from tests.support.tiny_capture import SETTINGS, write_project
from v3studio.pipelines.config import load_config
from v3studio.pipelines.events import Event, Warned
from v3studio.pipelines.runs.runner import run
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.results.stage_files import StoredCard
from v3studio.pipelines.takes.take import Take
from v3studio.studio.capture.images import read_image


def test_a_take_begins_with_its_card_which_is_in_the_report(finished: Path) -> None:
    take = Take.open(finished / "take")
    card = read_model(take.card, StoredCard)
    assert [(check.name, check.grade) for check in card.checks][:3] == [
        ("time", "good"), ("cameras", "good"), ("masks", "good"),
    ]  # fmt: skip
    assert np.ptp(read_image(take.card_picture)) > 0
    report = unescape(take.report.read_text())
    assert all(line in report for line in card.lines)
    assert report.count("data:image/jpeg") % 4 == 1, "four images per sample, and the card"


def test_what_is_wrong_is_warned_of(tmp_path: Path) -> None:
    write_project(tmp_path)
    (tmp_path / "ball.yaml").write_text(SETTINGS.replace("fps: 25", "fps: 25\n  offsets: {cam2: 1}"))
    take, events = Take(tmp_path / "take"), list[Event]()
    run(take, load_config(tmp_path / "ball.yaml"), events.append, stages=("calibrate", "initialize"))
    warned = [event.fields for event in events if isinstance(event, Warned) and event.code == "card.wrong"]
    assert [(fields["check"], fields["setting"]) for fields in warned] == [("time", "capture.offsets")]
