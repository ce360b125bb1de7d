"""A take's folder: where results lie, how they are written, records, groups, marks."""
