"""The window's title tells how far a run is."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from gui.models.take.run_state import RunState
from gui.overlays import window_title
from pipelines.events import Progress


def workspace(stage: str = "", fraction: float | None = None, paused: bool = False) -> SimpleNamespace:
    progress = None if fraction is None else SimpleNamespace(fraction=fraction)
    return SimpleNamespace(busy=stage != "", run=SimpleNamespace(stage=stage, progress=progress), paused=paused)


def test_titles() -> None:
    found = [
        window_title(name, space, queued)  # type: ignore[arg-type]
        for name, space, queued in (
            ("walk", workspace(), None),
            ("", workspace(), None),
            ("walk", workspace("train", 0.379), None),
            ("walk", workspace("train"), None),
            ("walk", workspace("train", 0.5, paused=True), None),
            ("", workspace(), ("night", "bake", 0.05)),
            ("", workspace(), ("night", "", None)),
            ("walk", workspace("train", 0.5), ("night", "bake", 0.05)),
        )
    ]
    assert found == [
        "walk - V3 Studio",
        "V3 Studio",
        "37% Train - walk - V3 Studio",
        "Train - walk - V3 Studio",
        "50% Train, paused - walk - V3 Studio",
        "5% Bake - night - V3 Studio",
        "night - V3 Studio",
        "50% Train - walk - V3 Studio",
    ]


@pytest.mark.parametrize(
    ("fraction", "said"), [(0.0, "0%"), (0.29, "29%"), (0.379, "37%"), (0.996, "99%"), (1.0, "100%")]
)
def test_the_title_and_the_list_of_stages_say_the_same(fraction: float, said: str) -> None:
    run = RunState(stage="bake", progress=Progress(time=0.0, stage="bake", fraction=fraction))
    space = SimpleNamespace(busy=True, paused=False, run=run)
    assert window_title("walk", space).startswith(f"{said} Bake")  # type: ignore[arg-type]
    assert run.stage_words().split(",")[0] == said
