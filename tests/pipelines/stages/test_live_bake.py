import json
import shutil
import sys
import types
from collections.abc import Callable
from typing import Any

import pytest

from tests.support.events import warnings_in
from tests.support.streams import contents
from tests.support.tiny_capture import Here
from tests.support.waiting import wait_until
from v3studio.pipelines import stages
from v3studio.pipelines.config import load_config
from v3studio.pipelines.events import Event
from v3studio.pipelines.stages.baking import live as live_bake
from v3studio.pipelines.stages.baking.live import LiveBake
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, read_frame, write_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio import stream
from v3studio.studio.errors import Cancelled, StudioError
from v3studio.studio.stream import StreamReader, check_stream

Groups = tuple[list[int], bool] | None
FAST = [("run.live", True), ("bake.preset", "ultrafast")]


@pytest.fixture
def take(take: Take) -> Take:
    """A trained take with groups of 3 and 2 frames, without a stream."""
    shutil.rmtree(take.stream)
    return take


def groups_of(take: Take) -> Groups:
    """Frames of each published group, and whether others follow; None before the first."""
    try:
        manifest = json.loads((take.stream / "manifest.json").read_bytes())
    except FileNotFoundError:
        return None
    return [group["frame_count"] for group in manifest["groups"]], manifest["live"]


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch, take: Take) -> list[Groups]:
    """The groups that have been published so far, as `groups_of` tells it."""
    groups = []
    publish = live_bake.publish

    def watched(*arguments: object) -> None:
        publish(*arguments)
        groups.append(groups_of(take))

    monkeypatch.setattr(live_bake, "publish", watched)
    return groups


def live(take: Take, finished: set[int], events: list[Event] | None = None, **settings: object) -> LiveBake:
    config = load_config(take.config, [*FAST, *((f"bake.{name}", value) for name, value in settings.items())])
    reporter = StageReporter("train", ([] if events is None else events).append)
    return LiveBake(Inputs(take, config), reporter, finished)


def interrupted(baking: LiveBake, when: Callable[[], bool]) -> None:
    """Cancel training in this state."""
    baking.__enter__()
    wait_until("baked", when)
    baking.__exit__(Cancelled, Cancelled(), None)


def test_groups_are_published_as_they_are_finished(take: Take, published: list[Groups]) -> None:
    with live(take, {0}, first_group_size=1) as baking:
        wait_until("published", lambda: groups_of(take) == ([1, 2], True))
        with StreamReader.open(take.stream) as reader:
            first = reader.gaussians(0).means
            baking.written(1)
            wait_until("published", lambda: groups_of(take) == ([1, 2, 2], False))
            assert reader.refresh() >= 1
            assert (reader.gaussians(0).means == first).all()
            assert reader.frame_count in (3, 5)
    assert published == [([1], True), ([1, 2], True), ([1, 2, 2], False)]
    with StreamReader.open(take.stream) as reader:
        assert not check_stream(reader).damage


def test_its_set_is_baked_once(take: Take, published: list[Groups], monkeypatch: pytest.MonkeyPatch) -> None:
    write_frame(take.set_splats, read_frame(take.trained_frame(0, 0)), FrameMetadata())
    baked, bake_set = [], stream.bake_set

    def counted(*arguments: Any) -> tuple[stream.Rendition, ...]:
        baked.append(arguments)
        return bake_set(*arguments)

    monkeypatch.setattr(stream, "bake_set", counted)
    with live(take, {0, 1}):
        pass
    assert published == [([3], True), ([3, 2], False)]
    assert len(baked) == 1
    with StreamReader.open(take.stream) as reader:
        assert reader.set_splats() is not None
        assert not check_stream(reader).damage


def test_after_an_interruption_it_does_not_shrink(take: Take, published: list[Groups]) -> None:
    interrupted(live(take, {0}), lambda: groups_of(take) == ([3], True))
    work = take.work("bake")
    (work / "group_000.json").unlink()  # as if killed: it is baked again
    interrupted(live(take, {0}), (work / "group_000.json").is_file)
    assert published == [([3], True)]
    with live(take, {0, 1}):
        pass
    with live(take, {0, 1}):  # nothing is new
        assert groups_of(take) == ([3, 2], False)
    assert published == [([3], True), ([3, 2], False), ([3, 2], False)]


def test_training_outlives_a_failure(take: Take, published: list[Groups], monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments):
        raise StudioError("bake.write_failed", "the disk is full")

    monkeypatch.setattr(live_bake, "publish", fails)
    events = []
    with live(take, {0, 1}, events):
        pass
    assert len(warnings_in(events, "bake.live_failed")) == 1


def test_stages_before_baking_run_first(take: Take, published: list[Groups], monkeypatch: pytest.MonkeyPatch) -> None:
    def run_group(inputs, group, reporter):
        for index in group.indices:
            few = read_frame(take.trained_frame(group.index, index))[:50]
            write_frame(take.finished_frame(group.index, index), few, FrameMetadata())

    code = types.SimpleNamespace(group_done=lambda inputs, group: False, run_group=run_group)
    monkeypatch.setitem(sys.modules, "v3studio.pipelines.stages.fewer", code)
    monkeypatch.setattr(stages, "STAGES", (*stages.STAGES, stages.Stage("fewer", "Fewer", "", version=1, weight=1)))
    monkeypatch.setattr(live_bake, "CHAIN", ("initialize", "train", "fewer", "bake"))
    monkeypatch.setattr(Take, "finished_frame", lambda take, group, index: take.root / "fewer" / f"{group}_{index}")
    with live(take, {0, 1}):
        pass
    assert published == [([3], True), ([3, 2], False)]
    with StreamReader.open(take.stream) as reader:
        assert [len(reader.gaussians(frame)) for frame in range(5)] == [50] * 5


@pytest.mark.parametrize("joint", [0, 2])
def test_live_training_gives_the_stream_of_a_bake(here: Here, take: Take, published: list[Groups], joint: int) -> None:
    shutil.rmtree(take.root / "train" / "group_001")
    here("train", take.root, "--live", "--bake.preset", "ultrafast", "--train.joint_iterations", joint).ok()
    assert published == [([3], True), ([3, 2], False)]
    before = contents(take.stream)
    here("run", take.root, "--until", "bake", "--run.live", "false").ok()
    assert contents(take.stream) == before
