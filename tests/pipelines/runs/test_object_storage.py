"""Runs with footage and take in an S3 store that fails and is slow: the results of a local run, and no footage is
fetched twice by a machine."""

from __future__ import annotations

import signal
from pathlib import Path

from safetensors.numpy import load_file

from pipelines.events import Metrics, RunFinished, RunStarted, read_line
from tests.support.object_store import SECRET, Faults, ObjectStore
from tests.support.tiny_capture import SETTINGS
from tests.support.waiting import wait_until


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


def trained(lines: str) -> set[str]:
    """Names of the frames that were trained, from the events."""
    events = [event for event, _ in map(read_line, lines.splitlines())]
    frames = [event for event in events if isinstance(event, Metrics) and event.frame is not None]
    return {f"frame_{event.values['index']:06d}.safetensors" for event in frames}


def test_machines_that_share_only_a_bucket_make_the_take_of_a_local_run(
    finished, project, start, here, object_store: ObjectStore, tmp_path, monkeypatch
):
    object_store.upload(project / "capture", "day1")
    (project / "remote.yaml").write_text(SETTINGS.replace("root: capture", "root: s3://studio/day1"))
    take = "s3://studio/takes/first"
    object_store.faults = Faults(failing=0.1, truncated=0.1, delay=0.005)
    monkeypatch.setenv("V3STUDIO_CACHE", str(tmp_path / "a"))
    done = here("calibrate", project / "remote.yaml", "--take", take)
    assert done.returncode == 0, done.stderr
    images = {key for key, _ in object_store.gets if key.endswith(".png")}
    assert len(images) == 6, "of the footage, only the first frame of each camera is needed here"

    # two workers of one machine, one of which is killed after its first frame
    whole, killed = (start("work", take, "--group", group, "--json") for group in (0, 1))
    for line in killed.stdout:
        if trained(line):
            killed.send_signal(signal.SIGKILL)
            break
    killed.communicate()
    told = whole.communicate()
    assert whole.returncode == 0, told
    assert object_store.failed > 0
    assert object_store.fetched_twice("day1") == []

    # another machine goes on with what was sent
    sent = {Path(name).name for name in object_store.contents("takes/first/train/group_001")}
    object_store.gets.clear()
    monkeypatch.setenv("V3STUDIO_CACHE", str(tmp_path / "b"))
    again = here("work", take, "--group", 1, "--json")
    assert again.returncode == 0, again.stderr
    assert trained(again.stdout) == {"frame_000003.safetensors", "frame_000004.safetensors"} - sent
    done = here("run", take)
    assert done.returncode == 0, done.stderr
    assert object_store.fetched_twice("day1") == []
    status = here("status", take)
    assert status.returncode == 0
    assert "stale" not in status.stdout

    for name, data in object_store.contents("takes/first").items():
        path = tmp_path / "result" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        assert SECRET.encode() not in data, name
    assert results(tmp_path / "result") == results(finished / "take")
    assert "s3://studio/day1" in (tmp_path / "result" / "config.yaml").read_text()


def test_a_detached_run_is_found_and_cancelled_from_another_machine(
    project, cli, here, object_store: ObjectStore, tmp_path, monkeypatch
):
    take = "s3://studio/takes/first"
    monkeypatch.setenv("V3STUDIO_CACHE", str(tmp_path / "a"))
    begun = cli(
        "run", project / "ball.yaml", "--take", take, "--detach", "--until", "train",
        "--train.keyframe_iterations", "20000",
    )  # fmt: skip
    assert begun.returncode == 0, begun.stderr
    assert f"v3studio attach {take}" in begun.stdout

    monkeypatch.setenv("V3STUDIO_CACHE", str(tmp_path / "b"))
    assert "run in progress: process" in here("status", take).stdout
    refused = here("run", take, "--detach")
    assert refused.returncode == 1
    assert "another run is in progress (process " in refused.stderr
    wait_until("results are sent", lambda: "calibrate/rig.json" in object_store.contents("takes/first"), 600)
    stopped = here("attach", take, "--cancel", "--json")
    assert stopped.returncode == 0, stopped.stderr
    events = [event for event, _ in map(read_line, stopped.stdout.splitlines())]
    assert isinstance(events[0], RunStarted)
    assert isinstance(events[-1], RunFinished)
    assert events[-1].outcome == "cancelled"
    wait_until("the claim is given back", lambda: ".v3studio/holder.json" not in object_store.contents("takes/first"))
    stored = object_store.contents("takes/first")
    assert {"calibrate/rig.json", "config.yaml", "take.json"} <= stored.keys()
    assert "keyframe_iterations: 20000" in stored["config.yaml"].decode()
    none = here("attach", take)
    assert none.returncode == 1
    assert "no run is in progress" in none.stderr


def test_commands_that_need_a_folder_name_the_copy(here, object_store: ObjectStore):
    done = here("estimate", "s3://studio/takes/first")
    assert done.returncode == 1
    assert "v3studio status ADDRESS" in done.stderr
    done = here("status", "s3://studio/takes/first")
    assert done.returncode == 1
    assert "there is no take at this address" in done.stderr


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
