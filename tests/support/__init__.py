"""Helpers shared by several test files."""

from tests.support import mutant

mutant.install()
