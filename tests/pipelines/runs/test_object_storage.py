import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from safetensors.numpy import load_file

from tests.support.events import frames_in, stop_when, trains_a_frame
from tests.support.object_store import SECRET, Faults, ObjectStore
from tests.support.tiny_capture import SETTINGS


def results(take: Path) -> dict[str, bytes]:
    """Points, splats and the stream. What names the footage's digest is left out: that of a store is made of ETags."""
    files = [path for name in ("initialize", "train", "stream") for path in (take / name).rglob("*") if path.is_file()]
    return {
        path.relative_to(take).as_posix(): READERS.get(path.name, READERS.get(path.suffix, Path.read_bytes))(path)
        for path in files
        if path.name not in ("group.json", "report.json", "verdict.json", "card.json")
    }


def splats(path: Path) -> bytes:
    """The tensors in a file, without its metadata."""
    return b"".join(name.encode() + tensor.tobytes() for name, tensor in sorted(load_file(path).items()))


READERS: dict[str, Callable[[Path], bytes]] = {
    ".safetensors": splats,
    "motion.json": lambda path: repr(json.loads(path.read_bytes())["motion"]).encode(),
}


def test_footage_in_a_store_makes_the_same_take(
    finished: Path,
    project: Path,
    start: Callable[..., Any],
    here: Callable[..., Any],
    object_store: ObjectStore,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    object_store.upload(project / "capture", "day1")
    (project / "remote.yaml").write_text(SETTINGS.replace("root: capture", "root: s3://studio/day1"))
    take = project / "take"
    object_store.faults = Faults(failing=0.1, truncated=0.1, delay=0.005)
    here("calibrate", project / "remote.yaml", "--take", take).ok()
    images = {key for key, _ in object_store.gets if key.endswith(".png")}
    assert len(images) == 6, "of the footage, only the first frame of each camera is needed here"

    killed = start("run", take, "--json")
    stop_when(killed, trains_a_frame)
    assert object_store.failed > 0
    assert object_store.fetched_twice("day1") == []

    # another machine, which has nothing of the footage yet, resumes
    there = {int(path.stem[6:]) for path in (take / "train").glob("group_*/frame_*")}
    object_store.gets.clear()
    monkeypatch.setenv("V3STUDIO_CACHE", str(tmp_path / "b"))
    again = here("run", take, "--json").ok()
    assert set(frames_in(again.events, "train")) == set(range(5)) - there
    assert object_store.fetched_twice("day1") == []

    for path in take.rglob("*"):
        assert not path.is_file() or SECRET.encode() not in path.read_bytes(), path
    assert results(take) == results(finished / "take")
    assert "s3://studio/day1" in (take / "config.yaml").read_text()


def test_a_take_in_a_store_is_refused(project: Path, here: Callable[..., Any]) -> None:
    for words in (("status",), ("run", project / "ball.yaml", "--take")):
        here(*words, "s3://studio/takes/first").fails("s3://studio/takes/first: ")


def test_a_machine_without_access_says_so_and_changes_nothing(
    project: Path, here: Callable[..., Any], object_store: ObjectStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    import s3fs

    object_store.upload(project / "capture", "day1")
    (project / "remote.yaml").write_text(SETTINGS.replace("root: capture", "root: s3://studio/day1"))
    here("calibrate", project / "remote.yaml", "--take", project / "take").ok()
    before = results(project / "take")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "AKIAWRONG")
    s3fs.S3FileSystem.clear_instance_cache()
    done = here("run", project / "take").fails("error: s3://studio/day1: the store refuses access")
    assert "Traceback" not in done.stderr
    assert SECRET not in done.stderr
    status = here("status", project / "take")  # shows what it can, and why not more
    assert "the store refuses access" in " ".join(status.stdout.split())
    assert results(project / "take") == before
