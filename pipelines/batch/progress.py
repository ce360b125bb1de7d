"""What the run of a take in the queue is doing, in a few words."""

from __future__ import annotations

from pipelines.reports.terminal import duration
from pipelines.runs.in_progress import running
from pipelines.takes.take import Take


def progress_words(take: Take) -> str:
    """For people: "train 43%, 12 min 05 s left"; "starting" before the first stage. The time is that of the run."""
    return progress(take)[0]


def progress(take: Take) -> tuple[str, str, float | None]:
    """Of the run in progress: the words of `progress_words`; the stage, "" before the first; and how much of the stage
    is done, 0 to 1, or None if it has not told yet."""
    now = running(take)
    if now is None or now.stage is None:
        return "starting", "", None
    if now.progress is None:
        return now.stage, now.stage, None
    left = now.progress.total_seconds_left
    words = f"{now.stage} {now.progress.fraction:.0%}{'' if left is None else f', {duration(left)} left'}"
    return words, now.stage, now.progress.fraction
