"""Importing the library does not change the environment of the process; entry points do."""

import os
import subprocess
import sys

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
