"""What `make lint` says of pip-audit's report."""

from typing import Any

from scripts import audit

SOUND: dict[str, Any] = {"name": "sound", "version": "1.0", "vulns": []}
HURT: dict[str, Any] = {"name": "hurt", "version": "2.0", "vulns": [{"id": "PYSEC-1", "fix_versions": ["2.1"]}]}
UNKNOWN = {"name": "unknown", "skip_reason": "Dependency not found on PyPI"}


def test_a_vulnerability_fails() -> None:
    status, words = audit.verdict({"dependencies": [SOUND, HURT, UNKNOWN]}, "")
    assert status == 1
    assert words.splitlines() == ["Known vulnerabilities:", "hurt 2.0: PYSEC-1, fixed in 2.1"]


def test_none_passes_and_says_how_many_were_looked_up() -> None:
    status, words = audit.verdict({"dependencies": [SOUND, UNKNOWN]}, "")
    assert (status, words) == (0, "Audit: no known vulnerabilities in 1 packages; 1 are unknown to it.")


def test_without_an_answer_it_is_skipped_with_a_word() -> None:
    offline = (None, "Traceback\nrequests.ConnectionError: no route")
    for report, messages in (offline, ({"dependencies": [UNKNOWN]}, "")):
        status, words = audit.verdict(report, messages)
        assert status == 0
        assert words.startswith("Audit skipped: ")
    assert "no route" in audit.verdict(None, "x\nConnectionError: no route")[1]
