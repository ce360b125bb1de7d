"""What `v3studio work` offers. Imports nothing, so that the command line can list it at once."""

GROUP_STAGE_NAMES = ("initialize", "train", "bake", "evaluate")
"""Stages whose groups can be worked on elsewhere, in order."""

CHAIN = ("initialize", "train", "bake")
"""Stages of a group that need nothing of other groups; `evaluate` needs the whole stream."""

FORMATS = ("plain", "sbatch", "cuecmd", "deadline", "parallel")
"""Kinds of text that `--print-commands` prints."""
