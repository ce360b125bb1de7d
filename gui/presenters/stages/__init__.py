"""One view per stage, and the list of stages."""
