"""Prints the events of a run for people: progress bars and messages."""

from __future__ import annotations

from collections import Counter
from typing import Any

from v3studio.pipelines.events import (
    Event,
    Finished,
    Log,
    Progress,
    RunStarted,
    StageFailed,
    StageFinished,
    StageStarted,
    Warned,
)
from v3studio.pipelines.reports.terminal import console, duration, escaped
from v3studio.pipelines.takes.results.summaries import summary_words
from v3studio.studio.counts import counted
from v3studio.studio.errors import visible
from v3studio.studio.process import NativeLines

SERIOUS = ("evaluation.masks_contradicted",)  # codes of warnings that are printed in red: figures are worth nothing
MOST_ALIKE = 3  # warnings of one kind that are printed for a stage


class Bars:
    """Two progress bars with the time left, for the stage and for the run; plain lines if there is no terminal.

    In a terminal, output of native libraries appears above the bars.
    """

    def __init__(self) -> None:
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn
        from rich.progress import Progress as RichProgress

        self.console = console()
        self._bars = RichProgress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=28),
            TaskProgressColumn(),
            TextColumn("{task.fields[left]}", markup=False),
            TextColumn("{task.fields[note]}", style="dim", markup=False),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._stage: Any = None
        self._total: Any = None
        self._last_percent = -1
        self._native: NativeLines | None = None
        self._warnings: Counter[str] = Counter()

    def __enter__(self) -> Bars:
        if self.console.is_terminal:
            self._native = NativeLines()
        self._bars.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop()

    def _stop(self) -> None:
        if self._native is not None:
            self._say_native(self._native.close())
        self._bars.stop()

    def __call__(self, event: Event) -> None:
        if self._native is not None:
            self._say_native(self._native.take())
        if isinstance(event, RunStarted):
            self._run_started(event)
        elif isinstance(event, StageStarted):
            self._say(f"[bold]{event.stage}[/bold]: {escaped(event.reason)}")
            self._drop_stage_bar()
            self._last_percent = -1
            self._stage = self._bars.add_task(event.stage, total=1.0, left="", note="")
        elif isinstance(event, Progress):
            self._progress(event)
        elif isinstance(event, Warned):
            self._warnings[event.code] += 1
            if self._warnings[event.code] <= MOST_ALIKE:
                color = "bold red" if event.code in SERIOUS else "yellow"
                self._say(f"[{color}]warning:[/{color}] {escaped(event.message)}")
        elif isinstance(event, StageFinished):
            self._say_repeated()
            figures = summary_words(event.stage, event.summary)
            self._say(f"[bold]{event.stage}[/bold]: done in {duration(event.seconds)}. {escaped(figures)}")
            self._drop_stage_bar()
        elif isinstance(event, StageFailed):
            self._drop_stage_bar()  # the command line prints the error
        elif isinstance(event, Finished):
            self._say_repeated()
            self._stop()  # restores the cursor, even if the watchdog is about to end the process
            if event.outcome == "cancelled":
                self._say(f"[yellow]cancelled:[/yellow] {escaped(event.message)}")
        elif isinstance(event, Log):
            self._say(f"[dim]{escaped(event.message)}[/dim]")

    def _say_repeated(self) -> None:
        """Print how many warnings were left out since the last time."""
        for code, count in self._warnings.items():
            if count > MOST_ALIKE:
                self._say(f"[yellow]warning:[/yellow] {count - MOST_ALIKE} more like this ({code}), in the take's log")
        self._warnings.clear()

    def _run_started(self, event: RunStarted) -> None:
        if event.done:
            self._say(f"up to date: {', '.join(event.done)}")
        if event.stages:
            self._say(f"to do: {', '.join(event.stages)}")
        if len(event.stages) > 1:
            self._total = self._bars.add_task("all stages", total=1.0, left="", note="")

    def _drop_stage_bar(self) -> None:
        if self._stage is not None:
            self._bars.remove_task(self._stage)
            self._stage = None

    def _progress(self, event: Progress) -> None:
        note = visible(_note(event))
        if self._stage is not None:
            self._bars.update(self._stage, completed=event.fraction, left=_left(event.seconds_left), note=note)
        if self._total is not None:
            self._bars.update(self._total, completed=event.total_fraction, left=_left(event.total_seconds_left))
        if not self.console.is_terminal:  # a log file: one line per five percent
            percent = int(event.fraction * 20) * 5
            if percent > self._last_percent:
                self._last_percent = percent
                self.console.print(
                    f"{event.stage} {percent:3d}%  {_left(event.seconds_left)}  {note}".rstrip(),
                    markup=False,
                    soft_wrap=True,
                )

    def _say_native(self, lines: list[str]) -> None:
        from rich.text import Text

        for line in lines:
            self.console.print(Text(line, "dim"), soft_wrap=True)

    def _say(self, text: str) -> None:
        self._bars.console.print(text, soft_wrap=True)


def _left(seconds: float | None) -> str:
    return "" if seconds is None or seconds < 1 else f"{duration(seconds)} left"


def _note(event: Progress) -> str:
    figures = event.figures
    parts = [event.label]
    if isinstance(figures.get("psnr"), float):
        parts.append(f"PSNR {figures['psnr']:.1f} dB")
    splats = figures.get("splats")
    if isinstance(splats, int):
        parts.append(counted(splats, "splat"))
    return ", ".join(part for part in parts if part)
