"""The inspector and the job log, drawn as pictures."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from gui.presenters.drawing.canvas import Canvas, line_height, wrapped
from gui.presenters.drawing.palette import BAD, DIM, FAIR, LINE, PANEL, RGB, TEXT
from gui.presenters.evaluation import Evaluation
from gui.presenters.marks import Marks
from gui.presenters.playback.player import PlayerPresenter
from gui.presenters.run.workspace import Workspace
from pipelines.reports.terminal import duration

Row = tuple[str, str]


@dataclass(frozen=True)
class Block:
    """Figures under a heading.

    Attributes:
        title: the heading.
        rows: (name, value).
        note: a sentence below the rows; "" for none.
    """

    title: str
    rows: Sequence[Row]
    note: str = ""


def review_blocks(player: PlayerPresenter, evaluation: Evaluation, marks: Marks, drawn_rate: float) -> list[Block]:
    """Figures of the current frame; quality is that in evaluation.json."""
    transport, picture = player.transport, player.picture
    if player.opened is None:
        return []
    frame = player.frame
    group = max(sum(1 for start in transport.group_starts if start <= frame) - 1, 0)
    blocks = [
        Block(
            "Frame",
            [
                ("frame", f"{frame} (0 to {transport.last})"),
                ("time", f"{frame / transport.fps:.2f} s at {transport.fps:g} fps"),
                *([("footage frame", str(player.filmed[frame]))] if filmed_otherwise(player) else []),
                ("group", f"{group} (0 to {len(transport.group_starts) - 1})"
                 + (", keyframe" if frame in transport.group_starts else "")),
                *camera_rows(player),
            ],
            f"Mark: {marks.notes[frame] or '(no note)'}" if frame in marks.notes else "",
        ),
    ]  # fmt: skip
    figures, whose = evaluation.figures(frame, player.camera)
    rows: list[Row] = []
    for name in ("psnr", "ssim", "lpips"):
        for what in ("trained", "decoded"):
            value = figures.get(f"{name}_{what}")
            if value is not None:
                rows.append((f"{name.upper()} {what}", f"{value:.2f} dB" if name == "psnr" else f"{value:.4f}"))
    row = evaluation.frames.get(frame)
    if row is not None:
        rows.append(("size", f"{row.bytes / 1000:.1f} KB"))
    blocks.append(
        Block(
            f"Quality, {whose}" if whose else "Quality",
            rows,
            evaluation.error or ("" if rows else "Not evaluated yet."),
        )
    )
    rows = []
    if picture is not None and player.current:
        if picture.splats:
            rows.append(("splats", f"{picture.splats:,}"))
        source = player.source
        load = source.load_ms(picture.frame) if source is not None and picture.source != "truth" else None
        if load is not None:
            rows.append(("decode" if picture.source == "decoded" else "read", f"{load:.1f} ms"))
        if picture.draw_seconds:
            rows.append(("render", f"{1000 * picture.draw_seconds:.1f} ms"))
    rows.append(("playback", f"{player.rate:.1f} fps"))
    rows.append(("window redraws", f"{drawn_rate:.1f} fps"))
    blocks.append(Block("Speed", rows))
    if player.left_out:
        blocks.insert(1, Block("Damaged, skipped", [], "\n".join(player.left_out)))
    return blocks


def filmed_otherwise(player: PlayerPresenter) -> bool:
    """Whether the footage's frame number differs from the take's."""
    frame = player.frame
    return frame < len(player.filmed) and player.filmed[frame] != frame


def run_blocks(workspace: Workspace, stage: str) -> list[Block]:
    """Progress of the run and status of the selected stage."""
    row = workspace.row(stage)
    blocks = []
    progress = workspace.run.progress
    if workspace.busy and progress is not None:
        words = "paused" if workspace.paused else workspace.run.stage_words()
        rows = [("stage", progress.stage), ("done", words)]
        if progress.total_seconds_left is not None and not workspace.paused:
            rows.append(("entire run", f"{duration(progress.total_seconds_left)} left"))
        for name in ("loss", "psnr", "splats"):
            value = progress.figures.get(name)
            if isinstance(value, float):
                rows.append((name, f"{value:.4g}"))
            elif isinstance(value, int):
                rows.append((name, f"{value:,}"))
        blocks.append(Block("Running", rows, progress.label))
    if stage != "review":
        status = workspace.assessment.stages.get(stage)
        rows = [("state", "paused" if row.state == "running" and workspace.paused else row.state)]
        if status is not None and status.seconds is not None:
            rows.append(("time", duration(status.seconds)))
        for name, value in (status.summary or {}).items() if status is not None else ():
            words = (
                ", ".join(f"{one:,}" if isinstance(one, int) else str(one) for one in value)
                if isinstance(value, list)
                else f"{value:,}"
                if isinstance(value, int)
                else str(value)
            )
            rows.append((name.replace("_", " "), words))
        if stage == "capture":
            rows.append(("footage", row.words))
        blocks.append(Block(row.title, rows))
    return blocks


def camera_rows(player: PlayerPresenter) -> list[Row]:
    """Rows about the capture camera or the free view."""
    rig = player.opened.rig if player.opened is not None else None
    if not player.camera or rig is None:
        return [("camera", f"free view, distance {player.orbit.distance:.2f}")]
    camera = rig[player.camera]
    held_out = player.context is not None and camera.name in player.context.config.capture.held_out
    return [
        ("camera", camera.name + (", held out" if held_out else "")),
        ("image", f"{camera.width} x {camera.height}, focal {camera.fx:.0f} px"),
    ]


def figures_picture(blocks: Sequence[Block], width: int, height: int, em: float, down: float = 0.0) -> np.ndarray:
    """(height, width, 3) uint8: stacked blocks, scrolled by `down` pixels."""
    canvas = Canvas(width, height, PANEL)
    size = round(0.88 * em)
    step = line_height(size)
    y = 0.3 * em - down
    for block in blocks:
        y = heading(canvas, y, block.title, em)
        for name, value in block.rows:
            name_width = canvas.text(0.6 * em, y, name, size, DIM)
            canvas.text(width - 0.6 * em, y, value, size, TEXT, align="right", width=width - name_width - 1.8 * em)
            y += step
        for line in wrapped(block.note, size, width - 1.2 * em) if block.note else ():
            canvas.text(0.6 * em, y, line, size, DIM)
            y += step
        y += 0.3 * em
    return canvas.pixels


def figures_height(blocks: Sequence[Block], width: int, em: float) -> float:
    """Height of all of `figures_picture` in pixels."""
    size = round(0.88 * em)
    lines = sum(len(block.rows) for block in blocks)
    lines += sum(len(wrapped(block.note, size, width - 1.2 * em)) for block in blocks if block.note)
    return 0.6 * em + lines * line_height(size) + len(blocks) * (line_height(round(0.95 * em)) + 0.5 * em)


def heading(canvas: Canvas, y: float, text: str, em: float) -> float:
    """Draw a heading with a line under it; return the y coordinate below it."""
    size = round(0.95 * em)
    canvas.text(0.6 * em, y, text, size, TEXT, width=canvas.width - 1.2 * em)
    y += line_height(size)
    canvas.rect(0.6 * em, y - 2, canvas.width - 1.2 * em, 1, LINE)
    return y + 0.2 * em


INDENT, CONTINUED = 0.8, "   "
"""Of the lines that continue one of the log: room in em, and the blanks."""

LINE_COLORS: dict[str, RGB] = {"": DIM, "warning": FAIR, "error": BAD}


def log_lines(
    lines: Iterable[tuple[str, str]], width: int, em: float, times: Iterable[float] = ()
) -> list[tuple[str, str]]:
    """The log wrapped to the width: (kind, line). A line begins with its time of day, where known, and its level; what
    continues it is indented.

    Args:
        lines: (kind, text).
        width: pixels.
        em: font size, pixels.
        times: when each line was told, seconds since 1970; 0 if unknown.
    """
    size = round(0.82 * em)
    found: list[tuple[str, str]] = []
    for (kind, text), told in zip(lines, itertools.chain(times, itertools.repeat(0.0)), strict=False):
        clock = datetime.fromtimestamp(told).strftime("%H:%M:%S") if told else ""
        head = " ".join(filter(None, (clock, kind)))
        parts = wrapped(f"{head}  {text}" if head else text, size, width - 1.2 * em - (INDENT * em if head else 0))
        found += [(kind, part if not (head and number) else CONTINUED + part) for number, part in enumerate(parts)]
    return found


def log_picture(lines: Sequence[tuple[str, str]], width: int, height: int, em: float, back: int = 0) -> np.ndarray:
    """(height, width, 3) uint8: the end of the log, scrolled back by a number of lines.

    Args:
        lines: from `log_lines`.
    """
    canvas = Canvas(width, height, PANEL)
    top = heading(canvas, 0.3 * em, "Job log", em)
    size = round(0.82 * em)
    step = line_height(size)
    count = max(int((height - top) // step), 1)
    if not lines:
        canvas.text(0.6 * em, top, "No run yet.", size, DIM)
    end = max(len(lines) - back, min(count, len(lines)))
    for number, (kind, text) in enumerate(lines[max(end - count, 0) : end]):
        canvas.text(0.6 * em, top + number * step, text, size, LINE_COLORS[kind])
    return canvas.pixels
