from types import SimpleNamespace
from typing import Any

import pytest

from v3studio.gui.figures import QualityFigures
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.inspector import note_on_figures
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits import EditList
from v3studio.studio.edits.edit_list import CropBox, Floaters

CROP = EditList(crop=CropBox(center=(0, 0, 0), size=(1, 1, 1)))
REGIONS = EditList().model_copy(update={"regions": (None,)})


@pytest.mark.parametrize("edits", [CROP, REGIONS, EditList(floaters=Floaters(opacity=0.1)), EditList()])
@pytest.mark.parametrize("state", ["done", "partial", "stale"])
def test_what_edits_did_to_figures_is_said_once_measured(player: PlayerPresenter, edits: EditList, state: str) -> None:
    take = Take.open(player.opened.take.root)
    assessment = SimpleNamespace(stages={"bake": SimpleNamespace(state=state)})
    workspace: Any = SimpleNamespace(take=take, assessment=assessment)
    views: Any = SimpleNamespace(shows_player=True)
    timeline: Any = SimpleNamespace()
    quality = QualityFigures(player, workspace, views, timeline)
    quality.update()
    player.context.__dict__["edits"] = edits
    told = "removed" in note_on_figures(player, True, quality.evaluation.stale)
    assert told == (state == "done" and edits != EditList())
