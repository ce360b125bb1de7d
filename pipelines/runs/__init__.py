"""Runs: which stages must run and why, running them, showing progress."""
