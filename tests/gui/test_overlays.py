"""The window's title tells how far a run is."""

from types import SimpleNamespace

import pytest

from gui.models.take.run_state import RunState
from gui.overlays import window_title
from pipelines.events import Progress


@pytest.mark.parametrize(
    ("fraction", "said"), [(0.0, "0%"), (0.29, "29%"), (0.379, "37%"), (0.996, "99%"), (1.0, "100%")]
)
def test_the_title_and_the_list_of_stages_say_the_same(fraction: float, said: str) -> None:
    run = RunState(stage="bake", progress=Progress(time=0.0, stage="bake", fraction=fraction))
    space = SimpleNamespace(busy=True, paused=False, run=run)
    assert window_title("walk", space).startswith(f"{said} Bake")  # type: ignore[arg-type]
    assert run.stage_words().split(",")[0] == said
