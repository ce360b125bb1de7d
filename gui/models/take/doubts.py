"""Doubts: what warnings say about the results of a stage, the worst first, in few sentences."""

from collections.abc import Sequence

from v3studio.gui.models.stage_rows import message_text
from v3studio.pipelines.events import Notice
from v3studio.studio.counts import counted

WORST = (
    "masks.contradiction", "rig.wrong", "rig.doubtful", "card.wrong", "mask.inverted", "mask.empty",
    "hull.mask_mismatch", "hull.outlier_mask", "calibration.weak_cameras", "calibration.reprojection_error",
)  # fmt: skip
"""Codes of the warnings that come first, in order: what they tell of spoils all that follows."""


def worst_first(warnings: Sequence[Notice]) -> list[Notice]:
    """Warnings in the order of `WORST`, those of a kind as they came."""
    return sorted(warnings, key=lambda each: WORST.index(each.code) if each.code in WORST else len(WORST))


def doubts(warnings: Sequence[Notice]) -> tuple[str, ...]:
    """A sentence for each kind of warning, the worst first: the worst of its kind, and how many more there are."""
    kinds: dict[str, list[Notice]] = {}
    for warning in worst_first(warnings):
        kinds.setdefault(warning.code or warning.message, []).append(warning)
    return tuple(map(_sentence, kinds.values()))


def _sentence(alike: Sequence[Notice]) -> str:
    worst = max(alike, key=lambda warning: warning.value if isinstance(warning.value, int | float) else 0.0)
    more = len(alike) - 1
    return message_text(worst) + (f" ({counted(more, 'more warning')} like this.)" if more else "")
