"""Importing the library does not change the environment of the process; entry points do."""

import os
import platform
import subprocess
import sys

import pytest

BARE = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}


def run(code: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**BARE, **environment}, check=True
    )
    return done.stdout.strip()


def test_importing_changes_nothing() -> None:
    code = (
        "import os; before = dict(os.environ)\n"
        "import studio, studio.capture, studio.stream, pipelines.cli, pipelines.events\n"
        "print(before == dict(os.environ))"
    )
    assert run(code) == "True"


def test_the_command_line_sets_it_but_not_over_the_users() -> None:
    code = (
        "import os, sys\nfrom pipelines import cli\nsys.argv = ['v3studio', '--version']\n"
        "try:\n    cli.main()\nexcept SystemExit:\n    pass\n"
        "print(os.environ['OMP_WAIT_POLICY'], file=sys.stderr)"
    )
    for environment, expected in (({}, "passive"), ({"OMP_WAIT_POLICY": "active"}, "active")):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, env={**BARE, **environment}, check=True
        )
        assert done.stderr.strip() == expected


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc has these parameters")
def test_kept_memory_costs_no_page_faults() -> None:
    code = (
        "import resource\nimport numpy as np\nfrom studio.environment import keep_freed_memory\n"
        "keep_freed_memory()\n"
        "def faults():\n"
        "    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
        "    for _ in range(20):\n        arrays = [np.ones(2**19, np.float32) for _ in range(4)]; del arrays\n"
        "    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before\n"
        "faults(); print(faults())"
    )
    pages = 20 * 4 * 2**21 // 4096
    bare = {"PYTHONMALLOC": "default"}
    assert int(run(code, **bare)) < pages / 20
    assert int(run(code, **bare, MALLOC_TRIM_THRESHOLD_="131072")) > pages / 2  # the user's choice is kept
