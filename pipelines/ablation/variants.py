"""The variants of `v3studio ablate`. Imports nothing heavy, since the command line lists them in its help."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonData

QPS = (12, 16, 20, 24, 28, 32)
FULL = "full"
_WHOLE_TAKE = 1000


@dataclass(frozen=True)
class Variant:
    """One variant of training: name on the command line, title in tables, and overrides by dotted name."""

    name: str
    title: str
    settings: Mapping[str, JsonData] = field(default_factory=dict)


VARIANTS = (  # the paper's ablations (section 6 and its figure on group size), and group sizes around its 20
    Variant(FULL, "full method"),
    Variant("no-entropy", "no residual entropy loss", {"train.entropy_weight": 0.0}),
    Variant("no-temporal", "no temporal loss", {"train.temporal_weight": 0.0}),
    Variant(
        "no-motion",
        "no motion stage (positions are fine-tuned instead)",
        {"train.motion_iterations": 0, "train.motion_first_iterations": None, "train.finetune_means": True},
    ),
    Variant("no-finetune", "no fine-tuning", {"train.finetune_iterations": 0}),
    Variant("no-grouping", "one group for the whole take", {"train.group_size": _WHOLE_TAKE}),
    *(Variant(f"group-{size}", f"groups of {size}", {"train.group_size": size}) for size in (10, 15, 20, 25, 30)),
)

OPTIONS = (  # variants beyond the paper; measured only if named
    Variant("fixed-positions", "means are not fine-tuned", {"train.finetune_means": False}),
    Variant("paper-entropy", "residual entropy loss with the paper's weight", {"train.entropy_weight": 1e-4}),
    Variant("no-dropout", "no dropout", {"train.dropout": 0.0}),
)


def chosen(names: Sequence[str]) -> tuple[Variant, ...]:
    """Variants by name, the full method first; all of `VARIANTS` if no name is given."""
    known = {variant.name: variant for variant in (*VARIANTS, *OPTIONS)}
    for name in names:
        if name not in known:
            problem = f"unknown variant '{name}'"
            fix = f"Available: {', '.join(known)}."
            raise StudioError("ablation.unknown_variant", problem, value=name, fix=fix, expected=list(known))
    wanted = {FULL, *(names or [variant.name for variant in VARIANTS])}
    return tuple(variant for variant in known.values() if variant.name in wanted)
