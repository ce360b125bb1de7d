import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.support.tiny_capture import Here
from v3studio.pipelines.cli import make_parser
from v3studio.pipelines.events import StageFailed
from v3studio.pipelines.stages import STAGE_NAMES
from v3studio.pipelines.takes.files.settings_file import set_settings
from v3studio.studio.stream import Rendition, StreamReader


def test_every_command_explains_itself(here: Here) -> None:
    text = here("--help").stdout
    for name in make_parser()[1]:
        assert f"\n    {name}" in text
        here(*name.split(), "--help").ok()


def test_wrong_usage_is_2_and_a_failure_1(here: Here, tmp_path: Path) -> None:
    for arguments in (("fly",), ("config", "--bogus"), ("config", "--train.max-splats")):
        here(*arguments).fails(code=2)
    wrong = (("play", "x", "--bogus"), ("bake", "--bake.quality"), ("export", "x"), ("train", "a.yaml", "b.yaml"))
    for arguments in wrong:
        said = here(*arguments).fails(code=2).stderr
        assert said.startswith(f"usage: v3studio {arguments[0]} "), "its own usage, not that of all commands"
    assert here("--bogus", "bake").stderr.startswith("usage: v3studio [-h]")
    assert here("train", tmp_path / "gone").fails("--take DIR").stderr.count("\n") == 1
    here("bake", tmp_path, "--take", tmp_path / "take").fails()  # a folder without footage
    here("config", "--train.max-splts", "3").fails("train.max_splats?", code=2)
    here("config", "--train.max-splts", "3", "--train.dropout", "9").fails(code=2)
    here("bake").fails("--take takes/first", code=2)
    none = tmp_path / "none.yaml"
    here("run", none, "--take", tmp_path / "take").fails(f"{none}: no such file")
    assert not (tmp_path / "take").exists()


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        ("init capture --out folder", 2, "--out folder is a folder"),
        ("run ball.yaml --take t --set bake.quality", 2, "'bake.quality' is not of the form section.name=value"),
        ("status ball.yaml", 1, "ball.yaml: is a file, not a take"),
        ("config trian", 2, "did you mean train?"),
        ("queue list --queue odd.json", 1, "odd.json: format is missing. Choose another file with --queue"),
        ("export take --format turntable --out t.mp4 --seconds 0", 1, "seconds is 0; it must be above 0"),
        ("export take --format turntable --out t.mp4 --fps 0", 1, "fps is 0; it must be above 0"),
        ("export take --format ply --out odd.json/plys", 1, "plys: cannot be written: a part of the path is a file"),
        ("share take --out odd.json/site.html", 1, "odd.json: cannot be written: a part of the path is a file"),
        ("share take --out site --view north", 1, "'north' is not a view"),
        ("serve take --certificate gone.pem", 1, "gone.pem: not a certificate with its private key (no such file"),
        ("models get isnet --package odd.json", 1, "odd.json: the package of the model isnet cannot be unpacked"),
        ("play take --frames 7:9", 2, "--frames 7:9: the stream has no such frames. It has frames 0 to 4"),
    ],
)
def test_mistakes_get_a_sentence_and_change_nothing(
    here: Here, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, code: int, sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("take", "capture", "ball.yaml"):
        (tmp_path / name).symlink_to(finished / name)
    (tmp_path / "odd.json").write_text('{"points": 3}')
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "notes.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    assert here(*words.split()).fails(sentence, code=code).stderr.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


FOLDERS = {
    "run": ("run", "ball.yaml", "--take"),
    "bake": ("bake", "ball.yaml", "--take"),
    "init": ("init", "capture", "--out"),
    "share": ("share", "take", "--out"),
    "compare": ("compare", "take", "--out"),
    **{name: (name,) for name in ("status", "check", "cancel", "estimate", "play", "serve", "sync")},
}


@pytest.mark.parametrize("folder", ["/proc/self/x", "x" * 300])
@pytest.mark.parametrize("command", FOLDERS)
def test_a_folder_that_cannot_be_made_or_read_is_one_sentence(
    here: Here, finished: Path, monkeypatch: pytest.MonkeyPatch, command: str, folder: str
) -> None:
    monkeypatch.chdir(finished)
    done = here(*FOLDERS[command], folder)
    assert done.returncode in (1, 2)
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1


def test_a_mistake_in_the_footage_is_one_sentence_and_one_event(here: Here, project: Path) -> None:
    (project / "capture" / "images" / "cam3" / "002.png").unlink()
    said = here("run", project / "ball.yaml", "--take", project / "take").fails("cam3").stderr
    assert (said[:7], said.count("\n")) == ("error: ", 1)
    events = here("run", project / "ball.yaml", "--take", project / "take", "--json").events
    assert events[-1].outcome == "failed"
    assert "cam3" in events[-1].message
    assert events[-1].code.startswith("footage.")
    assert all("Traceback" not in event.traceback for event in events if isinstance(event, StageFailed))


def test_verbose_says_on_standard_error_what_is_waited_for(here: Here, project: Path) -> None:
    options = ("run", project / "ball.yaml", "--take", project / "take", "--until", "initialize")
    loud = here(*options, "--verbose", "--json").ok()
    assert [event.kind for event in loud.events][-1] == "finished"
    lines = [re.sub(r"^[-0-9]+ [0-9:,]+ ", "", line) for line in loud.stderr.splitlines()]
    for name in ("pipelines.runs.runner: stage calibrate", "studio.meshing.surface: PyMeshLab"):
        told = [line for line in lines if line.startswith(f"v3studio.{name}")]
        assert len(told) >= 2, lines
        assert told[0].endswith(": begins")
    assert here("initialize", project / "take", "--force").ok().stderr == ""


def test_status_of_a_new_and_of_a_finished_take(here: Here, project: Path, finished: Path) -> None:
    here("calibrate", project / "ball.yaml", "--take", project / "take").ok()
    states = here("status", project / "take", "--json").result["stages"]
    assert [state["state"] for state in states.values()] == ["done"] + ["missing"] * (len(STAGE_NAMES) - 1)
    assert here("status", finished / "take").stdout.count("done") == len(STAGE_NAMES)
    here("status", finished / "take", "--check").ok()
    take = shutil.copytree(finished / "take", project / "copy")
    set_settings(take / "config.yaml", {"capture.root": str(project / "gone")})
    unchecked = here("status", take, "--check").fails()
    assert "the same" in unchecked.stdout, "a reason is said once"
    here("status", project / "capture").fails("not a take")


def test_status_answers_without_torch(finished: Path) -> None:
    status = f"from v3studio.pipelines.cli import execute; assert execute(['status', {str(finished / 'take')!r}]) == 0"
    command = [sys.executable, "-c", f"import sys; {status}; print('torch' in sys.modules)"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stdout.endswith("False\n"), done.stderr


def test_bake_to_a_target(here: Here, copied: Path) -> None:
    """Levels are kept and listed; files are never above the requested kilobytes; a new target replaces the one stored
    in the take."""
    take = copied / "take"

    def baked(*options: object) -> Sequence[Rendition]:
        here("bake", "--take", take, *options).ok()
        with StreamReader.open(take / "stream") as reader:
            return reader.groups

    high, low = (baked("--bake.quality", goal, "--keep", name) for goal, name in (("fine", "one"), ("30.5 dB", "two")))
    assert sum(group.bytes for group in low) < sum(group.bytes for group in high)
    listed = here("bake", "list", take, "--json").result["bakes"]
    for groups, promise, row in zip((high, low), (42, 30.5), listed, strict=True):
        assert row["qps"] == [group.qp for group in groups]
        assert row["psnr_to_trained"] == min(group.psnr_to_trained for group in groups) >= promise
    assert "30.5 dB (QP " in here("bake", "list", take).stdout
    target = high[0].bytes / high[0].frame_count / 1000 * 0.9
    small = baked("--bake.quality", f"{target:.3f} KB")
    for group in small:
        assert group.bytes <= 1000 * target * group.frame_count
    assert {group.video.qp for group in baked("--bake.quality", "40")} == {40}, "the target is replaced, too"
    assert "misses the target" in here("bake", "--take", take, "--bake.quality", "99 dB").stderr
    set_settings(take / "config.yaml", {"bake.quality": "98 dB"})  # as the window and --detach do, before the run
    assert "misses the target of 98" in here("bake", take).stderr
    assert "quality: 40" in (take / "config.yaml").read_text(), "a level that is out of reach is not stored"
    assert here("status", take, "--json").result["stages"]["bake"]["state"] == "done"
    stages = here("bake", take, "--json").result["stages"]
    assert list(stages) == list(STAGE_NAMES[:-1]), "nothing measured this bake yet"


def test_typos_are_answered_with_what_is_similar(here: Here) -> None:
    for words, meant in (
        (("statsu", "x"), "status"),
        (("edit", "trimm", "x", "0:3"), "trim"),
        (("bake", "x", "--kep", "fine"), "--keep"),
        (("bake", "lst", "x"), "list"),
        (("export", "x", "--out", "y", "--format", "plyy"), "ply"),
        (("run", "x", "--preset", "previw"), "preview"),
    ):
        here(*words).fails(f"did you mean {meant}?", code=2)
    assert "did you mean" not in here("zzzzzz").stderr
    here("check", "x", "--capture.masks", "y").fails(" --capture.masks=y", code=2)
    here("check", "x", "--set=capture.masks=y").fails(" --set=capture.masks=y", code=2)


def test_bash_completes_commands_options_and_choices(here: Here, tmp_path: Path) -> None:
    script = tmp_path / "v3studio.bash"
    script.write_text(here("completion", "bash").stdout)
    code = (
        f"source {script}; COMP_WORDS=(v3studio $1); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); "
        "$(complete -p v3studio | sed 's/.*-F \\([^ ]*\\).*/\\1/'); echo ${COMPREPLY[*]}"
    )
    typing = {"ru": "run", "run --pre": "--preset", "edit tri": "trim", "run x --preset st": "standard"}
    for typed, word in typing.items():
        done = subprocess.run(["bash", "-c", code, "bash", typed], capture_output=True, text=True, timeout=280)
        assert done.stdout.split() == [word], done.stderr
