import json
import shlex
import signal
import subprocess

import pytest

from tests.support.events import events_in, frames_in, stop_when, trains_a_frame
from tests.support.tiny_capture import results, v3studio
from v3studio.pipelines.events import StageFinished, StageStarted
from v3studio.pipelines.stages import CHAIN

pytestmark = pytest.mark.long


def test_groups_done_in_any_process_give_the_take_of_a_local_run(finished, project, start, here):
    take = project / "take"
    here("calibrate", project / "ball.yaml", "--take", take).ok()
    missing = here("work", take, "--stage", "train", "--group", "1")
    missing.fails("group 1 has no results of the stage initialize")

    # two workers with the same group, and a third that is killed after the first frame of another one
    same = [start("work", take, "--group", "0", "--json") for _ in range(2)]
    killed = start("work", take, "--group", "1", "--json")
    stop_when(killed, trains_a_frame)
    assert killed.returncode == -signal.SIGKILL
    outputs = [process.communicate() for process in same]
    assert [process.returncode for process in same] == [0, 0], outputs
    trained = frames_in(events_in("".join(out for out, _ in outputs)))
    assert sorted(trained) == [0, 1, 2], "each frame is trained once"
    again = here("work", take, "--group", "1", "--json").ok()
    assert frames_in(again.events) == [3], "the frame that was finished before the kill is kept"

    up_to_date = here("work", take, "--group", "1", "--json")
    assert [e.summary["done"] for e in up_to_date.events if isinstance(e, StageFinished)] == ["before"] * len(CHAIN)
    assert here("work", take, "--print-commands").stdout == ""

    here("run", take, "--until", "bake").ok()
    for group in (0, 1):
        here("work", take, "--stage", "evaluate", "--group", group).ok()
    events = v3studio("run", take, "--json").ok().events
    assert [event.stage for event in events if isinstance(event, StageStarted)] == ["evaluate"]
    assert frames_in(events, "train", "evaluate") == []
    assert results(take) == results(finished / "take")
    assert not list(take.rglob("*.partial*"))
    assert not (take / ".v3studio" / "work" / "evaluate").exists()
    assert here("work", take, "--stage", "evaluate", "--print-commands").stdout == ""


def test_commands_are_printed_for_each_kind_of_queue(project, here, tmp_path):
    take = project / "a take"
    here("calibrate", project / "ball.yaml", "--take", take).ok()
    plain = here("work", take, "--print-commands").stdout.splitlines()
    assert [shlex.split(line)[:3] for line in plain] == [["v3studio", "work", str(take)]] * 2
    assert [line.endswith(f" --group {group}") for group, line in enumerate(plain)] == [True, True]
    assert "--run.threads 1" in plain[0]
    lines = here("work", take, "--print-commands", "--format", "deadline").stdout.splitlines()
    assert lines == [line.replace(f"'{take}'", f'"{take}"') for line in plain], "Deadline knows no single quotes"
    here("work", take, "--print-commands", "--format", "deadline", "--set", "capture.held_out=['cam\\1']").fails()
    batch = here("work", take, "--stage", "train", "--print-commands", "--format", "sbatch").stdout
    assert "#SBATCH --array=0-1\n" in batch
    assert "#SBATCH --cpus-per-task=1\n" in batch
    assert "#SBATCH --requeue\n" in batch

    # what the shell makes of the last line
    shown = tmp_path / "v3studio"
    shown.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    shown.chmod(0o755)
    script = batch.replace("exec v3studio", f"exec {shlex.quote(str(shown))}")
    words = subprocess.run(
        ["bash", "-c", script], env={"SLURM_ARRAY_TASK_ID": "1"}, capture_output=True, text=True, check=True
    ).stdout.split("\n")
    assert words[:4] == ["work", str(take), "--stage", "train"]
    assert words[-3:-1] == ["--group", "1"]


def test_printed_commands_name_the_settings(project, here, monkeypatch):
    take = project / "100% take"
    here("calibrate", project / "ball.yaml", "--take", take).ok()
    monkeypatch.chdir(project)
    given = ("--train.max-splats", "5000", "--set", "capture.root=capture", "--run.threads", "3")
    plain = here("work", take, "--print-commands", *given).stdout.splitlines()
    words = shlex.split(plain[0])
    assert "--set=train.max-splats=5000" in words
    assert f"--set=capture.root={project / 'capture'}" in words
    assert " ".join(words).count("run.threads") == 1

    # 2 groups of which 2 run at once, of 4 threads; then of 3 groups the last has all 4
    batch = ("work", take, "--print-commands", "--format", "sbatch", "--run.threads", "4", "--run.groups-at-once", "2")
    two = here(*batch).stdout
    assert "#SBATCH --cpus-per-task=2\n" in two
    assert "/100%% take/.v3studio/slurm_%a.log" in two
    three = here(*batch, "--train.group_size", "2").stdout
    assert "#SBATCH --array=0-2\n" in three
    assert "#SBATCH --cpus-per-task=4\n" in three


def test_what_cannot_be_done_is_refused(project, here):
    take = project / "take"
    here("run", project / "ball.yaml", "--take", take, "--until", "calibrate").ok()
    for arguments, expected in {
        ("--group", "2"): "there is no group 2: the take has 2 groups, numbered from 0. Choose 0 to 1.",
        (): "specify either --group or --print-commands",
        ("--stage", "evaluate", "--group", "0"): "the stage evaluate needs train, which is missing",
    }.items():
        here("work", take, *arguments).fails(expected, code=1 if arguments else 2)
    (take / "calibrate" / "rig.json").unlink()
    done = here("work", take, "--group", "0", "--json").fails()
    assert json.loads(done.stdout.splitlines()[-1])["code"] == "stage.dependency"
