"""Groups as tasks of a Ray cluster."""
