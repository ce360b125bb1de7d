"""Commands of the documentation run, in the order of their page, on the tiny capture and its finished take.

`tests/test_commands.py` gives all of them to the parser, also those that do not run here.
"""

from __future__ import annotations

import re
import shlex
import shutil
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pytest

from studio.stream import StreamReader
from tests.test_commands import ROOT, blocks

NOT_HERE = {
    "a window": r"open ",
    "runs until it is stopped": "serve ",
    "downloads": r"models get|.* --lpips",
    "an address": r".*(s3|gs|az)://",
    "a cluster": r".*run\.executor ray",
    "trains for long; has its own test": r"ablate |estimate |bake .*(ladder|splats)",
    "needs other footage; has its own test": r"sync |colors |.*\.audio |.*--protocol hifi4g",
    "acts on a run in progress; has its own test": r".*--detach|cancel |queue (run|move|retry|stop)",
}
"""Why a command does not run, and the pattern of such commands."""

SHORTER = {
    "STREAM": "my-take",
    "/mnt/takes": "takes",
    "/srv/www": "www",
    "--out my.yaml": "--out init.yaml",  # my.yaml has fewer steps
    "12:251": "1:4",  # the take has five frames, in groups of three and two
    "0:20": "0:2",
    "--at 0.1 -0.1 1.4 --radius 0.15": "--at 0 0 0.5 --radius 0.3",
    "--group 17": "--group 1",
    "--camera cam00": "--camera cam0",
    "--size 640x360": "--size 96x72",
    "--format turntable": "--format turntable --size 64x48 --seconds 0.2",
    "my_masks:bright": "my_masks:bright --until initialize",
}
"""What is replaced in commands, so that they fit the tiny take."""

PAGES: dict[str, list[str]] = defaultdict(list)
for page, line in blocks():
    if found := re.match(r"(?:PYTHONPATH=\w+ )?v3studio (.*)", line):
        PAGES[page].append(found[1])


@pytest.mark.parametrize("page", [page for page in PAGES if "measurements" not in page])
def test_commands_run_in_the_order_of_their_page(
    page: str, here: Callable, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = "\n".join(PAGES[page])
    for words, others in SHORTER.items():
        commands = commands.replace(words, others)
    lay_out(tmp_path, finished, commands)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "masks")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for command in commands.splitlines():
        if any(re.match(pattern, command) for pattern in NOT_HERE.values()):
            continue
        words = shlex.split(re.split(r" [>|] ", command)[0], comments=True)
        done = here(*words)
        assert done.returncode == 0, f"{command}: {done.stderr}"


def lay_out(folder: Path, finished: Path, commands: str) -> None:
    """What the commands name: takes, footage, settings and a source of masks."""
    for name in set(re.findall(r"my-take|demo-take|takes/\w+", commands)):
        shutil.copytree(finished / "take", folder / name)
    shutil.copytree(finished / "capture", folder / ("footage/first" if "footage/first" in commands else "footage"))
    settings = (finished / "ball.yaml").read_text().replace("root: capture", f"root: {finished / 'capture'}")
    for name in ("my.yaml", "morning.yaml", "sample_configs/demo.yaml"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(settings)
    if "plys/" in commands:
        (folder / "plys").mkdir()
        shutil.copy(next((ROOT / "tests/data/splats").glob("degree0.compressed.ply")), folder / "plys")
    own = re.search(r"^```python\n(.*?)^```", (ROOT / "docs/guides/masks.md").read_text(), re.MULTILINE | re.DOTALL)
    assert own is not None
    (folder / "masks").mkdir()
    (folder / "masks" / "my_masks.py").write_text(own[1])


def test_the_size_of_the_demo_is_that_of_its_stream() -> None:
    with StreamReader.open(ROOT / "docs/assets/sample.v3s") as reader:
        size, frames = reader.manifest.total_bytes, reader.manifest.frame_count
    for page in ("README.md", "docs/tutorial.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        assert re.findall(r"([\d,]+) bytes in total", text) == [f"{size:,}"]
        assert re.findall(r"(\d+) kB per frame", text) == [str(round(size / frames / 1000))]
    assert set(re.findall(r"(\d+) kB", (ROOT / "docs/index.md").read_text(encoding="utf-8"))) == {
        str(round(size / 1000))
    }
