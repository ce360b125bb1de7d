from unittest.mock import MagicMock

from v3studio.gui.widgets.dialogs.take import CHOOSE, NewTakeDialog


def test_it_does_not_ask_for_what_is_typed() -> None:
    dialog = NewTakeDialog(MagicMock(), MagicMock(), MagicMock())
    dialog._update = MagicMock()  # type: ignore[method-assign]
    dialog._found = CHOOSE
    dialog._type("footage", "/footage")
    assert dialog._found.words != CHOOSE.words
    dialog._update.assert_called_once()
