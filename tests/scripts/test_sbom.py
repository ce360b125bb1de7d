"""The bill of materials: valid CycloneDX, and everything that is locked is in it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from cyclonedx.schema import SchemaVersion

from tests.scripts.test_install import ROOT, installer, load


@pytest.fixture(scope="module")
def bill(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bill, as a file."""
    file = tmp_path_factory.mktemp("sbom") / "deep" / "bill.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["sbom.py", "--output", str(file)])
        assert load(ROOT / "scripts" / "sbom.py").main() == 0
    return file


def test_every_locked_package_is_in_the_bill_with_its_hashes(bill: Path) -> None:
    found = {part["purl"]: part for part in json.loads(bill.read_text())["components"]}
    for name, (version, *hashes) in installer.locked(ROOT / "requirements.lock").items():
        notes = found[f"pkg:pypi/{name}@{version}"]["properties"]
        listed = {note["value"] for note in notes if note["name"] == "v3studio:file:sha256"}
        assert listed == {one.rpartition(":")[2] for one in hashes}
    player = [purl for purl in found if purl.startswith("pkg:npm/")]
    assert any(purl.startswith("pkg:npm/mediabunny@") for purl in player)
    assert not any("eslint" in purl for purl in player), "a tool"
    licenses = {note["value"] for note in found["pkg:npm/mediabunny@" + player_version()]["properties"]}
    assert licenses == {"MPL-2.0"}


def player_version() -> str:
    package = json.loads((ROOT / "web" / "package.json").read_text())
    return str(package["dependencies"]["mediabunny"])


def test_the_same_locks_give_the_same_bytes(bill: Path) -> None:
    assert load(ROOT / "scripts" / "sbom.py").bill() == bill.read_text()
    assert json.loads(bill.read_text())["specVersion"] == SchemaVersion.V1_6.to_version()
