"""The examples of clusters: their commands have options that Ray knows, and what they name is there."""

import json
import re
import shlex
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest

from v3studio.studio.yaml_text import parse_yaml

EXAMPLES = Path(__file__).parents[4] / "sample_configs" / "cluster"


@pytest.fixture(scope="module")
def ray() -> Path:
    """The package's folder: importing its command line would take seconds."""
    spec = find_spec("ray")
    if spec is None or spec.origin is None:
        pytest.skip("Ray is not installed (extra cluster)")
    return Path(spec.origin).parent


def unknown(command: str, ray: Path) -> list[str]:
    """Options of a `ray start` or `ray stop` command that Ray does not have."""
    words = [word for word in shlex.split(command) if not re.fullmatch(r"[A-Z_]+=.*", word)]
    assert Path(words[0]).name == "ray"
    source = (ray / "scripts" / "scripts.py").read_text(encoding="utf-8")
    body = re.search(rf"(?s)\n@cli\.command\([^)]*\)\n(?:(?!@cli\.command).)*?\ndef {words[1]}\(", source)
    assert body is not None, words[1]
    options = set(re.findall(r"\"(--[a-z-]+)", body[0]))
    return [word for word in words[2:] if word.partition("=")[0] not in options]


def test_compose(ray: Path) -> None:
    compose = parse_yaml((EXAMPLES / "compose.yaml").read_text(encoding="utf-8"))
    assert {"head", "worker", "gpu-worker"} == compose["services"].keys()
    assert unknown("ray start --head --no-such-option=1", ray) == ["--no-such-option=1"]
    for service in compose["services"].values():
        assert unknown(service["command"], ray) == []
        assert "--block" in service["command"], "or the container would end at once"
        assert set(service["networks"]) <= compose["networks"].keys()
        assert set(service["secrets"]) <= compose["secrets"].keys()
        assert set(service.get("depends_on", ())) <= compose["services"].keys()
        assert service["environment"]["RAY_AUTH_MODE"] == "token"
        assert service["environment"]["RAY_AUTH_TOKEN_PATH"] == f"/run/secrets/{service['secrets'][0]}"
        assert "ports" not in service


def test_ray_up(ray: Path) -> None:
    config = parse_yaml((EXAMPLES / "ray-up.yaml").read_text(encoding="utf-8"))
    schema = json.loads((ray / "autoscaler" / "ray-schema.json").read_text(encoding="utf-8"))
    assert set(schema["required"]) <= config.keys() <= schema["properties"].keys()
    for command in (*config["head_start_ray_commands"], *config["worker_start_ray_commands"]):
        assert unknown(command, ray) == []


def test_slurm(ray: Path) -> None:
    script = (EXAMPLES / "slurm.sh").read_text(encoding="utf-8")
    subprocess.run(["bash", "-n", EXAMPLES / "slurm.sh"], check=True)
    commands = re.findall(r"^ *(ray start .*?)(?: &)?$", script, re.MULTILINE)
    assert [unknown(command, ray) for command in commands] == [[], []]
    assert "--block" in commands[1], "or the step would end at once, and the node with it"
