import ast
import functools
from pathlib import Path

import pytest

from v3studio.gui.models.take.log import grouped
from v3studio.gui.models.take.page_words import setting_words
from v3studio.gui.models.take.remedies import REMEDIES, Fix, fix_of
from v3studio.gui.models.take.run_state import RunState
from v3studio.gui.models.take.settings import SECTIONS, fields_of, stage_of
from v3studio.gui.widgets.stage_help import HELP
from v3studio.pipelines.config.loading import load_config
from v3studio.pipelines.events import Warned
from v3studio.studio.yaml_text import inline_yaml

ROOT = Path(__file__).parents[4]
SETTINGS = {field.name for stage in SECTIONS for field in fields_of(stage)}
OF_THE_FOOTAGE = {"footage.camera_ends_early", "footage.frames_missing", "mask.empty", "mask.full"}
"""Problems that stop a stage, and that Capture lists; not warnings."""
OTHERS = {
    "bakes.evaluation_not_noted", "calibration.worker_failed", "command.usage", "edits.no_take",
    "mask.no_source", "playback.failed", "program.bug", "run.cancelled", "settings.invalid", "settings.no_take",
    "settings.run_active", "settings.unknown", "sync.offset", "sync.several", "sync.unknown",
}  # fmt: skip
"""Messages of commands, of errors and of the window: no warnings of stages."""
NO_SETTING = {
    "bake.live_failed",  # retried automatically
    "files.no_locks",  # of a file system
    "card.wrong",  # the card names the cause
    "mask.beyond_view",  # turn the camera, or leave it out
    "calibration.low_coverage",  # film the board, or the set, in more of the image
    "calibration.poor_cameras",  # they moved, or are out of focus
    "cluster.busy",  # other programs have its nodes
    "cluster.worker_lost",  # restarted automatically
    "evaluation.not_visible",  # of one frame
    "footage.color_drift",  # in the footage
    "lpips.other_weights",  # a file on this machine
    "mask.weak",  # in the files
    "target.outlier_views",  # in the footage
    "tie_points.position_uncertainty",  # marks: "points by hand"
    "tie_points.rejected",
    "tie_points.reprojection_error",
    "tie_points.unit",
    "tie_points.world_error",
    "training.not_visible",  # of one frame
}
"""Warnings of stages that no setting fixes."""


@functools.cache
def sources() -> list[ast.AST]:
    """The files that have messages or name settings."""
    paths = [path for package in ("studio", "pipelines", "gui") for path in sorted((ROOT / package).rglob("*.py"))]
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return [ast.parse(text) for text in texts if any(word in text for word in ("Message(", "setting=", '"setting"'))]


def text_of(node: ast.AST | None) -> str:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def test_every_warning_has_a_remedy_or_none_is_possible() -> None:
    codes = {
        text_of(node.args[0])
        for tree in sources()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Message" and node.args
    } - {""}
    assert "training.slow" in codes
    assert codes - OTHERS - OF_THE_FOOTAGE == set(REMEDIES) | NO_SETTING
    assert not set(REMEDIES) & NO_SETTING


def test_every_setting_that_a_message_names_exists() -> None:
    named = set(REMEDIES.values())
    named |= {setting for topic in HELP.values() for setting in topic.settings}
    for tree in sources():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                named |= {text_of(word.value) for word in node.keywords if word.arg == "setting"}
            elif isinstance(node, ast.Dict):
                named |= {
                    text_of(value)
                    for key, value in zip(node.keys, node.values, strict=True)
                    if text_of(key) == "setting"
                }
    named = {name for name in named if "." in name}
    assert len(named) > 20
    blocks = {name.rsplit(".", 1)[0] for name in SETTINGS if name.count(".") > 1}
    assert "calibrate.board" in blocks
    assert named <= SETTINGS | blocks, named - SETTINGS
    assert all(stage_of(name) for name in named), "so that the window can show them"
    assert stage_of("capture") == "capture"
    assert stage_of("") == ""


@pytest.mark.parametrize(
    ("code", "fields", "setting", "value"),
    [
        ("training.slow", {"suggested": 0.42}, "capture.scale", 0.42),
        (
            "masks.contradiction",
            {"setting": "capture.masks", "suggested": ["alpha", "model"]},
            "capture.masks",
            ["alpha", "model"],
        ),
        ("footage.few_frames", {"frames": 7}, "calibrate.frame_count", 7),
        ("coverage.gaps", {}, "bake.view_range", "none"),
    ],
)
def test_the_value_of_a_warning_is_valid(
    code: str, fields: dict[str, object], setting: str, value: object, footage_project: Path
) -> None:
    config = load_config(footage_project / "ball.yaml", [("calibrate.frame_count", 9)])
    warning = Warned(message="m", code=code, fields=fields)
    fix = fix_of(warning, config)
    assert fix == Fix(setting, value, sets=True)
    changed = load_config(footage_project / "ball.yaml", [(setting, value)])
    again = fix_of(warning, changed)
    assert again.done
    assert again.words == f"{setting_words(setting)} is {inline_yaml(value)} now"


def test_a_warning_about_masks_leads_to_the_mask(footage_project: Path) -> None:
    config = load_config(footage_project / "ball.yaml", [])
    several = Warned(code="evaluation.masks_contradicted", fields={"cameras": ["cam1", "cam2"], "frames": [3, 4]})
    fixes = [
        fix_of(warning, config) for warning in (Warned(code="hull.outlier_mask", fields={"camera": "cam2"}), several)
    ]
    assert [fix and (fix.camera, fix.frame) for fix in fixes] == [("cam2", -1), ("cam1", 3)]


def test_the_same_warning_about_several_cameras_is_one_line() -> None:
    run = RunState()
    for code, text, camera, group in (
        ("mask.weak", "Camera '{}': weak screen", "a", 0),
        ("mask.weak", "Camera '{}': weak screen", "b", 0),
        ("mask.weak", "Camera '{}': weak screen", "a", 1),
        ("mask.dark", "Camera '{}': dark screen", "a", 1),
        ("", "a line", "", 1),
        ("", "a line", "", 1),
    ):
        run.apply(Warned(message=text.format(camera), code=code, fields={"camera": camera, "group": group}))
    told = grouped(run.lines)
    assert [line.text for line in told] == [
        "Camera 'a': weak screen (in 2 cameras: a and b)",
        "Camera 'a': weak screen",
        "Camera 'a': dark screen",
        "a line",
        "a line",
    ]
    assert told[0].notice is run.lines[0].notice, "it has the same remedy"
    assert len(run.lines) == 6, "the run itself keeps all"
