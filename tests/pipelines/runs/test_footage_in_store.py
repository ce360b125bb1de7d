"""Runs with footage in an S3 store that fails and is slow: the bytes of a local run, and nothing fetched twice."""

from __future__ import annotations

from pathlib import Path

from safetensors.numpy import load_file

from tests.support.object_store import SECRET, Faults, ObjectStore
from tests.support.tiny_capture import SETTINGS


def results(take: Path) -> dict[str, bytes]:
    """Points, splats and the stream. What names the footage's digest is left out: that of a store is made of ETags."""
    files = [path for name in ("initialize", "train", "stream") for path in (take / name).rglob("*") if path.is_file()]
    return {
        path.relative_to(take).as_posix(): splats(path) if path.suffix == ".safetensors" else path.read_bytes()
        for path in files
        if path.name not in ("group.json", "report.json")
    }


def splats(path: Path) -> bytes:
    """The tensors in a file, without its metadata."""
    return b"".join(name.encode() + tensor.tobytes() for name, tensor in sorted(load_file(path).items()))


def test_workers_of_a_machine_fetch_footage_once_and_make_the_take_of_a_local_run(
    finished, project, start, here, object_store: ObjectStore
):
    object_store.upload(project / "capture", "day1")
    (project / "remote.yaml").write_text(SETTINGS.replace("root: capture", "root: s3://studio/day1"))
    take = project / "take"
    object_store.faults = Faults(failing=0.1, truncated=0.1, delay=0.005)
    done = here("calibrate", project / "remote.yaml", "--take", take)
    assert done.returncode == 0, done.stderr
    frames = {key for key, _ in object_store.gets if key.endswith(".png")}
    assert len(frames) == 6, "of the footage, only the first frame of each camera is needed here"
    workers = [start("work", take, "--group", group) for group in (0, 1)]
    told = [worker.communicate() for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0], told
    done = here("run", take)
    assert done.returncode == 0, done.stderr
    assert object_store.failed > 0
    assert len({key for key, _ in object_store.gets if key.endswith(".png")}) == 30
    assert object_store.fetched_twice("day1") == []
    assert results(take) == results(finished / "take")
    assert "s3://studio/day1" in (take / "config.yaml").read_text()
    assert not any(SECRET.encode() in path.read_bytes() for path in take.rglob("*") if path.is_file())
    status = here("status", take)
    assert status.returncode == 0
    assert "stale" not in status.stdout


def test_a_machine_without_access_says_so_and_changes_nothing(project, here, object_store: ObjectStore, monkeypatch):
    import s3fs

    object_store.upload(project / "capture", "day1")
    (project / "remote.yaml").write_text(SETTINGS.replace("root: capture", "root: s3://studio/day1"))
    assert here("calibrate", project / "remote.yaml", "--take", project / "take").returncode == 0
    before = results(project / "take")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "AKIAWRONG")
    s3fs.S3FileSystem.clear_instance_cache()
    done = here("work", project / "take", "--group", 0)
    assert done.returncode == 1
    assert done.stderr.startswith("error: s3://studio/day1: the store refuses access")
    assert "Traceback" not in done.stderr
    assert SECRET not in done.stderr
    status = here("status", project / "take")  # shows what it can, and why not more
    assert "the store refuses access" in " ".join(status.stdout.split())
    assert results(project / "take") == before
