import json
import math
from typing import Any

import numpy as np
import pytest

from v3studio.pipelines import events
from v3studio.pipelines.events import MAX_TEXT, Metrics, Progress, RunStarted, read_line
from v3studio.studio.errors import Message, StudioError

STREAM = {"folder": "/t", "address": "http://x/"}
EXAMPLES = [
    RunStarted(take="/t", stages=("train", "bake"), done=("calibrate",), pid=1, version="0.1"),
    events.StageStarted(stage="train", reason="never finished"),
    Progress(stage="train", fraction=0.5, seconds_left=3.0, label="group 1", figures={"loss": 0.1, "splats": 7}),
    Metrics(stage="train", values={"psnr": 31.0}, group=0, frame=3),
    events.GroupStarted(stage="train", group=3, node="node1", attempt=2),
    events.Preview(stage="train", path="/t/x.png", caption="frame 3", camera="cam05", iteration=500),
    events.Log(stage="train", message="hello"),
    events.Serving(streams=(STREAM,), reviews=(), bases=("http://x",), local=True, https=False, fingerprint=None),
    events.Warned(stage="train", message="grün", code="training.slow", fields={"setting": "capture.scale"}),
    events.StageFailed(stage="bake", message="no", code="a.b", file="/x", value=3, fix="Do.", traceback="..."),
    events.StageFinished(stage="train", seconds=1.5, summary={"frames": 3}),
    events.Finished(outcome="done", seconds=9.0, result={"take": "/t"}),
]


@pytest.mark.parametrize("event", EXAMPLES, ids=lambda event: event.kind)
def test_an_event_survives_its_json(event: Any) -> None:
    assert "\n" not in event.to_json()
    assert read_line(event.to_json()) == (event, "")


def test_numbers_that_json_lacks_become_null_and_numpy_numbers_plain() -> None:
    values = {"loss": math.nan, "psnr": np.float32(math.inf), "splats": np.int64(3), "list": [np.float64(0.5)]}
    read = json.loads(Metrics(values=values).to_json())["values"]
    assert read == {"loss": None, "psnr": None, "splats": 3, "list": [0.5]}


HELLO = EXAMPLES[6]
LINE = HELLO.to_json()


@pytest.mark.parametrize(
    ("line", "event", "text"),
    [
        (LINE, HELLO, ""),
        (LINE.encode() + b"\n", HELLO, ""),
        ("Warning: " + LINE, HELLO, "Warning:"),
        (LINE + "Warning:\n", HELLO, "Warning:"),
        ("Warning:", None, "Warning:"),
        (LINE[: len(LINE) // 2], None, LINE[: len(LINE) // 2]),
        (b"\xff\xfe caf\xe9\n", None, "\ufffd\ufffd caf\ufffd"),
        ('{"event": "unheard_of", "x": 1}', None, '{"event": "unheard_of", "x": 1}'),
        ('{"event": "log"}', None, '{"event": "log"}'),
        ('{"event": [], "x": 1}', None, '{"event": [], "x": 1}'),
        ('{"event":' * 100_000, None, ('{"event":' * 100)[:MAX_TEXT] + " ..."),
        ('{"event":' + "[" * 100_000, None, ('{"event":' + "[" * 1000)[:MAX_TEXT] + " ..."),
        ("x" * 3_000_000, None, "x" * MAX_TEXT + " ..."),
        (b"\x1b[31m\tred\x00\n", None, "[31m red"),
        ("", None, ""),
        (b"\r\n", None, ""),
    ],
    ids=range(16),
)
def test_events_are_found_among_what_libraries_print(line: Any, event: Any, text: str) -> None:
    assert read_line(line) == (event, text)


def test_a_notice_carries_code_and_fields() -> None:
    error = StudioError("footage.no_frames", "no frames", file="/cam3", value=0, fix="Add some.", camera="cam3")
    read, _ = read_line(events.StageFailed.of(events.as_message(error), stage="train").to_json())
    assert isinstance(read, events.StageFailed)
    assert (read.code, read.file, read.value, read.fix) == ("footage.no_frames", "/cam3", 0, "Add some.")
    assert read.fields == {"camera": "cam3"}
    assert read.message == str(error) == "/cam3: no frames. Add some."
    bug = Message("program.bug", "ZeroDivisionError: x", fields={"exception": "ZeroDivisionError"})
    assert events.as_message(ZeroDivisionError("x")) == bug
