"""How long a run will take, and how much memory and disk it needs: `v3studio estimate`."""

from pipelines.estimate.estimate import Estimate, StageEstimate, estimate
from pipelines.estimate.rehearsal import Measured
from pipelines.estimate.work import Work

__all__ = ["Estimate", "Measured", "StageEstimate", "Work", "estimate"]
