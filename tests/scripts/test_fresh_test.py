"""scripts/fresh_test.py: the settings that it copies, the output that it parses, and when it is skipped."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import ModuleType

import pytest


def test_pip_settings_certificates_and_folders_are_carried_over(fresh_test: ModuleType, tmp_path: Path) -> None:
    index, wheels, bundle = tmp_path / "index" / "simple", tmp_path / "wheels", tmp_path / "ca.pem"
    for folder in (index, wheels):
        folder.mkdir(parents=True)
    bundle.write_text("certificate")
    config = (
        f"global.extra-index-url='{index.as_uri()} https://example.org/simple'\n"
        f"global.cert='{bundle}'\n"
        "install.target='/somewhere'\n"
        ":env:.find-links='shown twice: here and in the environment'\n"
    )
    environment = {
        "PIP_FIND_LINKS": str(wheels),
        "PIP_CACHE_DIR": "/cache",
        "https_proxy": "http://proxy:3128",
        "SSL_CERT_FILE": str(bundle),
        "NODE_EXTRA_CA_CERTS": str(bundle),
        "SECRET": "x",
    }
    carried = fresh_test.carry(config, environment)
    assert carried.folders == (str(index.parent), str(wheels))  # the pages of an index link to files next to it
    [(inside, outside)] = carried.certificates.items()
    assert outside == str(bundle)
    assert carried.pip_conf == (
        f"[global]\nextra-index-url = {index.as_uri()} https://example.org/simple\ncert = {inside}\n"
    )
    assert carried.environment == {
        "PIP_FIND_LINKS": str(wheels),
        "https_proxy": "http://proxy:3128",
        "SSL_CERT_FILE": inside,
        "NODE_EXTRA_CA_CERTS": inside,
    }


def test_nothing_is_carried_over_where_nothing_is_set(fresh_test: ModuleType) -> None:
    carried = fresh_test.carry("", {"PATH": "/bin"})
    assert carried == fresh_test.Carried({}, "", (), {})


def test_settings_of_several_lines_stay_readable_for_pip(fresh_test: ModuleType) -> None:
    import configparser

    carried = fresh_test.carry(r"global.find-links='https://a.org/\nhttps://b.org/'", {})
    parser = configparser.RawConfigParser()
    parser.read_string(carried.pip_conf)
    assert parser.get("global", "find-links").split() == ["https://a.org/", "https://b.org/"]


def test_apts_settings_for_downloads_are_carried_over(fresh_test: ModuleType) -> None:
    dump = (
        'Acquire "";\nAcquire::http::Proxy "http://proxy:3142/";\nAcquire::http::Proxy-Auto-Detect "/usr/bin/find";\n'
        'Acquire::Languages "none";\nAcquire::Check-Valid-Until "false";\n'
    )
    assert fresh_test.apt_downloads(dump) == (
        'Acquire::http::Proxy "http://proxy:3142/";\nAcquire::Check-Valid-Until "false";\n'
    )


def test_archives_are_those_of_debian(fresh_test: ModuleType) -> None:
    targets = (
        "https://example.org/other|Example|Example\nhttp://mirror/debian/|Debian|Debian\n"
        "http://mirror/security/|Debian|Debian-Security\n"
    )
    assert fresh_test.archives(targets) == ("http://mirror/debian/", "http://mirror/security/")
    assert fresh_test.archives("https://example.org/other|Example|Example\n") == (None, None)
    assert fresh_test.archives("") == (None, None)


@pytest.mark.parametrize(
    ("line", "command"),
    [
        ("Install them with: sudo apt-get install g++ libgl1", "apt-get install g++ libgl1"),
        ("    sudo apt-get update && sudo apt-get install -y g++", "apt-get update && apt-get install -y g++"),
        (
            "  su -c 'apt-get update && apt-get install -y g++'",
            "su -c 'apt-get update && apt-get install -y g++'",
        ),
        ("Run `sudo env A=b apt-get install g++`.", "env A=b apt-get install g++"),
    ],
)
def test_the_command_to_paste_is_found(fresh_test: ModuleType, line: str, command: str) -> None:
    output = f"Packages are missing.\n{line}\nmake: *** [Makefile:40: system] Error 1\n"
    assert fresh_test.as_root(fresh_test.pasted_command(output)) == command


def test_one_command_it_has_to_be(fresh_test: ModuleType) -> None:
    with pytest.raises(fresh_test.Failed, match="printed 0 commands"):
        fresh_test.pasted_command("apt-get could not install g++: no network\nmake: *** Error 1\n")
    with pytest.raises(fresh_test.Failed, match="printed 2 commands"):
        fresh_test.pasted_command("sudo apt-get install a\nsudo apt-get install b\n")


def test_a_tree_with_a_mount_in_it_is_not_deleted(fresh_test: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    def deletes(*args: object, **options: object) -> None:
        raise AssertionError(f"would have run {args}")

    monkeypatch.setattr(fresh_test.subprocess, "run", deletes)
    with pytest.raises(RuntimeError, match="/proc is mounted"):
        fresh_test.remove_tree(Path("/proc"))


@pytest.mark.parametrize(("ci", "status", "word"), [("", 0, "SKIPPED"), ("true", 1, "CANNOT RUN")])
def test_not_being_able_to_run_is_said_and_fails_in_ci(
    fresh_test: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    ci: str,
    status: int,
    word: str,
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setenv("CI", ci)
    monkeypatch.setattr(sys, "argv", ["fresh_test.py"])
    assert fresh_test.main() == status
    output = capsys.readouterr()
    assert f"{word}" in output.out + output.err
    assert "it needs root" in output.out + output.err
