import contextlib
import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support.events import frames_in, stop_when, trains_a_frame
from tests.support.streams import contents
from tests.support.tiny_capture import v3studio
from v3studio.pipelines.events import Log, Metrics, StageStarted
from v3studio.pipelines.stages.training import group as train_group
from v3studio.studio.errors import Cancelled


def test_stopped_and_killed_it_gives_the_same_stream(finished: Path, project: Path, start: Callable[..., Any]) -> None:
    take = project / "take"
    arguments = ("run", project / "ball.yaml", "--take", take, "--json")

    stopped = start(*arguments)
    events = stop_when(stopped, trains_a_frame, signal.SIGTERM)
    assert stopped.returncode == 130
    assert events[-1].outcome == "cancelled"
    done = frames_in(events)
    assert done[0] == 1, "the keyframe is in the middle"

    # one frame more is done, others are in progress in two parallel groups
    first = start(*arguments, "--run.groups-at-once", "2")
    events = stop_when(first, trains_a_frame)
    assert first.returncode == -signal.SIGKILL
    assert not (take / "stream").exists()
    assert not set(frames_in(events)) & set(done)
    done += frames_in(events)
    assert len(done) < 5

    # during baking: the first group is done, the manifest is not written yet
    second = start(*arguments)
    events = stop_when(second, lambda one: isinstance(one, Metrics) and (one.stage, one.group) == ("bake", 0))
    # a finished frame is not trained again
    assert not set(frames_in(events)) & set(done)
    assert not (take / "stream" / "manifest.json").exists() or second.returncode == -signal.SIGKILL

    events = v3studio(*arguments).ok().events
    assert [event.stage for event in events if isinstance(event, StageStarted)][-1] == "evaluate"
    assert frames_in(events) == []
    assert contents(take / "stream") == contents(finished / "take" / "stream")
    ours, unbroken = (json.loads((folder / "evaluation.json").read_text()) for folder in (take, finished / "take"))
    assert ours == unbroken
    assert not list(take.rglob("*.partial*"))


@contextlib.contextmanager
def cancelled_after(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cancel the run when it has written the file with this name."""
    write = train_group.write_tensors

    def stops(path: Path, *arguments) -> None:
        write(path, *arguments)
        if path.name == name:
            raise Cancelled

    with monkeypatch.context() as patched:
        patched.setattr(train_group, "write_tensors", stops)
        yield


def test_stopped_inside_a_keyframe_continues_from_its_checkpoint(
    project: Path, here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run is in this process, where checkpoints can be more frequent than every 500 steps."""
    monkeypatch.setattr("v3studio.studio.training.settings.CHECKPOINT_EVERY", 10)

    def run(name: str) -> Any:
        options = ("--capture.frames", ":2", "--until", "train", "--json")
        return here("run", project / "ball.yaml", "--take", project / name, *options)

    run("unbroken").ok()
    checkpoint = project / "stopped" / "train" / "group_000" / "keyframe.checkpoint"
    with cancelled_after("keyframe.checkpoint", monkeypatch):
        assert run("stopped").returncode == 130
    assert checkpoint.exists()
    stages = here("status", project / "stopped", "--json").result["stages"]
    assert stages["train"]["state"] == "partial", "it is neither missing nor done"
    frames = [project / name / "train" / "group_000" / "frame_000001.safetensors" for name in ("unbroken", "stopped")]
    assert not frames[1].exists()
    again = run("stopped")
    messages = [event.message for event in again.events if isinstance(event, Log)]
    assert any("resuming the keyframe at step 10" in message for message in messages), messages
    assert frames[0].read_bytes() == frames[1].read_bytes()
    assert not checkpoint.exists()


def test_killed_between_frames_continues_on_the_side_of_the_keyframe(project: Path, start: Callable[..., Any]) -> None:
    """The keyframe is frame 2, and the first guess of frame 0 takes frames 1 and 2, which a resumed run has to read."""
    one_group = ("--train.group_size", "5", "--capture.frames", ":5")

    def run(name: str) -> tuple:
        return ("run", project / "ball.yaml", "--take", project / name, "--json", *one_group)

    v3studio(*run("unbroken")).ok()
    for attempt in range(5):  # on a busy machine the kill may come too late
        killed = f"killed{attempt}"
        process = start(*run(killed))
        events = stop_when(process, lambda event: frames_in([event]) == [1])
        frames = [project / name / "train" / "group_000" / "frame_000000.safetensors" for name in ("unbroken", killed)]
        if not frames[1].exists():
            break
    assert not frames[1].exists(), "it was killed too late for this test to mean anything"
    assert frames_in(events) == [2, 3, 4, 1]
    assert frames_in(v3studio(*run(killed)).ok().events) == [0]
    assert frames[0].read_bytes() == frames[1].read_bytes()


def test_stopped_in_joint_training_continues_from_its_checkpoint(
    project: Path, here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It continues, too, if it is stopped while it replaces the frames; without it, they are what they were before."""
    monkeypatch.setattr("v3studio.studio.training.settings.CHECKPOINT_EVERY", 10)
    frames = [f"frame_{index:06d}.safetensors" for index in range(3)]

    def run(name: str, iterations: int = 12) -> tuple[int, list[int], list[str]]:
        options = ("--capture.frames", ":3", "--until", "train", "--train.joint_iterations", iterations, "--json")
        done = here("run", project / "ball.yaml", "--take", project / name, *options)
        messages = [event.message for event in done.events if isinstance(event, Log)]
        return done.returncode, frames_in(done.events), messages

    def bytes_of(name: str) -> list[bytes]:
        return [(project / name / "train" / "group_000" / frame).read_bytes() for frame in frames]

    assert run("plain", 0)[:2] == (0, [1, 2, 0])
    assert run("unbroken")[:2] == (0, [1, 2, 0])
    with cancelled_after("joint.checkpoint", monkeypatch):
        assert run("stopped")[0] == 130
    assert bytes_of("stopped") == bytes_of("plain"), "the frames are there while they wait for joint training"

    replace = train_group.write_frame

    def stops_replacing(path: Path, gaussians: Any, about: Any) -> None:
        if path.name == frames[1]:
            raise Cancelled
        replace(path, gaussians, about)

    with monkeypatch.context() as patched:
        patched.setattr(train_group, "write_frame", stops_replacing)
        code, trained, messages = run("stopped")
    assert (code, trained) == (130, [])
    assert any("resuming joint training at step 10" in message for message in messages), messages
    assert run("stopped")[:2] == (0, [])
    assert bytes_of("stopped") == bytes_of("unbroken") != bytes_of("plain")
    assert not list((project / "stopped").rglob("*.checkpoint"))

    assert run("unbroken", 0)[:2] == (0, [])
    assert bytes_of("unbroken") == bytes_of("plain")
    assert not list((project / "unbroken").rglob("separate_*"))
