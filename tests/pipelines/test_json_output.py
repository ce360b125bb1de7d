"""Standard output with --json is only JSON, whatever libraries print in between, at exit or in child processes."""

import argparse
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.tiny_capture import ROOT, Here
from tests.support.warm_python import warm_python
from v3studio.pipelines.cli import make_parser
from v3studio.pipelines.events import Log, Progress, StageFinished, read_line

NOISE = """
import argparse, atexit, ctypes, os, subprocess, sys
from v3studio.pipelines import cli

def noise():
    os.write(1, b"Warning: no newline, and a byte that is not UTF-8 \\xff")
    ctypes.CDLL(None).puts(b"C library: buffered until exit")
    subprocess.run(["echo", "child process"], check=True)
    print("Python library")

atexit.register(lambda: print("Python library at exit"))
"""

NOISY_STAGE = """
from v3studio.pipelines.stages import stage_named
stage = stage_named("bake").code
quiet = stage.run

def run(inputs, reporter, executor):
    noise()
    summary = quiet(inputs, reporter, executor)
    noise()
    return summary

stage.run = run
"""

NOISY_COMMAND = """
read = argparse.ArgumentParser.parse_known_args

def parse(self, *given):
    known, unknown = read(self, *given)
    if hasattr(known, "command"):
        quiet = known.command
        known.command = lambda arguments: (noise(), quiet(arguments), noise())[1]
    return known, unknown

argparse.ArgumentParser.parse_known_args = parse
"""
WORDS = ("Warning: no newline", "C library: buffered", "child process", "Python library\n", "Python library at exit")


def program(code: str) -> str:
    """The command line with libraries that print."""
    return f"{NOISE}{code}\nsys.exit(cli.main())"


def test_a_run_whose_stage_prints_gives_events_only(copied: Path) -> None:
    # a new process: the libraries are loaded after the command has claimed standard output
    command = [sys.executable, "-c", program(NOISY_STAGE), "bake", copied / "take", "--force", "--json"]
    done = subprocess.run(command, capture_output=True, cwd=ROOT, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    events, texts = zip(*map(read_line, done.stdout.decode().splitlines()), strict=True)
    assert not any(texts)
    assert any(isinstance(event, StageFinished) for event in events)
    assert events[-1].result["stages"]["bake"]["bytes_per_frame"] > 0
    assert events[-1].result["stages"]["evaluate"]["psnr_decoded"] > 10
    for words in WORDS:
        assert words in done.stderr.decode("utf-8", "replace"), "shown, not lost"


COMMANDS = {
    "status": ("status", "{take}", "--json"),
    "compare": ("compare", "{take}", "--out", "{out}", "--json"),
    "check": ("check", "{take}", "--json"),
    "bake list": ("bake", "list", "{take}", "--json"),
    "bake keep": ("bake", "keep", "{take}", "kept", "--json"),
    "play": ("play", "{take}", "--json"),
    "export": ("export", "{take}", "--format", "ply", "--of", "trained", "--out", "{out}", "--json"),
    "import": ("import", "{frame}", "--out", "{out}", "--json"),
    "publish": ("publish", "{take}", "{out}", "--json"),
    "share": ("share", "{take}", "--out", "{out}", "--json"),
    "sync": ("sync", "{long}", "--method", "motion", "--json"),
}
WRITTEN = {"bake keep": "{take}/bakes/kept"}
WRITTEN |= dict.fromkeys(("compare", "export", "import", "publish", "share"), "{out}")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_with_json_prints_json_only(
    name: str, copied: Path, tmp_path: Path, long_footage: Path, here: Callable
) -> None:
    take, frame = copied / "take", tmp_path / "frame.ply"
    if name == "import":
        here("export", take, "--format", "ply", "--of", "trained", "--frames", "0:1", "--out", frame).ok()
    places = {"take": take, "out": tmp_path / "out", "frame": frame, "long": long_footage}
    words = (word.format(**places) for word in COMMANDS[name])
    done = warm_python().run(("-c", program(NOISY_COMMAND), *words), cwd=ROOT)
    assert done.returncode == 0, done.stderr
    (*events, last), texts = zip(*map(read_line, done.stdout.decode().splitlines()), strict=True)
    assert not any(texts)
    assert all(isinstance(event, Progress | Log) for event in events)
    assert last.outcome == "done"
    assert last.result
    assert last.result.get("path") == (WRITTEN[name].format(**places) if name in WRITTEN else None)
    for printed in WORDS:
        assert printed in done.stderr.decode("utf-8", "replace")


SHORT = """
bake keep take fine
bake remove take fine
edit trim take 1:4
edit undo take
edit redo take
edit list take
edit count take
edit remove take trim
init capture --out new.yaml
board board.pdf
config bake --changed --bake.quality 30
completion bash
models
queue add take --queue queue.json
queue move 1 1 --queue queue.json
queue list --queue queue.json
queue remove 1 --queue queue.json
"""


def test_short_commands_have_a_result(copied: Path, here: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(copied)
    results = {}
    for line in SHORT.strip().splitlines():
        done = here(*line.split(), "--json").ok()
        assert (done.stdout.count("\n"), done.stderr) == (1, ""), line
        results[line] = done.result
        assert results[line], line
    assert results["edit undo take"]["trim"] is None
    assert results["edit redo take"]["trim"] == {"first": 1, "last": 3}
    assert results["bake keep take fine"]["bakes"][0]["is_stream"]
    assert results["bake remove take fine"]["bakes"] == []
    assert results["config bake --changed --bake.quality 30"] == {"settings": {"bake": {"quality": 30}}}
    assert results["board board.pdf"]["path"] == str(Path("board.pdf").absolute())


def test_every_command_but_the_window_takes_json() -> None:
    def names(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, bool]]:
        kinds = [kinds.choices for kinds in parser._actions if isinstance(kinds, argparse._SubParsersAction)]
        for kind, child in (kinds[0] if kinds else {}).items():
            yield from names(f"{name} {kind}", child)
        if not kinds:
            yield name, "--json" in parser.format_help()

    named = dict(pair for name, parser in make_parser()[1].items() for pair in names(name, parser))
    assert [name for name, known in named.items() if not known] == ["open"]


def test_a_reader_that_leaves_early_is_no_error() -> None:
    command = [sys.executable, "-m", "v3studio.pipelines.cli", "config"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT)
    process.stdout.close()
    assert process.stderr.read() == b""
    assert process.wait(60) == 1
    process.stderr.close()


FAILURES = {
    "no such take": (("status", "none", "--json"), 1, "take.not_found"),
    "no such stream": (("export", "none", "--format", "ply", "--out", "x", "--json"), 1, "stream.not_found"),
    "a bad value": (("export", "none", "--format", "ply", "--out", "x", "--size", "1", "--json"), 2, "command."),
    "a bad setting": (("run", "none", "--take", "x", "--bake.quality", "99", "--json"), 1, "settings."),
    "an unknown option": (("play", "none", "--jsn", "--json"), 2, "command.usage"),
    "no run to cancel": (("cancel", "none", "--json"), 1, "take.not_found"),
    "no edits to undo": (("edit", "undo", "none", "--json"), 1, "take.not_found"),
    "no such entry": (("queue", "retry", "9", "--queue", "q.json", "--json"), 1, "queue."),
    "not a PDF": (("board", "x.png", "--json"), 2, "command.invalid_option"),
    "no footage to init": (("init", "none", "--json"), 2, "command.not_footage"),
    "no value": (("run", "none", "--take", "x", "--bake.quality", "--json"), 2, "command.usage"),
    "an unknown command": (("plya", "none", "--json"), 2, "command.usage"),
}


@pytest.mark.parametrize("name", FAILURES)
def test_a_failure_ends_with_its_result(name: str, here: Here, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where a lock of the queue is left
    words, code, error = FAILURES[name]
    (line,) = here(*words).fails(code=code).stdout.splitlines()
    event, _ = read_line(line)
    assert (event.outcome, event.result) == ("failed", {})
    assert event.code.startswith(error)
    assert event.message
