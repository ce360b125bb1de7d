"""Helpers for all files of a take: JSON, digests, locks, settings, errors of the disk."""
