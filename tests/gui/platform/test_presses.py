from v3studio.gui.platform.keyboard import UP
from v3studio.gui.platform.presses import PATIENCE, KeyReports, Press
from v3studio.gui.platform.xlib import ESCAPE


def test_escape_that_a_text_field_keeps_closes_the_dialog_and_nothing_more_while_it_is_held() -> None:
    reports = KeyReports()
    reports.dialog = True
    reports.press(Press(ESCAPE))
    assert not reports.escape_kept(), "the toolkit may still report it"
    assert reports.reported(None)[0], "a key that is not known"
    for _ in range(PATIENCE):
        reports.tick()
    assert reports.escape_kept()
    reports.dialog = False
    for _ in range(PATIENCE):
        reports.tick()
        reports.press(Press(ESCAPE, repeated=True))
        assert not reports.reported(ESCAPE)[0]
    reports.press(Press(UP))
    assert reports.reported(UP)[0]
