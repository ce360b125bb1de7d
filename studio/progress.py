"""How long work in the library tells its caller how far it is.

Long functions take `progress: ProgressFn = no_progress` and call it often
(several times a second). The caller may raise `studio.errors.Cancelled` from
it to stop the work; library code lets that exception pass.
"""

from typing import Any, Protocol


class ProgressFn(Protocol):
    """`progress(done, total, loss=0.03, psnr=31.2, ...)`: steps done of total, and figures so far."""

    def __call__(self, done: int, total: int, **figures: Any) -> None: ...


def no_progress(done: int, total: int, **figures: Any) -> None:
    """A `ProgressFn` that tells nobody."""
