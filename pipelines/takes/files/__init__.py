"""What all files of a take have in common: JSON, digests, locks, settings, errors of the disk."""
