"""Commands of the documentation run, in the order of their page, on the tiny capture and its finished take.

Those that do not run here are given to the parser. Servers end at once; what reads the output of a command runs if jq
is installed.
"""

import gzip
import re
import shlex
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.hostile_streams import executed, plant
from tests.test_commands import ROOT, blocks
from v3studio.pipelines.cli import parse
from v3studio.pipelines.commands.common.arguments import overrides
from v3studio.pipelines.config import load_config
from v3studio.pipelines.config.presets import PRESETS
from v3studio.pipelines.events.cancellation import EXIT_CANCELLED
from v3studio.pipelines.share.player_files import read_player
from v3studio.studio.formats import EXPORTS
from v3studio.studio.masks.sources import SOURCES
from v3studio.studio.stream import StreamReader

NOT_HERE = {
    "a window": r"open ",
    "downloads": r"models get|.* --lpips",
    "an address": r".*(s3|gs|az)://",
    "a cluster": r".*run\.executor ray",
    "trains for long; has its own test": r"estimate |bake .*--ladder( |$)",
    "needs other footage; has its own test": r"sync |.*\.audio |.*--protocol hifi4g",
    "acts on a run in progress; has its own test": r".*--detach|cancel |queue (run|move|retry|stop)",
}
"""Why a command does not run, and the pattern of such commands."""

OTHERS = {
    "make and git: .ci/run in a fresh clone, or tests of targets": r"make |git clone|\. \.venv|python scripts/self_",
    "downloads": r"(python -m )?pip install|npm install|docker |pre-commit",
    "a window": "v3studio-gui ",
    "another machine": r"(ray|sbatch|ssh) ",
    "an account at a store, or its variables": r"aws |gcloud |az |export ",
    "runs until it is stopped": "tail -f ",
    "a program that may not be installed": "jq ",
    "a comment, or nothing": "#|$",
}
"""Why lines that do not begin with `v3studio` do not run, and the pattern of such lines."""

SHORTER = {
    "STREAM": "my-take",
    "/mnt/takes": "takes",
    "/srv/www": "www",
    "serve folder": "serve .",
    "12:251": "1:4",  # the take has five frames, in groups of three and two
    "0:20": "0:2",
    "--at 0.1 -0.1 1.4 --radius 0.15": "--at 0 0 0.5 --radius 0.3",
    "--camera cam00": "--camera cam0",
    "--size 640x360": "--size 96x72",
    "--format turntable": "--format turntable --size 64x48 --seconds 0.2",
    "my_masks:bright": "my_masks:bright --until initialize",
    "splats: 0.4, ": "splats: 0.4, finetune_iterations: 5, ",
    "finetune_iterations: 5, finetune_iterations: 3000": "finetune_iterations: 5",
}
"""Replacements in commands, so that they fit the tiny take."""

PAGES: dict[str, list[str]] = defaultdict(list)
for page, line in blocks():
    if found := re.match(r"(?:PYTHONPATH=\w+ )?v3studio (.*)", line):
        PAGES[page].append(found[1])


def assert_parses(command: str) -> None:
    """Its options exist, and its settings have valid names and values."""
    load_config(None, overrides(parse(shlex.split(re.split(r" [>|] | && ", command)[0], comments=True))))


@pytest.mark.parametrize("page", PAGES)
def test_commands_run_in_the_order_of_their_page(
    page: str, here: Callable, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = "\n".join(PAGES[page])
    for words, others in SHORTER.items():
        commands = commands.replace(words, others)
    settings = lay_out(tmp_path, finished, commands)
    told = tmp_path.with_suffix(".told")
    for folder in (tmp_path, *(path.parent for name in ("images", "take.json") for path in tmp_path.rglob(name))):
        plant(folder, told)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "masks")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for command in commands.splitlines():
        measures = "measurements" in page
        for name in () if measures else re.findall(r"(?<!--out )\b[\w/]+\.yaml", command):
            assert (tmp_path / name).exists(), f"{command}: nothing has written {name} yet"
        if measures or any(re.match(pattern, command) for pattern in NOT_HERE.values()):
            assert_parses(command)
            continue
        command, pipe, reader = command.partition(" | ")
        words = shlex.split(command.partition(" > ")[0], comments=True)
        if words[0] == "serve":
            done = here(*words, "--port", "0", "--end-with-stdin")
            assert done.returncode == EXIT_CANCELLED, f"{command}: {done.stderr}"
            continue
        done = here(*words)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        if pipe and shutil.which("jq"):
            read = subprocess.run(reader, shell=True, input=done.stdout, capture_output=True, text=True)
            assert (read.returncode, read.stderr) == (0, ""), reader
            assert "null" not in read.stdout, reader
        if words[0] == "init":
            (tmp_path / "my.yaml").write_text(settings)  # with fewer steps
    assert executed(told) == ""


def lay_out(folder: Path, finished: Path, commands: str) -> str:
    """Write what the commands name: takes, footage, settings (which are returned) and a source of masks."""
    for name in set(re.findall(r"my-take|demo-take|takes/\w+", commands)):
        shutil.copytree(finished / "take", folder / name)
    shutil.copytree(finished / "capture", folder / ("footage/first" if "footage/first" in commands else "footage"))
    settings = (finished / "ball.yaml").read_text().replace("root: capture", f"root: {finished / 'capture'}")
    for name in ("my.yaml", "morning.yaml", "sample_configs/demo.yaml"):
        if f"--out {name}" in commands:  # nothing may read it before it is written
            continue
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(settings)
    if "plys/" in commands:
        (folder / "plys").mkdir()
        shutil.copy(next((ROOT / "tests/data/splats").glob("degree0.compressed.ply")), folder / "plys")
    own = re.search(r"^```python\n(.*?)^```", (ROOT / "docs/guides/masks.md").read_text(), re.MULTILINE | re.DOTALL)
    (folder / "masks").mkdir()
    (folder / "masks" / "my_masks.py").write_text(own[1])
    return settings


def test_every_line_runs_or_has_a_reason() -> None:
    run = r"(PYTHONPATH=\w+ )?v3studio "
    assert [line for _, line in blocks() if not re.match("|".join((run, *OTHERS.values())), line)] == []


def test_the_guides_list_what_the_program_has() -> None:
    sources = [source.name for source in SOURCES]
    pages = {"masks": sources, "export-import": EXPORTS, "training": PRESETS}
    for page, names in pages.items():
        text = (ROOT / "docs" / "guides" / f"{page}.md").read_text(encoding="utf-8")
        assert [name for name in names if not re.search(rf"[`*]{name}[`*]", text)] == [], page


def test_the_gzipped_sizes_of_the_player_are_those_of_its_page() -> None:
    player = read_player()
    text = (ROOT / "docs/WEB.md").read_text(encoding="utf-8")
    told = [int(size) for size in re.findall(r"(\d+) KB\s+\(?gzipped", text)]
    sizes = [
        len(gzip.compress(file)) / 1000
        for file in (player.page.encode() + player.script, player.parts["v3-first.js"], player.review, player.cast)
    ]
    assert told == pytest.approx(sizes, abs=1)


def test_the_size_of_the_demo_is_that_of_its_stream() -> None:
    with StreamReader.open(ROOT / "docs/assets/sample.v3s") as reader:
        size, played, frames = reader.manifest.total_bytes, reader.played_bytes, reader.manifest.frame_count
        behind = reader.manifest.set_bytes
    for page in ("README.md", "docs/tutorial.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        assert re.findall(r"([\d,]+) bytes in total", text) == [f"{size:,}"]
        assert re.findall(r"(\d+) KB per frame", text) == [str(round(played / frames / 1000))]
        assert re.findall(r"(\d+) KB for the room", text) == [str(round(behind / 1000))]
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    assert set(re.findall(r"(\d+) KB", index)) == {str(round(size / 1000))}
