import base64
import hashlib
import json
import os
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from tests.support.rigs import camera_at
from tests.support.splats import noise, round_splats
from tests.support.streams import bake_numbered, contents
from tests.support.tiny_capture import Here
from v3studio.pipelines.events import Progress
from v3studio.pipelines.share import sharing
from v3studio.pipelines.share.page import PageText, first_files, read_intro, read_view
from v3studio.pipelines.share.sharing import share, share_size
from v3studio.pipelines.takes.take import TAKE_FORMAT
from v3studio.studio.atomic_files import machine_name
from v3studio.studio.errors import Cancelled
from v3studio.studio.formats.camera_path import Key, write_path_keys
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.stream import BakeSettings, Rung, StreamReader, bake_group, write_manifest

TEXT = PageText('A <walk> & "more"', "Jane Doe's studio", "CC BY 4.0 </script>", "https://example.org/walk")

NUKE = "Camera3 {\n inputs 0\n translate {{curve x0 1 2 3 4} 0 30}\n name %s\n}\n"

CAMERA = camera_at("front", (0, -3, 0), focal=70.0, size=(90, 60))


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """6 frames in two groups."""
    folder, random = tmp_path_factory.mktemp("shared") / "walk", noise(3)
    settings = BakeSettings(quality=0, preset="ultrafast")
    entries = []
    for group in range(2):
        frames = [round_splats(0.4 * random(60, 3), -2.0, 0.9) for _ in range(3)]
        entries.append(bake_group(frames, folder, group, 3 * group, settings))
    view = {"suggested_camera": CAMERA.to_dict(), "background": [0.0, 0.5, 1.0]}
    write_manifest(folder, entries, 12.0, settings, view)
    return folder


class Page(HTMLParser):
    """Elements of a page: (tag, attributes), and the text of each script and of the title."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[dict[str, str | None], str]] = []
        self.feed(path.read_text(encoding="utf-8"))
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag in ("script", "title"):
            self.texts.append((dict(attrs), ""))

    def handle_data(self, data: str) -> None:
        if self.elements and self.elements[-1][0] in ("script", "title"):
            attributes, text = self.texts[-1]
            self.texts[-1] = (attributes, text + data)

    def named(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def preview(self) -> dict[str | None, str | None]:
        return {meta.get("property"): meta.get("content") for meta in self.named("meta")}


def test_a_folder_holds_all_that_its_page_names_and_the_same_stream(stream: Path, tmp_path: Path) -> None:
    steps = []
    progress = lambda done, total, **_: steps.append((done, total))  # noqa: E731
    shared = share(stream, tmp_path / "deep" / "site", TEXT, progress=progress)
    files = contents(shared.path)
    assert contents(shared.path / "stream") == contents(stream)
    page = Page(shared.path / "index.html")
    (player,) = page.named("v3-player")
    early, *_, script = page.named("script")
    assert player["src"] == "stream/manifest.json"
    assert "src" not in early
    assert {player["src"], player["poster"], script["src"]} <= set(files)
    for name in (script["src"], player["poster"]):
        assert name.split(".")[-2] == hashlib.sha256(files[name]).hexdigest()[:10]
    assert (player["data-title"], player["data-credits"], player["data-license"]) == (
        TEXT.title, TEXT.credits, TEXT.license,
    )  # fmt: skip
    assert page.texts[0][1].strip() == TEXT.title
    assert b"&quot;more&quot; <small>0:01</small></h1>" in files["index.html"]
    assert (page.preview["og:title"], page.preview["og:url"]) == (TEXT.title, "https://example.org/walk/")
    image = str(page.preview["og:image"]).removeprefix("https://example.org/walk/")
    height, width, _ = cv2.imread(str(shared.path / image)).shape
    assert (width, height) == (1200, 630)
    assert (page.preview["og:image:width"], page.preview["og:image:height"]) == ("1200", "630")
    assert (shared.total_bytes, shared.files) == (sum(map(len, files.values())), len(files))
    assert shared.stream_bytes == sum(map(len, contents(stream).values()))
    assert shared.poster_bytes == len(files[str(player["poster"])]) + len(files[image])
    assert steps[0][0] == 0
    assert steps[-1][0] == steps[-1][1] > 2
    assert StreamReader.open(shared.path / "stream").frame_count == 6
    assert [path.name for path in shared.path.parent.iterdir()] == ["site"]


def test_the_poster_is_the_first_frame_from_the_suggested_camera(stream: Path, tmp_path: Path) -> None:
    shared = share(stream, tmp_path / "site")
    (poster,) = shared.path.glob("poster.*.jpg")
    image = cv2.imread(str(poster))[:, :, ::-1].astype(float)
    with StreamReader.open(stream) as reader:
        want = rasterize(reader.gaussians(0), CAMERA, torch.tensor([0.0, 0.5, 1.0])).image.numpy() * 255
        other = rasterize(reader.gaussians(5), CAMERA, torch.tensor([0.0, 0.5, 1.0])).image.numpy() * 255
    assert image.shape == want.shape
    assert np.abs(image - want).mean() < 6 < np.abs(image - other).mean()


def test_an_earlier_share_is_replaced_and_nothing_else(stream: Path, tmp_path: Path) -> None:
    out = tmp_path / "site"
    out.mkdir()
    first = share(stream, out, PageText(title="One")).path
    old = contents(first)
    with refuses("output.exists", file=out):
        share(stream, out, PageText(title="Two"))
    assert contents(first) == old
    second = share(stream, out, PageText(title="Two"), overwrite=True).path
    assert contents(second).keys() == old.keys()
    assert b"Two" in (second / "index.html").read_bytes()
    (out / "stream" / "notes.txt").write_text("mine")
    with refuses("output.not_ours", file=out, value="stream/notes.txt"):
        share(stream, out, overwrite=True)
    (out / "stream" / "notes.txt").unlink()
    (out / "share.json").write_text("{}")
    with refuses("output.not_ours", file=out):
        share(stream, out, overwrite=True)
    with refuses("output.not_ours", file=stream):
        share(stream, stream, overwrite=True)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    for name in ("file", "link"):
        with refuses("output.not_ours", file=tmp_path / name):
            share(stream, tmp_path / name, overwrite=True)
    assert b"Two" in (out / "index.html").read_bytes()


def test_what_is_damaged_or_cancelled_leaves_the_earlier_share_as_it_was(stream: Path, tmp_path: Path) -> None:
    copy, out, page = shutil.copytree(stream, tmp_path / "copy"), tmp_path / "out" / "site", tmp_path / "out" / "a.html"
    killed = subprocess.Popen([sys.executable, "-S", "-c", ""])
    killed.wait()
    writer = f"{killed.pid}-{machine_name()}-00000000"
    (tmp_path / "out" / f".site.{writer}.partial").mkdir(parents=True)
    (tmp_path / "out" / f".a.{writer}.partial.html").write_text("half")
    share(copy, out)
    share(copy, page)
    before = contents(out.parent)
    out.rename(out.with_name(f".site.{writer}.old.partial"))  # as if killed while it was replaced

    def stop(done: int, total: int, **_: object) -> None:
        if done == total - 1:
            raise Cancelled

    with pytest.raises(Cancelled):
        share(copy, out, overwrite=True, progress=stop)
    with pytest.raises(Cancelled):
        share(copy, page, overwrite=True, progress=stop)
    last = sorted(copy.rglob("*.mp4"))[-1]
    data = bytearray(last.read_bytes())
    data[-1] ^= 1
    last.write_bytes(data)
    for attempt in (lambda: share(copy, out, overwrite=True), lambda: share(copy, page, overwrite=True)):
        with refuses("stream.wrong_checksum", file=str(last)):
            attempt()
    assert contents(out.parent) == before
    assert sorted(os.listdir(out.parent)) == ["a.html", "site"]


def test_a_single_file_holds_the_stream_as_it_is(stream: Path, tmp_path: Path) -> None:
    shared = share(stream, tmp_path / "take.html", TEXT)
    page = Page(shared.path)
    files = [(attributes["data-v3-file"], text) for attributes, text in page.texts if "data-v3-file" in attributes]
    held = {name: base64.b64decode(text) for name, text in files}
    assert held == contents(stream)
    (player,) = page.named("v3-player")
    assert player["src"] in {f"#{element.get('id')}" for element in page.named("div")}
    assert str(player["poster"]).startswith("data:image/jpeg;base64,")
    assert page.texts[-1][0]["type"] == "module", "scripts end right"
    assert all("src" not in script for script in page.named("script"))
    assert shared.total_bytes == shared.path.stat().st_size
    assert shared.files == 1
    assert shared.stream_bytes == sum(map(len, held.values()))
    share(stream, shared.path, PageText(title="Two"), overwrite=True)
    assert b"<title>Two</title>" in shared.path.read_bytes()


def test_a_single_file_is_not_written_over_others_nor_for_long_streams(
    stream: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = tmp_path / "mine.html"
    mine.write_text("<p>mine")
    with refuses("output.not_ours", file=mine):
        share(stream, mine, overwrite=True)
    size = sum(map(len, contents(stream).values()))
    monkeypatch.setattr(sharing, "MAX_SINGLE_FILE_BYTES", size)
    share(stream, tmp_path / "just.html")
    monkeypatch.setattr(sharing, "MAX_SINGLE_FILE_BYTES", size - 1)
    with refuses("share.too_large", value=size, file=str(stream)):
        share(stream, tmp_path / "more.html")
    assert not (tmp_path / "more.html").exists()
    assert mine.read_text() == "<p>mine"


def test_an_intro_must_be_a_camera_path(stream: Path, tmp_path: Path) -> None:
    with refuses("camera_path.invalid_key"):
        (tmp_path / "a.json").write_text('{"format": "v3studio-camera-path", "version": 1, "keys": []}')
        read_intro(tmp_path / "a.json", str(stream))
    with refuses("camera_path.times"):
        write_path_keys([Key(1.0, CAMERA), Key(1.0, CAMERA)], tmp_path / "b.json")
        read_intro(tmp_path / "b.json", str(stream))
    with refuses("camera_path.too_many_keys", value=1001):
        write_path_keys([Key(float(i), CAMERA) for i in range(1001)], tmp_path / "c.json")
        read_intro(tmp_path / "c.json", str(stream))
    with refuses("camera_path.which_camera"):
        (tmp_path / "d.nk").write_text(NUKE % "a" + NUKE % "b")
        read_intro(tmp_path / "d.nk", str(stream))


@pytest.mark.parametrize("text", ["", "30", "30,x", "nan,10", "30,10,0", "30,10,2,0,0", '30,10"><script>'])
def test_a_view_must_be_one(text: str) -> None:
    with refuses("share.view", value=text):
        read_view(text)


def test_without_the_player_or_a_stream(stream: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with refuses("stream.not_found", file=str(tmp_path / "none")):
        share(str(tmp_path / "none"), tmp_path / "site")
    with refuses("source.file_missing", file=tmp_path / "manifest.json"):
        share(tmp_path, tmp_path / "take.html")
    (tmp_path / "take").mkdir()
    (tmp_path / "take" / "take.json").write_text(json.dumps({"format": TAKE_FORMAT}))
    (tmp_path / "take" / "stream" / "files").mkdir(parents=True)  # a bake was interrupted
    with refuses("take.no_stream", file=str(tmp_path / "take")):
        share_size(str(tmp_path / "take"))

    def missing() -> Path:
        raise FileNotFoundError

    monkeypatch.setattr("v3studio.pipelines.share.player_files.player_folder", missing)
    with refuses("share.no_player"):
        share(stream, tmp_path / "site")
    assert not (tmp_path / "site").exists()


def test_the_command_says_what_it_wrote(here: Here, stream: Path, tmp_path: Path) -> None:
    write_path_keys([Key(3.0, CAMERA, 5.0), Key(4.5, CAMERA, 0.0)], tmp_path / "path.json")
    words = ("--title", "One", "--credits", "Two", "--license", "Three", "--description", "Four <walks>")
    options = (*words, "--intro", tmp_path / "path.json", "--view=-30,10")
    done = here("share", stream, "--out", tmp_path / "site", *options).ok()
    total = sum(map(len, contents(tmp_path / "site").values()))
    assert f"{total:,} bytes" in done.stdout
    page = Page(tmp_path / "site" / "index.html")
    (player,) = page.named("v3-player")
    assert (player["data-title"], player["data-credits"], player["data-license"]) == ("One", "Two", "Three")
    described = (player["data-description"], player["intro"], player["view"])
    assert described == ("Four <walks>", "#v3-intro", "-30,10")
    (intro,) = [json.loads(text) for attributes, text in page.texts if attributes.get("id") == "v3-intro"]
    assert [key["time"] for key in intro["keys"]] == [0.0, 1.5]
    assert intro["keys"][0]["camera"]["world_to_camera"] == CAMERA.world_to_camera.tolist()
    done = here("share", stream, "--out", tmp_path / "take.html", "--json")
    assert done.result["form"] == "single-file"
    assert done.result["total_bytes"] == (tmp_path / "take.html").stat().st_size
    assert all(isinstance(event, Progress) for event in done.events[:-1])
    done = here("share", stream, "--out", tmp_path / "site2", "--address", 'https://example.org/"walk"/')
    assert '<iframe src="https://example.org/&quot;walk&quot;/"' in done.stdout
    for address in ("example.org", "ftp://example.org/", "https://example.org/?a=1"):
        done = here("share", stream, "--out", tmp_path / "b", "--address", address, "--json").fails(code=2)
        assert json.loads(done.stdout.splitlines()[-1])["code"] == "command.invalid_option"


def test_files_with_which_playback_begins(tmp_path: Path) -> None:
    # what the manifest names could end the script element, or be elsewhere.
    assert first_files(b"{") == first_files(b"[]") == first_files(b'{"groups": [{"renditions": []}]}') == []
    three = bake_numbered(tmp_path / "three", (2,), 12.0, settings=BakeSettings(preset="ultrafast"))
    manifest = (three / "manifest.json").read_text()
    side, video = first_files(manifest.encode())
    assert (three / side).is_file()
    assert (three / video).is_file()
    for wrong in ("https://example.org/a.mp4", "</script>.mp4", "../other.mp4"):
        assert first_files(manifest.replace(video, wrong).encode()) == []


def test_a_stream_is_shared_with_all_its_renditions(tmp_path: Path) -> None:
    settings = BakeSettings(preset="ultrafast", ladder=(Rung(qp=10), Rung(qp=40)))
    source = bake_numbered(tmp_path / "ladder", (2, 3), 12.0, settings=settings)
    share(source, tmp_path / "site")
    assert contents(tmp_path / "site" / "stream") == contents(source)
    single = share(source, tmp_path / "one.html")
    embedded = {script["data-v3-file"] for script in Page(single.path).named("script") if "data-v3-file" in script}
    assert embedded == set(contents(source))
    early = Page(tmp_path / "site" / "index.html").texts[1]
    manifest = json.loads((source / "manifest.json").read_bytes())
    best, coarse = manifest["groups"][0]["renditions"]
    for name in ("side", "video"):
        assert f'"{coarse[name]["path"]}": "stream/{coarse[name]["path"]}"' in early[1]
        assert best[name]["path"] not in early[1] or best[name] == coarse[name]
    size = share_size(str(source))
    assert size.stream_bytes == single.stream_bytes == sum(map(len, contents(source).values()))
    assert size.frames == 5
