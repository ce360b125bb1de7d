"""The self-test passes here, and reports what is missing."""

import shutil
from pathlib import Path

import pytest

from tests.support.warm_python import warm_python

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]


def test_it_passes_and_reports_a_missing_package_and_library(tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "self_test.py", tmp_path / "scripts")
    declared = (ROOT / "pyproject.toml").read_text(encoding="utf-8")

    script = tmp_path / "scripts" / "self_test.py"

    (tmp_path / "pyproject.toml").write_text(declared)
    passed = warm_python().run((script,), text=True)
    assert passed.returncode == 0, passed.stderr
    assert "checks passed" in passed.stdout

    wrong = declared.replace("dependencies = [", 'dependencies = [\n    "not-here>=1",\n    "broken>=1",', 1)
    (tmp_path / "pyproject.toml").write_text(wrong)
    (tmp_path / "broken.py").write_text(
        'raise ImportError("libnowhere.so.7: cannot open shared object file: No such file or directory")'
    )
    failed = warm_python().run((script,), text=True)
    assert failed.returncode == 1
    first, second = failed.stderr.splitlines()
    assert "not_here" in first
    assert "libnowhere.so.7" in second
    assert "docs/INSTALL.md" in second
