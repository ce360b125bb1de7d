import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import cv2
import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.streams import bake_numbered, edit_manifest
from tests.support.tiny_capture import FRAMES, SETTINGS, write_capture
from tests.support.web_servers import PLAYER, ask, running
from v3studio.pipelines.config import dump_config, load_config
from v3studio.pipelines.review.take_review import TakeReview
from v3studio.pipelines.share.served import find_reviews, find_streams
from v3studio.pipelines.share.web_app import Reviews, build_app
from v3studio.pipelines.takes.authored.marks import MAX_NOTE, Mark, change_mark, read_marks
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.files.settings_file import set_settings
from v3studio.pipelines.takes.results.records import StageRecord
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.similarity import Similarity
from v3studio.studio.stream import BakeSettings

SECRET = "k3y"
BASE = f"/{SECRET}/.review"


def quality(value: float) -> dict[str, float]:
    return {"psnr_trained": value + 1, "psnr_decoded": value, "ssim_trained": 0.9, "ssim_decoded": 0.9}


def evaluation() -> dict[str, Any]:
    """An evaluation as the stage writes it; frame 3 was not measured."""
    rows = [
        {**quality(30 + n), "index": n, "frame": n, "group": 0, "starts_group": n == 0, "splats": 40,
         "bytes": 900.0 + n, "cameras": {"cam4": quality(30 + n)}}
        for n in (0, 1, 2, 4)
    ]  # fmt: skip
    protocol = {
        "cameras": ["cam4"], "held_out": True, "note": "", "resolution": {"cam4": [64, 48]}, "crop": "",
        "background": [0, 0, 0], "footage": "", "frames": [0, 1, 2, 3, 4], "mean": "", "ssim": "", "total_bytes": 5000,
        "total_bytes_are": "", "set_bytes": 0, "bytes_of_a_frame": "",
    }  # fmt: skip
    lowest = {"psnr_trained_lowest_frame": 31.0, "psnr_decoded_lowest_frame": 30.0}
    summary = {**quality(31.75), "bytes_per_frame": 1000.0, **lowest}
    masks = {"evidence": "masks", "cameras": ["cam4"], "least_share": 0.04, "contradictions": []}
    return {
        "summary": summary, "protocol": protocol, "cameras": {"cam4": quality(31.75)}, "frames": rows, "masks": masks,
    }  # fmt: skip


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Take:
    """A take of the ball's footage, with a stream of other splats."""
    project = tmp_path_factory.mktemp("reviewed")
    write_capture(project / "capture")
    (project / "ball.yaml").write_text(SETTINGS)
    take = Take.create(project / "take")
    take.config.write_text(dump_config(load_config(project / "ball.yaml")))
    take.rig.parent.mkdir()
    write_rig(read_rig(project / "capture" / "cameras.json"), take.rig)
    bake_numbered(take.stream, (FRAMES,), 25.0, 20, BakeSettings(quality=0, preset="ultrafast"))
    take.evaluation.write_text(json.dumps(evaluation()))
    return take


@pytest.fixture(scope="module")
def port(take: Take) -> Iterator[int]:
    streams = find_streams(str(take.root))
    with running(build_app(streams, PLAYER, Reviews(SECRET, find_reviews(streams)))) as port:
        yield port


@pytest.fixture(autouse=True)
def unmarked(take: Take) -> None:
    take.marks.unlink(missing_ok=True)


def send(port: int, change: Any, kind: str = "application/json", path: str = f"{BASE}/marks") -> tuple[int, Any]:
    body = change if isinstance(change, bytes) else json.dumps(change).encode()
    status, _, answer = ask(port, path, "POST", body, Content_Type=kind)
    return status, answer


def mark(frame: int, note: str | None, replaces: dict[str, str] | None = None, author: str = "Anna") -> dict[str, Any]:
    return {"frame": frame, "mark": None if note is None else {"note": note, "author": author}, "replaces": replaces}


def test_figures_are_those_of_the_evaluation_and_cameras_those_of_the_rig(port: int, take: Take) -> None:
    data = json.loads(ask(port, f"{BASE}/data.json")[2])
    psnr, ssim = data["quality"]["metrics"]
    assert (psnr["title"], psnr["unit"], ssim["title"]) == ("masked PSNR", "dB", "SSIM")
    assert psnr["trained"] == [31, 32, 33, None, 35]
    assert psnr["decoded"] == psnr["by_camera"]["cam4"] == [30, 31, 32, None, 34]
    assert data["quality"]["bytes"] == [900, 901, 902, None, 904]
    assert (data["frame_count"], data["problems"], data["quality"]["held_out"]) == (5, [], True)
    (camera,) = data["cameras"]
    rig = {camera["name"]: camera for camera in json.loads(take.rig.read_text())["cameras"]}["cam4"]
    assert (camera["name"], camera["width"], camera["height"], camera["undistorted"]) == ("cam4", 64, 48, False)
    assert camera["K"] == rig["K"]
    assert np.allclose(camera["world_to_camera"], rig["world_to_camera"])


def test_pictures_are_the_footage_over_the_background(port: int, take: Take) -> None:
    status, headers, body = ask(port, f"{BASE}/frames/cam4/3.jpg")
    assert (status, headers["content-type"]) == (200, "image/jpeg")
    assert headers["cache-control"].startswith("private")
    shown = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
    filmed = cv2.imread(str(take.root.parent / "capture" / "images" / "cam4" / "003.png"), cv2.IMREAD_UNCHANGED)
    expected = np.where(filmed[..., 3:] > 127, filmed[..., :3], 0)
    assert np.abs(shown.astype(int) - expected).mean() < 6, "JPEG"


def test_nothing_else(port: int) -> None:
    """cam0 is a training camera."""
    for frame in ("cam0/3", "cam4/5", "cam4/-1", f"cam4/{'9' * 5000}", "../3"):
        assert ask(port, f"{BASE}/frames/{frame}.jpg")[0] == 404
    assert ask(port, f"{BASE}/")[0] == 404


@pytest.mark.parametrize("path", ["data.json", "marks", "frames/cam4/3.jpg"])
def test_without_the_link_there_is_no_review(port: int, path: str) -> None:
    for base in ("/.review", "/wrong/.review", f"/{SECRET}.review"):
        assert ask(port, f"{base}/{path}")[0] == 404
    assert send(port, mark(1, "x"), path="/.review/marks")[0] in (404, 405)
    browser = {"Accept": "text/html"}
    name = next(name for name, data in PLAYER.hashed(review=True).items() if data == PLAYER.review)
    assert name in ask(port, f"/{SECRET}/", **browser)[2].decode()
    assert name not in ask(port, "/", **browser)[2].decode()
    assert ask(port, f"/{SECRET}/.player/{name}")[2] == PLAYER.review
    assert ask(port, f"/.player/{name}")[0] == 404


def test_marks_are_written_to_the_take_as_plain_text(port: int, take: Take) -> None:
    status, answer = send(port, mark(3, "  axe \n is <b>thin</b>\x1b[31m \u202eevil\x00 ", author="Anna\n <i>"))
    assert status == 200, answer
    row = {"frame": 3, "note": "axe is <b>thin</b>[31m evil", "author": "Anna <i>"}
    assert json.loads(take.marks.read_text())["marks"] == [row]
    row["view"] = None
    assert json.loads(answer) == {"marks": [row], "problem": None}
    change_mark(take.marks, 1, Mark(frame=1, note="in the window"), None)
    status, headers, answer = ask(port, f"{BASE}/marks")
    assert json.loads(answer)["marks"] == [{"frame": 1, "note": "in the window", "author": "", "view": None}, row]
    assert headers["content-type"] == "application/json"
    assert ask(port, f"{BASE}/marks", If_None_Match=headers["etag"])[::2] == (304, b"")
    seen = {"note": row["note"], "author": row["author"]}
    assert send(port, mark(3, None, seen))[0] == 200
    assert list(read_marks(take.marks)) == [1]


VIEW = {"eye": [0.0, -3.5, 1.0], "target": [0.0, 0.0, 1.0], "fov": 40.0, "camera": "cam4", "wipe": 0.25, "whole": True}
VIEW |= {"place": [0.1, 0.0, 1.3]}
NO_EYES = ({"eye": VIEW["target"]}, {"eye": [0, 1]}, {"eye": None}, {"place": [0, 1]})
FAR = ({"eye": [1e308, 0, 0]}, {"target": [0, -1.1e9, 0]}, {"place": [0, 0, 1e10]})


@pytest.mark.parametrize("part", [*NO_EYES, *FAR, {"fov": 0}, {"fov": 180.0}, {"wipe": 1.5}, {"camera": "c" * 300}])
def test_views_that_cannot_be_looked_from_are_refused(port: int, take: Take, part: dict[str, Any]) -> None:
    change = mark(1, "x")
    change["mark"]["view"] = {**VIEW, **part}
    assert send(port, change)[0] == 400
    assert not take.marks.exists()


def test_a_view_too_far_for_the_world_of_the_take_is_refused(take: Take, port: int, tmp_path: Path) -> None:
    """The stream's world is a billionth of the take's."""
    shutil.copytree(take.root, tmp_path / "take")
    place = {"first_frame": 0, **Similarity(scale=1e-9).to_json()}
    edit_manifest(tmp_path / "take" / "stream", lambda manifest: manifest["metadata"].update(capture=place))
    streams = find_streams(str(tmp_path / "take"))
    with running(build_app(streams, PLAYER, Reviews(SECRET, find_reviews(streams)))) as port:
        change = mark(1, "x")
        change["mark"]["view"] = VIEW
        assert send(port, change)[0] == 400
        assert json.loads(ask(port, f"{BASE}/marks")[2]) == {"marks": [], "problem": None}


def test_a_change_sent_again_after_a_lost_answer_is_accepted(port: int, take: Take) -> None:
    first = mark(2, "first")
    first["mark"]["view"] = VIEW
    second = mark(2, "second", {"note": "first", "author": "Anna"})
    removed = mark(2, None, {"note": "second", "author": "Anna"})
    for change in (first, second, removed):
        once = send(port, change)
        written = take.marks.stat()
        assert (once[0], send(port, change)) == (200, once)
        assert take.marks.stat().st_mtime_ns == written.st_mtime_ns, "nothing to write"


def test_no_marks_are_told_from_marks_that_cannot_be_read(port: int, take: Take) -> None:
    assert send(port, mark(2, "mine", {"note": "the only one", "author": "Ben"})) == (409, ANY)
    answer = json.loads(send(port, mark(2, "mine", {"note": "the only one", "author": "Ben"}))[1])
    assert answer["marks"] == []
    take.marks.write_text("{")
    status, body = send(port, mark(2, "mine"))
    assert (status, json.loads(body)["marks"]) == (500, None)


def test_nobody_loses_what_another_wrote(port: int, take: Take) -> None:
    assert send(port, mark(2, "first"))[0] == 200
    status, answer = send(port, mark(2, "second", author="Ben"))
    assert status == 409
    assert json.loads(answer)["marks"] == [{"frame": 2, "note": "first", "author": "Anna", "view": None}]
    assert str(take.root) not in answer.decode()
    change_mark(take.marks, 2, Mark(frame=2, note="window"), Mark(frame=2, note="first", author="Anna"))
    assert send(port, mark(2, None, {"note": "first", "author": "Anna"}))[0] == 409
    assert send(port, mark(2, "both", {"note": "window", "author": ""}))[0] == 200


@pytest.mark.parametrize(
    ("change", "status"),
    [
        (mark(5, "beyond the end"), 404),
        (mark(-1, "x"), 400),
        ({**mark(1, "x"), "frame": True}, 400),
        ({**mark(1, "x"), "frame": 1.5}, 400),
        ({**mark(1, "x"), "more": 1}, 400),
        ({"frame": 1}, 400),
        (b"{", 400),
        (b"[" * 20_000, 400),
        (b'{"frame": 1' + b"0" * 5000 + b"}", 400),
        (b"\xff", 400),
        (mark(1, "x" * (MAX_NOTE + 1)), 413),
        (b" " * 70_000, 413),
    ],
)
def test_bad_changes_are_refused(port: int, take: Take, change: Any, status: int) -> None:
    assert send(port, change)[0] == status
    assert not take.marks.exists()


def test_other_pages_cannot_write(port: int, take: Take) -> None:
    """A page of another origin can send these types without asking first, and no other."""
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x"):
        assert send(port, mark(1, "x"), kind)[0] == 415
    asked = ask(
        port, f"{BASE}/marks", "OPTIONS", Origin="https://evil.example", Access_Control_Request_Method="POST",
        Access_Control_Request_Headers="content-type",
    )  # fmt: skip
    assert asked[0] in (400, 405)
    assert "access-control-allow-origin" not in asked[1]
    assert not take.marks.exists()


def test_other_pages_cannot_frame_a_review(take: Take) -> None:
    streams = find_streams(str(take.root))
    with running(build_app(streams, PLAYER, Reviews(SECRET, find_reviews(streams)), origins=["*"])) as port:
        for page, allowed in ((f"/{SECRET}/", "'self'"), ("/", "'self' *")):
            headers = ask(port, page, Accept="text/html")[1]
            assert headers["content-security-policy"] == f"frame-ancestors {allowed}"


def test_figures_of_an_earlier_stream_are_told(take: Take) -> None:
    records = (take.record("bake"), take.record("evaluate"))
    try:
        write_model(records[0], StageRecord(stage="bake", params={}, result="first"))
        write_model(records[1], StageRecord(stage="evaluate", params={"result of bake": "first"}, result="figures"))
        assert TakeReview(take).data().problems == ()
        write_model(records[0], StageRecord(stage="bake", params={}, result="second"))
        assert len(TakeReview(take).data().problems) == 1
    finally:
        for record in records:
            record.unlink(missing_ok=True)


def test_a_review_hands_out_the_plain_link(take: Take, tmp_path: Path) -> None:
    shutil.copytree(take.root, tmp_path / "a b")
    below = (tmp_path, f"/{SECRET}/a%20b/", "../../t0ken/a%20b/")
    for folder, page, link in ((take.root, f"/{SECRET}/", "../t0ken/"), below):
        streams = find_streams(str(folder))
        with running(build_app(streams, PLAYER, Reviews(SECRET, find_reviews(streams)), "t0ken")) as port:
            assert f'data-link="{link}"' in ask(port, page, Accept="text/html")[2].decode()
            plain = page.replace(SECRET, "t0ken")
            assert "data-link" not in ask(port, plain, Accept="text/html")[2].decode()
            assert f"/{SECRET}{plain.removeprefix('/t0ken')}manifest.json" in ask(port, f"/{SECRET}/")[2].decode()


def test_a_stream_alone_cannot_be_reviewed(take: Take, tmp_path: Path) -> None:
    shutil.copytree(take.stream, tmp_path / "stream")
    with refuses("serve.nothing_to_review"):
        find_reviews(find_streams(str(tmp_path / "stream")))


def test_footage_that_comes_back_is_shown(take: Take, tmp_path: Path) -> None:
    copy = Take(Path(shutil.copytree(take.root, tmp_path / "reviewed")))
    footage = load_config(copy.config).capture.root
    set_settings(copy.config, {"capture.root": str(tmp_path / "away")})
    review = TakeReview(copy)
    assert review.data().cameras == ()
    shutil.copytree(footage, tmp_path / "away")
    assert len(review.data().cameras) == len(TakeReview(take).data().cameras) > 0
