import hashlib
import ssl
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

from tests.support.looping import wait_in_loop
from tests.support.waiting import wait_until
from v3studio.gui.models.take.serving import Serving
from v3studio.gui.models.take.shares import ShareRequest, stale_words
from v3studio.gui.models.take.workspace import Workspace
from v3studio.pipelines.takes.authored.edits import change_edits
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits import EditList, Trim


def test_a_request_becomes_the_command_line(tmp_path: Path) -> None:
    share = ShareRequest("single-file", "/takes/walk", "walk", tmp_path)
    assert share.arguments() == ["/takes/walk", "--out", str(tmp_path / "walk.html"), "--overwrite", "--json"]
    share.address = "https://example.org/"
    assert share.arguments()[-1] == "--address=https://example.org/"
    share.set_target(str(tmp_path / "mine.html"))
    share.move_to(tmp_path / "deep")
    assert share.path == tmp_path / "deep" / "mine.html"
    share.set_target(str(tmp_path / "mine.v2"))
    assert share.path == tmp_path / "mine.v2.html", "else the command writes a folder"
    share.form = "folder"
    share.set_target(str(tmp_path / "mine.html"))
    assert share.path == tmp_path / "mine", "else the command writes a file"


def test_serving_tells_its_address_and_ends(stream_folder: Path) -> None:
    serving = Serving()
    serving.start(str(stream_folder), https=True)
    wait_in_loop("address", lambda: serving.address, 180.0)
    assert serving.words.endswith(serving.address)
    place = urllib.parse.urlsplit(serving.address)
    der = ssl.PEM_cert_to_DER_cert(ssl.get_server_certificate(("127.0.0.1", place.port)))
    assert serving.fingerprint.replace(":", "").lower() == hashlib.sha256(der).hexdigest()
    serving.stop()
    assert (serving.running, serving.address, serving.fingerprint) == (False, "", "")

    def gone() -> bool:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{place.port}/", timeout=5)
        except urllib.error.URLError as error:
            return isinstance(error.reason, ConnectionRefusedError)
        except OSError:
            pass  # it is ending
        return False

    wait_until("the server is gone", gone, 60.0)


def test_a_stream_is_not_taken_for_up_to_date_before_it_is_checked(workspace: Workspace, take_copy: Path) -> None:
    def told() -> str:
        return stale_words(workspace.assessment.stages.get("bake"), workspace.checked, bool(workspace.problem))

    workspace.open(Take.open(take_copy))
    assert "Checking" in told()
    wait_in_loop("the check", lambda: workspace.checked)
    assert told() == ""
    config, take = workspace.config, workspace.take
    workspace.change_settings({"bake.quality": config.bake.quality + 8})
    assert "Checking" in told(), "what was found before the change does not count"
    wait_in_loop("the check", lambda: workspace.checked)
    assert "out of date: 'quality' in Bake changed" in told()
    change_edits(take.edits, EditList(trim=Trim(first=1, last=2)), "trim")
    workspace.inputs_changed()
    assert "Checking" in told()
    wait_in_loop("the check", lambda: workspace.checked)
    (take_copy / "config.yaml").write_text("train: [")
    wait_in_loop("the damaged file", lambda: workspace.problem)
    assert "cannot be read" in told()
