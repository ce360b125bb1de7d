"""Looks up known vulnerabilities of the pinned Python packages with pip-audit, for `make lint`.

Without a network, or where the index does not tell of vulnerabilities, it says that it was skipped, and exits with 0:
an audit that did not happen must not stop somebody's work on a train. A vulnerability that was found exits with 1.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
LOCKS = ("requirements.lock", "requirements-dev.lock", "requirements-docs.lock")


def verdict(report: dict[str, Any] | None, messages: str) -> tuple[int, str]:
    """Exit status and words for what pip-audit wrote; None: it wrote no report."""
    if report is None:
        last = messages.strip().splitlines()[-1:] or ["no message"]
        return 0, f"Audit skipped: pip-audit could not ask ({last[0][:200]})."
    packages = report["dependencies"]
    skipped = [one["name"] for one in packages if "skip_reason" in one]
    if len(skipped) == len(packages):
        return 0, "Audit skipped: the package index has no data on vulnerabilities, or cannot be reached."
    lines = [
        f"{one['name']} {one['version']}: {found['id']}, fixed in {', '.join(found['fix_versions']) or 'none yet'}"
        for one in packages
        for found in one.get("vulns", ())
    ]
    if lines:
        return 1, "\n".join(["Known vulnerabilities:", *lines])
    not_known = f"; {len(skipped)} are unknown to it" if skipped else ""
    return 0, f"Audit: no known vulnerabilities in {len(packages) - len(skipped)} packages{not_known}."


def main() -> int:
    files = [word for lock in LOCKS for word in ("--requirement", str(ROOT / lock))]
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip_audit", "--no-deps", "--disable-pip", "--progress-spinner", "off"]
        options = ["--timeout", "10", "--format", "json", "--output", str(output)]
        ended = subprocess.run([*command, *options, *files], capture_output=True, text=True)
        try:
            report = json.loads(output.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            report = None
    status, words = verdict(report, ended.stderr)
    print(words)
    return status


if __name__ == "__main__":
    sys.exit(main())
