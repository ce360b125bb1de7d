"""A change that makes a stage stale makes its units stale, too: else it reuses them all, and counts as up to date."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.sounds import clicks, write_wav
from tests.support.streams import contents
from v3studio.pipelines.config import Config, load_config
from v3studio.pipelines.stages import GROUP_STAGES, STAGES, Stage, bake, calibrate_plan, initialize_plan, inputs, params
from v3studio.pipelines.stages.baking import plan, rungs
from v3studio.pipelines.stages.baking.plan import BakePlan
from v3studio.pipelines.stages.baking.publish import publish
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training import plan as train_plan
from v3studio.pipelines.takes.take import Take
from v3studio.studio.stream.attributes import VERSION

MOST = [  # what is read only with these settings
    ("train.joint_iterations", 1),
    ("train.camera_colors", "splats"),
    ("train.refine_cameras", "always"),
    ("bake.ladder", [{"qp": 30, "splats": 0.5, "finetune_iterations": 1}]),
]
PUBLISHED = {  # settings of `bake` that no group depends on, and a value with which the same groups are published again
    "bake.view_range": "none",
    "capture.audio": "",  # a file
    "capture.audio_offset": 0.04,
    "capture.held_out": ["cam0"],
    "evaluate.background": [1, 1, 1],
}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], set[str]]:
    """Names of the settings that a call digests."""
    names: set[str] = set()
    settings_affecting = params.settings_affecting

    def noted(config: Config, *results: str) -> object:
        found = settings_affecting(config, *results)
        names.update(found)
        return found

    for module in (plan, calibrate_plan, initialize_plan, train_plan, *(stage.code for stage in STAGES), inputs, rungs):
        monkeypatch.setattr(module, "settings_affecting", noted, raising=False)

    def during(call: Callable[[], object]) -> set[str]:
        names.clear()
        call()
        return set(names)

    return during


@pytest.mark.parametrize("stage", GROUP_STAGES, ids=lambda stage: stage.name)
def test_settings_of_a_stage_are_settings_of_its_groups(stage: Stage, finished: Path, asked: Callable) -> None:
    take = Take.open(finished / "take")
    inputs = Inputs(take, load_config(take.config, MOST))
    code = stage.group_code
    whole = asked(lambda: code.params(inputs))
    assert whole or stage.name not in ("initialize", "train", "bake", "evaluate")  # others may have no settings
    missing = whole - asked(lambda: code.group_key(inputs, inputs.groups[0]))
    # fine-tuned renditions have training views, too; groups depend on the rate of the footage, wherever it is from
    published = set(PUBLISHED) - {"capture.held_out"} | {"capture.fps"}
    assert missing == (published if stage.name == "bake" else set())


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_no_group_depends_on_changes_what_is_published(take: Take, name: str) -> None:
    wav = str(write_wav(take.root / "sound.wav", clicks(0.3, [0.08])))
    sound = {"capture.audio": wav} if name == "capture.audio_offset" else {}
    found = []
    for changes in (sound, {**sound, name: wav if name == "capture.audio" else PUBLISHED[name]}):
        plan = BakePlan(Inputs(take, load_config(take.config, list(changes.items()))))
        notes = [plan.baked(part) for part in plan.parts]
        assert None not in notes
        publish(plan, notes, live=False, reporter=StageReporter("bake"))
        found.append(contents(take.stream))
    assert found[0] != found[1]


def test_another_version_of_the_stream_makes_bakes_stale(take: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    inputs = Inputs(take, load_config(take.config))

    def made_from() -> tuple[object, str]:
        return bake.params(inputs), bake.group_key(inputs, inputs.groups[0])

    before = made_from()
    for module in (bake, plan):
        monkeypatch.setattr(module, "VERSION", VERSION + 1)
    assert all(old != new for old, new in zip(before, made_from(), strict=True))
