"""Shares from the window: what was chosen becomes the command line; serving starts, tells its address and ends."""

from __future__ import annotations

import hashlib
import ssl
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

from gui.presenters.run.exports import Exports
from gui.presenters.run.serving import Serving
from gui.presenters.run.shares import ShareRequest, megabytes, size_words
from pipelines.share import ShareSize, share_size
from tests.support.errors import refuses
from tests.support.waiting import wait_until


def finish(exports: Exports) -> None:
    wait_until("ended", lambda: exports.poll() and not exports.running, 180.0)


def test_a_folder_is_written_and_its_size_told(stream_folder: Path, tmp_path: Path) -> None:
    exports = Exports()
    request = ShareRequest("folder", str(stream_folder), "walk", tmp_path, title="-One", credits=" ", license="CC BY")
    exports.share(request)
    with refuses("export.running"):
        exports.share(request)
    finish(exports)
    assert not exports.failed, exports.result
    assert exports.title == "Share"
    files = [path for path in (tmp_path / "walk-share").rglob("*") if path.is_file()]
    assert f"{megabytes(sum(path.stat().st_size for path in files))} in {len(files)} files" in exports.result
    page = (tmp_path / "walk-share" / "index.html").read_text()
    assert "<title>-One</title>" in page
    assert 'data-license="CC BY"' in page
    assert "data-credits" not in page


def test_what_is_refused_is_a_sentence(stream_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "walk.html").write_text("mine")
    exports = Exports()
    exports.share(ShareRequest("single-file", str(stream_folder), "walk", tmp_path))
    finish(exports)
    assert exports.failed
    assert exports.result.startswith("Share failed:")
    assert str(tmp_path / "walk.html") in exports.result


def test_a_request_becomes_the_command_line(tmp_path: Path) -> None:
    found = ShareRequest("single-file", "/takes/walk", "walk", tmp_path)
    assert found.arguments() == ["/takes/walk", "--out", str(tmp_path / "walk.html"), "--json", "--single-file"]
    found.address = "https://example.org/"
    assert found.arguments()[-1] == "--address=https://example.org/"
    found.set_target(str(tmp_path / "mine.html"))
    found.move_to(tmp_path / "deep")
    assert found.path == tmp_path / "deep" / "mine.html"


def test_sizes_as_sentences(stream_folder: Path) -> None:
    size = share_size(str(stream_folder))
    assert megabytes(size.stream_bytes) in size_words(size, "folder")
    assert "12 frames, 1.0 s" in size_words(size, "folder")
    assert megabytes(size.single_file_bytes) in size_words(size, "single-file")
    long = ShareSize(90_000_000, 300_000, 120_300_000, False, 900, 30.0)
    assert "share a folder" in size_words(long, "single-file")


def test_serving_tells_its_address_and_ends(stream_folder: Path) -> None:
    serving = Serving()
    assert not serving.poll()
    serving.start(str(stream_folder), https=True)
    wait_until("address", lambda: serving.poll() and bool(serving.address), 180.0)
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


def test_a_server_that_cannot_start_says_why(tmp_path: Path) -> None:
    serving = Serving()
    serving.start(str(tmp_path / "none"), https=False)
    wait_until("ended", lambda: serving.poll() and not serving.running, 180.0)
    assert str(tmp_path / "none") in serving.failure
    assert serving.address == ""
