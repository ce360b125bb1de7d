from pathlib import Path
from unittest.mock import MagicMock

from tests.support.looping import wait_in_loop
from v3studio.gui.actions.bakes import BakeActions, bake_words
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.take.workspace import Workspace
from v3studio.pipelines.takes.files.settings_file import set_settings
from v3studio.pipelines.takes.take import Take


def test_bakes_are_kept_on_a_thread(workspace: Workspace, take_copy: Path) -> None:
    take, notices, dialogs = Take.open(take_copy), Notices(), MagicMock()
    dialogs.list_of.return_value.selected_index = -1
    workspace.open(take)
    bakes = BakeActions(MagicMock(other=None), workspace, MagicMock(), dialogs, notices, lambda: None)
    bakes.keep(take, "fine")
    wait_in_loop("the bake", lambda: "'fine'" in notices.text)
    bakes.show()
    message = dialogs.label.return_value
    assert "'fine'" not in message.text, "it was kept before the dialog was opened"
    (row,) = bakes.rows
    assert (row.name, row.is_stream) == ("fine", True)
    assert "dB" in bake_words(row)
    assert "other settings" not in bake_words(row)
    set_settings(take.config, {"capture.audio": "a.wav"})
    bakes.look()
    assert "other settings" in bake_words(bakes.rows[0])
    bakes.keep(take, "a/b")
    wait_in_loop("the refusal", lambda: notices.card is not None and "cannot be the name" in notices.card.text)
