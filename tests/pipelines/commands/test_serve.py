import gzip
import json
import os
import shutil
import signal
import socket
import threading
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from urllib.parse import quote

import pytest

from tests.support.errors import refuses
from tests.support.streams import bake_numbered, best_of, edit_manifest, group_files
from tests.support.tiny_capture import Here
from tests.support.warm_python import WarmProcess
from tests.support.web_servers import PLAYER, ask, running
from v3studio.pipelines.events.cancellation import EXIT_CANCELLED
from v3studio.pipelines.share.page import PageText
from v3studio.pipelines.share.served import find_streams, wait_for_first_group
from v3studio.pipelines.share.web_app import build_app
from v3studio.pipelines.takes.take import TAKE_FORMAT, Take
from v3studio.studio.playback import play_headless
from v3studio.studio.stream import BakeSettings

BROWSER = "text/html,application/xhtml+xml,*/*;q=0.8"


def bake(folder: Path) -> Path:
    """40 frames at 20 fps in groups of 5."""
    settings = BakeSettings(quality=0, preset="ultrafast")
    return bake_numbered(folder, (5,) * 8, 20.0, 30, settings)


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bake(tmp_path_factory.mktemp("served") / "stream")


@pytest.fixture(scope="module")
def port(stream: Path) -> Iterator[int]:
    """A server for `stream`, with files in and next to it that must not be served."""
    (stream.parent / "secret.txt").write_text("secret")
    (stream / ".hidden").write_text("secret")
    (stream / "out.txt").symlink_to(stream.parent / "secret.txt")
    (stream / "up").symlink_to(stream.parent)
    with running(build_app(find_streams(str(stream)), origins=["*"])) as port:
        yield port


def test_files_with_their_types_and_lengths(port: int, stream: Path) -> None:
    video = group_files(stream, 3)[1].relative_to(stream).as_posix()
    for path, kind in (("manifest.json", "application/json"), (video, "video/mp4")):
        data = (stream / path).read_bytes()
        status, headers, body = ask(port, f"/{path}")
        assert (status, body) == (200, data)
        assert headers["content-type"] == kind
        assert headers["content-length"] == str(len(data))
        assert headers["accept-ranges"] == "bytes"
        status, head, body = ask(port, f"/{path}", method="HEAD")
        assert (status, head["content-length"], body) == (200, str(len(data)), b"")


def test_addresses_of_folders_with_any_letters_are_quoted_and_work(
    stream: Path, tmp_path: Path, here: Here, start: Callable[..., WarmProcess]
) -> None:
    names = ["prise é 影 1", "a #1 50% ?&'x", "plain"]
    for name in names:
        shutil.copytree(stream, tmp_path / name, symlinks=True)
    process = start("serve", tmp_path, "--port", "0")
    lines = [process.stdout.readline() for _ in range(len(names) + 1)]
    addresses = {
        line.removeprefix("Serving ").split(" at http")[0]: line.rsplit(" at ", 1)[1].strip() for line in lines[:-1]
    }
    assert set(addresses) == {str(tmp_path / name) for name in names}
    host = addresses[str(tmp_path / "plain")].removesuffix("/plain/")
    with urllib.request.urlopen(f"{host}/") as answer:
        listed = answer.read().decode().splitlines()[1:]
    assert sorted(listed) == sorted(f"{address}manifest.json" for address in addresses.values())
    for address in listed:
        assert urllib.parse.urlsplit(address).geturl() == address.encode("ascii").decode()
        with urllib.request.urlopen(address) as answer:
            assert answer.read() == (stream / "manifest.json").read_bytes()
    report = here("play", addresses[str(tmp_path / names[1])], "--frames", ":2", "--json").result
    assert len(report["frames"]) == 2
    here("play", f"{host}/{names[0]}", "--frames", ":2").ok()
    process.send_signal(signal.SIGINT)


def test_ranges(port: int, stream: Path) -> None:
    file = group_files(stream, 0)[0]
    data, path = file.read_bytes(), f"/{file.relative_to(stream).as_posix()}"
    status, headers, body = ask(port, path, Range="bytes=100-299")
    assert (status, body) == (206, data[100:300])
    assert headers["content-range"] == f"bytes 100-299/{len(data)}"
    assert ask(port, path, Range="bytes=200-")[2] == data[200:]
    assert ask(port, path, Range="bytes=-7")[2] == data[-7:]
    assert ask(port, path, Range=f"bytes={len(data)}-")[0] == 416
    tag = headers["etag"]
    assert ask(port, path, Range="bytes=5-", If_Range=tag)[0] == 206
    assert ask(port, path, Range="bytes=5-", If_Range='"other"')[::2] == (200, data)


def test_caches_ask_again_and_are_told_when_nothing_changed(port: int, stream: Path) -> None:
    named_by_content = f"/{group_files(stream, 1)[0].relative_to(stream).as_posix()}"
    for path, kept in (("/manifest.json", "no-cache"), (named_by_content, "public, max-age=31536000, immutable")):
        _, headers, _ = ask(port, path)
        assert headers["cache-control"] == kept
        status, again, body = ask(port, path, If_None_Match=headers["etag"])
        assert (status, body) == (304, b"")
        assert again["cache-control"] == kept
    file = stream / "note.bin"
    file.write_bytes(b"one")
    tag = ask(port, "/note.bin")[1]["etag"]
    file.write_bytes(b"other")
    assert ask(port, "/note.bin", If_None_Match=tag)[::2] == (200, b"other")
    assert ask(port, "/note.bin")[1]["content-type"] == "application/octet-stream"


def test_pages_from_elsewhere_may_read(port: int) -> None:
    _, headers, _ = ask(port, "/manifest.json", Origin="https://player.example")
    assert headers["access-control-allow-origin"] == "*"
    assert "Content-Range" in headers["access-control-expose-headers"]
    status, headers, _ = ask(
        port, "/manifest.json", method="OPTIONS", Origin="https://player.example",
        Access_Control_Request_Method="GET", Access_Control_Request_Headers="range",
    )  # fmt: skip
    assert status == 200
    assert "Range" in headers["access-control-allow-headers"]


@pytest.mark.parametrize(
    ("origins", "allowed"),
    [((), "'self'"), (("https://a.example", "https://b.example"), "'self' https://a.example https://b.example")],
)
def test_which_pages_may_show_it_in_a_frame(stream: Path, tmp_path: Path, origins: Sequence[str], allowed: str) -> None:
    shutil.copytree(stream, tmp_path / "one", symlinks=True)
    for folder, pages in ((stream, ["/"]), (tmp_path, ["/", "/one/"])):
        with running(build_app(find_streams(str(folder)), PLAYER, origins=origins)) as port:
            for page in pages:
                headers = ask(port, page, Accept=BROWSER)[1]
                assert headers["content-security-policy"] == f"frame-ancestors {allowed}"


@pytest.mark.parametrize(
    "path",
    [
        "/../secret.txt", "/%2e%2e/secret.txt", "/..%2fsecret.txt", "/files/../../secret.txt",
        "/files/%2e%2e/%2e%2e/secret.txt", "//secret.txt", "/.hidden", "/./.hidden", "/out.txt", "/up/secret.txt",
        "/..\\secret.txt", "/%00", "/" + "a" * 5000, "/files", "/files/", "/nothing.mp4",
    ],
)  # fmt: skip
def test_nothing_but_the_streams_files(port: int, path: str, stream: Path) -> None:
    status, _, body = ask(port, path)
    assert status in (400, 404)
    assert b"secret" not in body
    absolute = "/" + str(stream.parent / "secret.txt")
    assert ask(port, absolute)[0] == 404


def test_nothing_can_be_changed(port: int) -> None:
    for method in ("POST", "PUT", "DELETE", "PATCH"):
        assert ask(port, "/manifest.json", method=method, Content_Length="0")[0] == 405


def test_which_streams_are_found(stream: Path, tmp_path: Path) -> None:
    assert find_streams(str(stream)) == {"/": stream}
    take = tmp_path / "take"
    shutil.copytree(stream, take / "stream", symlinks=True)
    (take / "take.json").write_text(json.dumps({"format": TAKE_FORMAT}))
    assert find_streams(str(take)) == {"/": take / "stream"}
    shutil.copytree(stream, tmp_path / "plain", symlinks=True)
    (tmp_path / "else").mkdir()
    assert find_streams(str(tmp_path)) == {"/plain": tmp_path / "plain", "/take": take / "stream"}
    for wrong, code in (("else", "serve.no_stream"), ("none", "stream.not_found")):
        with refuses(code, file=str(tmp_path / wrong)):
            find_streams(str(tmp_path / wrong))


def test_links_do_not_serve_streams_elsewhere(stream: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    served, elsewhere = tmp_path / "served", tmp_path / "elsewhere"
    shutil.copytree(stream, served / "here", symlinks=True)
    shutil.copytree(stream, elsewhere / "take" / "stream", symlinks=True)
    (elsewhere / "take" / "take.json").write_text(json.dumps({"format": TAKE_FORMAT}))
    (served / "again").symlink_to("here")
    (served / "stream").symlink_to(elsewhere / "take" / "stream")
    (served / "take").symlink_to(elsewhere / "take")
    (served / "mine").mkdir()
    (served / "mine" / "take.json").write_text(json.dumps({"format": TAKE_FORMAT}))
    (served / "mine" / "stream").symlink_to(elsewhere / "take" / "stream")
    streams = find_streams(str(served))
    assert list(streams) == ["/again", "/here"]
    assert capsys.readouterr().err.count("a link out of this folder") == 3
    with running(build_app(streams)) as port:
        assert ask(port, "/here/manifest.json")[0] == 200
        for name in ("stream", "take", "mine", "mine/stream"):
            assert ask(port, f"/{name}/manifest.json")[0] == 404


def test_names_are_taken_as_they_are_or_skipped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in (b"a", b"{a}", b"{b:int}", b"\xff"):
        folder = tmp_path / os.fsdecode(name)
        folder.mkdir()
        (folder / "manifest.json").write_bytes(name)
    with running(build_app(find_streams(str(tmp_path)), secret="t0ken")) as port:
        for name in ("a", "{a}", "{b:int}"):
            assert ask(port, f"/t0ken/{quote(name)}/manifest.json")[2].decode() == name
        assert ask(port, "/t0ken/c/manifest.json")[0] == 404
        lines = ask(port, "/t0ken/")[2].decode().splitlines()
        assert f"http://127.0.0.1:{port}/t0ken/a/manifest.json" in lines
        assert len(lines) == 4
    assert "not UTF-8" in capsys.readouterr().err


def test_browsers_get_the_player_and_others_the_list(stream: Path, tmp_path: Path) -> None:
    for name in ("a", "b <'&>"):
        shutil.copytree(stream, tmp_path / name, symlinks=True)
    (tmp_path / "a" / ".player").mkdir()
    for folder, page, script in ((stream, "/", ".player/"), (tmp_path, "/a/", "../.player/")):
        with running(build_app(find_streams(str(folder)), PLAYER, text=PageText(intro='{"keys": []}'))) as port:
            status, headers, body = ask(port, page, Accept=BROWSER)
            assert (status, headers["content-type"]) == (200, "text/html; charset=utf-8")
            assert headers["cache-control"] == "no-cache"
            text = body.decode()
            assert 'src="manifest.json"' in text
            assert 'intro="#v3-intro"' in text
            assert '{"keys": []}' in text
            assert f'src="{script}{next(iter(PLAYER.hashed()))}"' in text
            status, headers, body = ask(port, f"/.player/{next(iter(PLAYER.hashed()))}")
            assert (status, body) == (200, PLAYER.parts["v3-first.js"])
            assert headers["content-type"].startswith("text/javascript"), "or browsers refuse modules"
            assert "immutable" in headers["cache-control"]
            for wrong in ("/.player/", "/.player/v3-player.js", "/.player", "/files/"):
                assert ask(port, wrong, Accept=BROWSER)[0] == 404
            assert ask(port, "/")[2].decode().startswith("V3 Studio streams:\n")
            if folder == tmp_path:
                links = ask(port, "/", Accept=BROWSER)[2].decode()
                assert "b &lt;&#x27;&amp;&gt;" in links
                assert f'href="{urllib.parse.quote(chr(98) + " <" + chr(39) + "&>")}/"' in links
                assert ask(port, "/a", Accept=BROWSER)[0] == 307


def test_names_in_the_list_of_streams_look_like_themselves(tmp_path: Path) -> None:
    (tmp_path / "a_\u202eexe").mkdir()
    (tmp_path / "a_\u202eexe" / "manifest.json").write_bytes(b"{}")
    with running(build_app(find_streams(str(tmp_path)), PLAYER)) as port:
        listed = ask(port, "/", Accept=BROWSER)[2].decode()
        assert ">a_?exe</a>" in listed
        link = listed.partition('<a href="')[2].partition('"')[0]
        assert ask(port, f"/{link}manifest.json")[2] == b"{}"
        page = ask(port, f"/{link}", Accept=BROWSER)[2].decode()
        assert "\u202e" not in listed + page


def test_a_port_that_is_taken(here: Here, stream: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        here("serve", stream, "--port", taken.getsockname()[1]).fails("is in use. Specify another one with --port.")
    here("serve", stream, "--port", "70000").fails(code=2)
    here("serve", stream, "--host", "203.0.113.1").fails("cannot listen on 203.0.113.1")


def served(start: Callable[..., WarmProcess], stream: Path, port: int = 0) -> tuple[WarmProcess, str]:
    """Start a server process; it, and its address."""
    process = start("serve", stream, "--port", port)
    line = process.stdout.readline()
    assert "at http://127.0.0.1:" in line, process.stderr.read()
    return process, line.rsplit(" at ", 1)[1].strip()


def test_ctrl_c_ends_it_whoever_is_connected(start: Callable[..., WarmProcess], tmp_path: Path) -> None:
    folder = bake(tmp_path / "stream")
    (folder / "big.bin").write_bytes(bytes(50_000_000))
    process, address = served(start, folder)
    assert "v3studio play " + address in process.stdout.readline()
    port = int(address.rstrip("/").rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as idle, socket.create_connection(("127.0.0.1", port)) as slow:
        idle.sendall(b"GET /manifest.json HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert idle.recv(100)
        slow.sendall(b"GET /big.bin HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert slow.recv(100)  # and no more: the response stays incomplete
        process.send_signal(signal.SIGINT)
        process.wait(120)
    assert process.returncode == 130
    assert process.stderr.read() == ""


def test_play_over_http_and_the_server_is_killed_and_restarted_in_the_middle(
    start: Callable[..., WarmProcess], stream: Path
) -> None:
    process, address = served(start, stream)
    port = int(address.rstrip("/").rpartition(":")[2])
    seen = []
    restarted = threading.Event()

    def restart() -> None:
        served(start, stream, port)
        restarted.set()

    def look(played) -> None:
        seen.append(round(played.gaussians.means[0, 0].item()))
        if len(seen) == 1:
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            threading.Thread(target=restart).start()

    report = play_headless(address, realtime=True, on_frame=look)
    assert restarted.is_set()
    assert report.skipped == ()
    assert seen == sorted(set(seen))
    assert seen[-1] == 39
    # Fetched groups keep playing and the clock waits for the rest: an outage costs time, but hardly any frames.
    assert report.shown + report.dropped == 40
    assert report.shown > 12
    assert report.seconds > 40 / 20


def test_the_command_line_plays_an_address(here: Here, start: Callable[..., WarmProcess], tmp_path: Path) -> None:
    folder = bake(tmp_path / "stream")
    missing = {"path": f"files/{'1' * 32}.mp4", "sha256": "1" * 64}  # these groups share their files
    edit_manifest(folder, lambda manifest: best_of(manifest["groups"][0])["video"].update(missing))
    _, address = served(start, folder)
    done = here("play", "--json", address).fails()
    report = done.result
    assert [row["frame"] for row in report["frames"]] == [*range(5, 40)]
    assert all(row["fetch_ms"] > 0 for row in report["frames"])
    assert report["skipped"][0]["frame_count"] == 5
    assert done.stderr.startswith("warning: Group 0, frames 0 to 4, was skipped: http://127.0.0.1:")
    assert here("check", address).fails().stdout.startswith(f"{missing['path']} (group 0):")
    here("play", address + "nowhere").fails("404")


def test_json_is_compressed_for_clients_that_take_it(port: int, stream: Path) -> None:
    data = (stream / "manifest.json").read_bytes()
    status, headers, body = ask(port, "/manifest.json", Accept_Encoding="gzip, br")
    assert (status, headers["content-encoding"], gzip.decompress(body)) == (200, "gzip", data)
    plain = ask(port, "/manifest.json")[1]
    assert headers["etag"] != plain["etag"]
    for tag in (headers["etag"], plain["etag"]):
        assert ask(port, "/manifest.json", Accept_Encoding="gzip", If_None_Match=tag)[0] == 304
    status, headers, body = ask(port, "/manifest.json", Accept_Encoding="gzip", Range="bytes=0-9")
    assert (status, body) == (206, data[:10])
    assert "content-encoding" not in ask(port, f"/files/{group_files(stream, 3)[0].name}", Accept_Encoding="gzip")[1]


def test_a_live_take_is_waited_for_only_while_it_is_made(here: Here, tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    take.config.write_text("run: {live: true}\n")
    with refuses("serve.no_run", file=str(take.root)):
        wait_for_first_group(str(take.root), lambda seconds: False)
    with take.locked("v3studio run"):
        assert here("serve", take.root, "--port", "0", "--end-with-stdin").returncode == EXIT_CANCELLED
