"""Takes: the folder that a run fills, its stages, and the command line that runs them. Knows no window."""
