"""HTTP reads from a local server that stalls, disconnects, sends wrong data and restarts."""

import contextlib
import hashlib
from collections.abc import Iterator

import pytest

from tests.studio.stream.conftest import FindStream
from tests.studio.stream.sources.conftest import CONTENT, Server, respond, timed
from tests.support.errors import refuses
from tests.support.splats import same_splats
from tests.support.streams import contents
from v3studio.studio.stream import SourceUnavailable, StreamReader, check_stream
from v3studio.studio.stream.sources.http import HttpSource


@pytest.fixture
def source(server: Server) -> Iterator[HttpSource]:
    """It waits for as long as a busy machine may take."""
    source = timed(server.url, stall=60, patience=60, first_patience=60)
    yield source
    source.close()


@pytest.mark.parametrize("tail", ["", "/", "/manifest.json"])
def test_the_addresses_forms(server: Server, tail: str) -> None:
    source = HttpSource(server.url + tail + "?token=a%20b")
    assert source.read("file", 10**6) == CONTENT
    assert server.requests == [("/s/file?token=a%20b", None)]
    assert "token" not in source.name


def test_name_and_password_go_into_a_header_only(server: Server) -> None:
    server.faults["/s/file"] = lambda handler, _: handler.answer(handler.headers["Authorization"].encode())
    source = HttpSource(server.url.replace("http://", "http://me:se%3Acret@"))
    assert source.read("file", 10**6) == b"Basic bWU6c2U6Y3JldA=="
    assert "secret" not in source.name
    assert "se%3Acret" not in source.name


@pytest.mark.parametrize("address", ["ftp://host/x", "http://", "http://host:port/", "host/x"])
def test_no_address(address: str) -> None:
    with refuses("source.invalid_url", file=address):
        HttpSource(address)


def test_broken_connections_go_on_where_they_ended(server: Server, source: HttpSource) -> None:
    cuts = iter([50_000, 100, 90_000])
    server.faults["/s/file"] = lambda handler, data: handler.answer(data, send=next(cuts, None))
    assert source.read("file", len(CONTENT)) == CONTENT
    assert [asked for _, asked in server.requests] == [None, "bytes=50000-", "bytes=50100-", "bytes=140100-"]


def test_a_file_that_changes_meanwhile_is_never_mixed(server: Server, source: HttpSource) -> None:
    new = CONTENT[::-1]

    def cut_then_change(handler, data):
        handler.answer(data, send=70_000)
        server.files["/s/file"] = new
        del server.faults["/s/file"]

    server.faults["/s/file"] = cut_then_change
    assert source.read("file", len(CONTENT)) == new


def test_a_file_that_shrinks_meanwhile_is_read_again(server: Server, source: HttpSource) -> None:
    """A server that knows no If-Range has nothing from that place on, and says so."""
    new = CONTENT[:50_000]

    def cut(handler, data):
        handler.answer(data, send=70_000)
        server.faults["/s/file"] = shrunk

    def shrunk(handler, data):
        asked = handler.headers.get("Range")
        if asked is None:
            handler.answer(new)
        else:
            handler.send_error(416)

    server.faults["/s/file"] = cut
    assert source.read("file", len(CONTENT)) == new
    assert [asked for _, asked in server.requests] == [None, "bytes=70000-", None]


def test_a_length_above_the_limit_is_refused_before_anything_is_read(server: Server, source: HttpSource) -> None:
    server.faults["/s/file"] = lambda handler, data: handler.answer(data, say=10**12)
    with refuses("source.file_too_long", file=f"{server.url}/file", value=10**12, expected=5):
        source.read("file", 5)
    assert len(server.requests) == 1


def test_more_than_the_limit_without_a_length(server: Server, source: HttpSource) -> None:
    def endless(handler, data):
        respond(handler, 200, Connection="close")
        handler.close_connection = True
        try:
            while not server.stop_stalling.is_set():
                handler.wfile.write(data)
        except OSError:
            server.stop_stalling.set()  # the client disconnected

    server.faults["/s/file"] = endless
    with refuses("source.file_too_long", file=f"{server.url}/file", expected=1000):
        source.read("file", 1000)
    assert server.stop_stalling.wait(60)


def test_a_length_that_is_too_long_or_too_short(server: Server, source: HttpSource) -> None:
    server.faults["/s/file"] = lambda handler, data: handler.answer(data, say=len(data) + 5)
    hasty = timed(server.url, stall=0.3, patience=1.5, first_patience=0.5)
    with contextlib.closing(hasty), pytest.raises(SourceUnavailable) as caught:
        hasty.read("file", len(CONTENT) + 5)
    assert caught.value.fields["reason"] in ("connection_closed", "connection_broken", "file_changed", "read_timeout")
    server.faults["/s/file"] = lambda handler, data: handler.answer(data, say=len(data) - 5)
    assert source.read("file", len(CONTENT)) == CONTENT[:-5]  # the reader then sees that 5 bytes are missing


@pytest.mark.parametrize(
    ("status", "code"), [(404, "file_missing"), (403, "access_denied"), (400, "http_status"), (304, "http_status")]
)
def test_answers_that_do_not_pass(server: Server, source: HttpSource, status: int, code: str) -> None:
    server.faults["/s/file"] = lambda handler, data: handler.send_error(status)
    with refuses(f"source.{code}", file=f"{server.url}/file", status=status):
        source.read("file", 10)
    assert len(server.requests) == 1


@pytest.mark.parametrize("status", [500, 503, 429])
def test_answers_that_pass(server: Server, status: int) -> None:
    def later(handler, data):
        if len(server.requests) == 3:
            server.faults.clear()
        respond(handler, status, Retry_After="0", Content_Length="0")

    server.faults["/s/file"] = later
    with contextlib.closing(timed(server.url, patience=60)) as source:
        assert source.read("file", len(CONTENT)) == CONTENT
    assert len(server.requests) == 4


def test_compression_is_refused(server: Server, source: HttpSource) -> None:
    answer = {"Content_Encoding": "gzip", "Content_Length": "3"}
    server.faults["/s/file"] = lambda handler, data: respond(handler, 200, b"abc", **answer)
    with refuses("source.compressed", value="gzip"):
        source.read("file", 10)


def test_redirections_are_followed_but_not_in_circles(server: Server, source: HttpSource) -> None:
    def elsewhere(handler, data):
        respond(handler, 302, Location=handler.path.replace("moved", "file"), Content_Length="0")

    server.faults["/s/moved"] = elsewhere
    assert source.read("moved", len(CONTENT)) == CONTENT
    server.faults["/s/file"] = elsewhere
    with refuses("source.redirect_loop"):
        source.read("file", 10)


def test_nobody_there(server: Server) -> None:
    server.close()
    with refuses("source.unavailable", reason="no_connection"):
        timed(server.url, first_patience=0.4).read("file", 10)


def test_a_stream_is_the_same_as_from_its_folder(server: Server, intact: FindStream) -> None:
    folder = intact("ladder")
    server.files.update({f"/s/{name}": data for name, data in contents(folder).items()})
    with StreamReader.open(folder) as local, StreamReader.open(server.url) as remote:
        assert remote.manifest == local.manifest
        assert all(same_splats(*pair) for pair in zip(local.iterate(), remote.iterate(), strict=True))
        assert not check_stream(remote).damage


def test_no_stream_at_the_address(server: Server) -> None:
    with refuses("source.file_missing", file=f"{server.url}/manifest.json", status=404):
        StreamReader.open(server.url)
    with refuses("source.unsupported_url", file="ftp://somewhere/x"):
        StreamReader.open("ftp://somewhere/x")


def test_a_file_that_is_the_same_is_not_sent_again(server: Server, source: HttpSource) -> None:
    def conditional(handler, data):
        tag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
        if handler.headers.get("If-None-Match") != tag:
            return handler.answer(data)
        return respond(handler, 304)

    server.faults["/s/file"] = conditional
    assert source.read_changed("file", 10**6) == CONTENT
    assert source.read_changed("file", 10**6) is None
    server.files["/s/file"] = b"other"
    assert source.read_changed("file", 10**6) == b"other"
    server.etag = False
    server.files["/s/file"] = b"third"
    assert source.read_changed("file", 10**6) == b"third"
    assert source.read_changed("file", 10**6) == b"third"
