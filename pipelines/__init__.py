"""Takes (the folders that runs fill), the stages, and the command line. Does not depend on the window."""
