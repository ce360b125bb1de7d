"""Writes a software bill of materials, in CycloneDX 1.6: what V3 Studio installs and what the browser player bundles.

    python scripts/sbom.py [--output build/v3studio.cdx.json]

It holds the Python packages of requirements.lock with the hashes of their files and their licenses, and the npm
packages of the player that are not tools. Made from the lock files and from what is installed, so it needs no network;
the same ones give the same bytes. NVIDIA's packages for PyTorch's CUDA build are not in the lock file, so not in here.
"""

from __future__ import annotations

import argparse
import base64
import importlib.util
import json
import sys
import tomllib
import uuid
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output import make_outputter
from cyclonedx.schema import OutputFormat, SchemaVersion
from packageurl import PackageURL

ROOT = Path(__file__).resolve().parent.parent


def locked() -> dict[str, list[str]]:
    """Package to version and pip's hash options, as `scripts/install.py` reads them."""
    spec = importlib.util.spec_from_file_location("install", ROOT / "scripts" / "install.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: dict[str, list[str]] = module.locked(ROOT / "requirements.lock")
    return found


def python_packages() -> Iterator[Component]:
    """Those of requirements.lock; a version has several files, so their hashes are properties, one per file."""
    for name, (version, *hashes) in sorted(locked().items()):
        url = PackageURL("pypi", None, name, version)
        files = [Property(name="v3studio:file:sha256", value=one.rpartition(":")[2]) for one in hashes]
        license_ = Property(name="v3studio:license", value=license_of(name))
        yield Component(
            name=name,
            version=version,
            type=ComponentType.LIBRARY,
            purl=url,
            bom_ref=str(url),
            properties=[license_, *files],
        )


def license_of(package: str) -> str:
    """What a package says of its license, in a line; "unknown" if it is not installed or says nothing."""
    for name in (package, f"{package}-cpu"):
        try:
            about = metadata(name)
        except PackageNotFoundError:
            continue
        classified = [
            text.rpartition(" :: ")[2] for text in about.get_all("Classifier") or () if text.startswith("License")
        ]
        said = about.get("License-Expression") or "; ".join(classified) or about.get("License") or ""
        return said.strip().split("\n")[0][:200] or "unknown"
    return "unknown"


def npm_packages() -> Iterator[Component]:
    """Those that the player contains."""
    lock = json.loads((ROOT / "web" / "package-lock.json").read_text(encoding="utf-8"))
    for place, about in sorted(lock["packages"].items()):
        if not place or about.get("dev") or about.get("peer"):
            continue
        name = place.rpartition("node_modules/")[2]
        namespace, _, base = name.rpartition("/")
        url = PackageURL("npm", namespace or None, base, about["version"])
        algorithm, _, value = about["integrity"].partition("-")
        assert algorithm == "sha512"
        digest = HashType(alg=HashAlgorithm.SHA_512, content=base64.b64decode(value).hex())
        yield Component(
            name=name,
            version=about["version"],
            type=ComponentType.LIBRARY,
            purl=url,
            bom_ref=str(url),
            hashes=[digest],
            properties=[Property(name="v3studio:license", value=about.get("license", "unknown"))],
        )


def bill() -> str:
    """The bill as JSON text."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    bom = Bom()
    root = Component(
        name=project["name"], version=project["version"], type=ComponentType.APPLICATION, bom_ref="v3studio"
    )
    bom.metadata.component = root
    parts = [*python_packages(), *npm_packages()]
    for part in parts:
        bom.components.add(part)
    bom.register_dependency(root, parts)
    # The same parts give the same text: no time of day, and a number made from the parts.
    bom.metadata.timestamp = datetime(1980, 1, 1, tzinfo=UTC)
    bom.serial_number = uuid.uuid5(uuid.NAMESPACE_URL, "\n".join(str(part.purl) for part in parts))
    text: str = make_outputter(bom, OutputFormat.JSON, SchemaVersion.V1_6).output_as_string(indent=1)
    return text + "\n"


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "v3studio.cdx.json")
    chosen = parser.parse_args()
    chosen.output.parent.mkdir(parents=True, exist_ok=True)
    chosen.output.write_text(bill(), encoding="utf-8")
    print(f"Bill of materials: {chosen.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
