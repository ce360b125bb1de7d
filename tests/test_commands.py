"""Commands in the Makefile, the README and the guides are current: their targets, scripts, options and settings exist.

Other tests run small versions: of `run` and its stages everywhere, examples (tests/v3studio), `gpu-check --dry-run`
(tests/benchmarks). `.ci/run` runs `lint`, `test`, `docs`, `fresh-test`, `sbom`, `tsan` and `wheel` themselves.
"""

import re
import runpy
import shlex
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PAGES = [
    *sorted((ROOT / "docs").rglob("*.md")),
    *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "SECURITY")),
]
OTHER_OPTIONS = {"--version", "--help", "--size", "--log-state", "--node-ip-address", "--gpus-per-node", "--partition"}
"""Options of `v3studio` itself, `v3studio-gui`, Ray, Slurm and benchmarks."""

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = re.findall(r"^([a-z-]+):.*?## ", MAKEFILE, re.MULTILINE)


def blocks() -> Iterator[tuple[str, str]]:
    """Page and command of each line in a shell block; lines that are continued are joined."""
    for page in PAGES:
        name = page.relative_to(ROOT).as_posix()
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for block in re.findall(r"^ *```(?:sh|bash|console)\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL):
            for line in block.splitlines():
                yield name, line.strip().removeprefix("$ ").removeprefix(".venv/bin/")


def test_commands_and_options_in_sentences_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands in code spans, also with placeholders, such as `v3studio check FOLDER`, or options alone."""
    monkeypatch.setenv("COLUMNS", "100")  # the generator sets it
    monkeypatch.syspath_prepend(ROOT / "docs")
    reference = runpy.run_path(str(ROOT / "docs" / "generate" / "commands.py"))["commands_page"]()
    sections = re.findall(r"^## (.*?) \{(.*?)(?=^## )", reference, re.MULTILINE | re.DOTALL)
    options = {name: set(re.findall(r"--[a-z][a-z-]*", text)) for name, text in sections}
    every = set().union(*options.values(), OTHER_OPTIONS)
    for page in PAGES:
        prose = re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for span in re.findall(r"`(v3studio [a-z][^`]*|--[a-z][^`]*)`", prose):
            words = span.split()
            known = every
            if words[0] == "v3studio":
                name = " ".join(words[1:3]) if " ".join(words[1:3]) in options else words[1]
                assert name in options, f"{page.name}: {span}"
                known = options[name]
            for word in words:
                option = word.partition("=")[0]
                if option.startswith("--") and "." not in option:
                    assert option in known, f"{page.name}: {span}"


def test_documented_targets_and_scripts_exist() -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for target in re.findall(r"(?:`|^|&& )make ([a-z][a-z-]*)", text, re.MULTILINE):
            assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), f"{page.name}: make {target}"
        for script in re.findall(r"(?:scripts|benchmarks|examples)/[\w/]+\.(?:py|sh)", text):
            assert (ROOT / script).is_file(), f"{page.name}: {script}"


@pytest.mark.parametrize("target", TARGETS)
def test_make_targets_name_what_exists(target: str) -> None:
    """A dry run; what it would start is there."""
    dry = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True)
    assert dry.returncode == 0, dry.stderr
    for script in re.findall(r"(?:scripts|benchmarks|web|tests)/[\w/]+\.(?:py|sh|mjs)", dry.stdout):
        assert (ROOT / script).is_file(), script


def test_documented_packages_are_those_that_the_program_uses() -> None:
    """Nothing is installed as an extra: V3 Studio is on no index, and reinstalling it replaces open3d-cpu."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(text for extra in extras.values() for text in extra)]
    known = {(found := Requirement(text)).name: found.specifier for text in wanted}
    others = {"onnxruntime-gpu", "sounddevice", "pre-commit"}  # instead of onnxruntime; optional; of developers
    seen = set()
    folders = ("studio", "pipelines", "gui", "benchmarks")
    for path in [*PAGES, *(path for folder in folders for path in (ROOT / folder).rglob("*.py"))]:
        for line in re.findall(r"pip install ([^`\n\"]+)", path.read_text(encoding="utf-8")):
            words = shlex.split(re.split(r"[).;]?(?: \(|, |\.$|\)| #|  )", line)[0].rstrip(".,"))
            for word in words:
                if word == "." or word.startswith(("-", "{", "http", "v3studio-", "dist/")):
                    continue
                found = Requirement(word)
                seen.add(found.name)
                assert found.name in {*known, *others}, f"{path.name}: {line}"
                for version in (one.version for one in found.specifier):
                    assert known[found.name].contains(version), f"{path.name}: {line}"
    assert seen >= {"s3fs", "gcsfs", "adlfs", "onnxruntime", "ray", "torch"}
