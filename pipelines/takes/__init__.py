"""A take's folder: where results are, how they are written, records, groups, marks."""
