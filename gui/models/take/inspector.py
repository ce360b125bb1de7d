"""The inspector, drawn as an image."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height, text_width, wrapped
from v3studio.gui.drawing.compare import What
from v3studio.gui.drawing.palette import BAD, DIM, LINE, PANEL, TEXT, State
from v3studio.gui.models.evaluation import DECODED, Evaluation
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.stage_rows import stage_name
from v3studio.gui.models.take.run_state import percent
from v3studio.gui.models.take.workspace import Workspace
from v3studio.pipelines.reports.terminal import duration
from v3studio.pipelines.takes.results.summaries import summary_words
from v3studio.studio.comparison.metrics import EVALUATED, FLICKER, MAIN
from v3studio.studio.edits import EditList
from v3studio.studio.errors import StudioError

Row = tuple[str, str]

OVER = "Trained / decoded, PSNR in dB. Masked: over black, in the performer's box."


@dataclass(frozen=True)
class Block:
    """Figures under a heading. `rows`: (name, value). `note`: a sentence below the rows; "" for none. `bad`: the
    sentence is red."""

    title: str
    rows: Sequence[Row]
    note: str = ""
    bad: bool = False


def review_blocks(player: PlayerPresenter, evaluation: Evaluation, marks: Marks, camera: str = "") -> list[Block]:
    """Figures of the current frame; quality is that in evaluation.json, of a camera or, by default, the mean."""
    transport = player.transport
    if player.opened is None:
        return []
    frame = player.frame
    number = transport.number(frame)
    mark = f"Mark: {marks.notes[number] or '(no note)'}" if number in marks.notes else ""
    rows = [
        ("frame", f"{number} ({transport.number(0)} to {transport.number(transport.last)})"),
        ("time", f"{frame / transport.fps:.2f} s at {transport.fps:g} fps"),
    ]
    if player.on_screen:
        rows += camera_rows(player)
    blocks = [Block("Frame", rows, mark)]
    figures, whose = evaluation.figures(frame, camera)
    rows = []
    for metric in EVALUATED:
        values = [figures.get(f"{metric.name}_{what}") for what in (What.TRAINED, What.DECODED)]
        if values != [None, None]:
            rows.append((metric.title, " / ".join(metric.text(value, unit=False) for value in values)))
    row = evaluation.frames.get(frame)
    if row is not None:
        rows.append(("size", f"{row.bytes / 1000:.1f} KB"))
    note = evaluation.error or note_on_figures(player, bool(rows), evaluation.stale)
    if rows or note:
        blocks.append(Block(f"Quality, {whose}" if whose else "Quality", rows, note))
    words, wrong = evaluation.wrong_masks(frame)
    if words:
        blocks.insert(1, Block("Masks", wrong, words, bad=True))
    if transport.span is not None:
        blocks.append(span_block(player, evaluation, camera, *transport.span))
    if player.left_out:
        blocks.insert(1, Block("Damaged, skipped", [], "\n".join(player.left_out)))
    return blocks


def note_on_figures(player: PlayerPresenter, there: bool, stale: bool) -> str:
    """Return why there are no figures of the current frame, or what lowers them; "" without settings that can be
    read."""
    if player.context is None:
        return ""
    try:
        edits = player.context.edits
    except StudioError:  # reported where the edits are shown
        edits = EditList()
    if there:
        removes = not stale and (edits.regions or edits.crop or edits.floaters or edits.ground)
        return OVER + " PSNR is lower where the footage shows what the edits removed." * bool(removes)
    trimmed = edits.trim is not None and not edits.trim.holds(player.transport.number(player.frame))
    return "Trimmed off." if trimmed else "Not evaluated yet."


def span_block(player: PlayerPresenter, evaluation: Evaluation, camera: str, first: int, last: int) -> Block:
    """Figures of the selected span; those of another open bake follow a slash."""
    transport, other, frames = player.transport, player.other, slice(first, last + 1)

    def values(name: str) -> list[list[float | None]]:
        series = [evaluation.series(name, transport.frame_count, camera)[frames]]
        return series if other is None else [*series, other.series(name, camera)[frames]]

    measured = [(value, at) for at, value in enumerate(values(DECODED)[0], first) if value is not None]
    where = f", frame {transport.number(min(measured)[1])}" if measured else ""
    quality, flicker = f".{MAIN.digits}f", f".{FLICKER.digits}f"
    figures: tuple[tuple[str, str, Callable[[list[float]], float], str, str], ...] = (
        (f"{MAIN.title}, mean", DECODED, fmean, quality, MAIN.unit),
        (f"lowest{where}", DECODED, min, quality, MAIN.unit),
        ("size", "bytes", lambda sizes: sum(sizes) / 1000, ",.1f", "KB"),
        (FLICKER.title, FLICKER.name, fmean, flicker, "/255"),
    )
    count = last - first + 1
    rows = [("length", f"{count} frame{'s' * (count != 1)}, {count / transport.fps:.2f} s")]
    for title, name, figure, form, unit in figures:
        known = [[value for value in series if value is not None] for series in values(name)]
        if any(known):
            words = (format(figure(series), form) if series else "-" for series in known)
            rows.append((title, f"{' / '.join(words)} {unit}"))
    note = "Not evaluated yet." if len(rows) == 1 else "" if other is None else f"After the slash: {other.label}."
    return Block(transport.range_words(first, last), rows, note)


def run_blocks(workspace: Workspace, stage: str) -> list[Block]:
    """Progress of the run and status of the selected stage."""
    row = workspace.row(stage)
    blocks = []
    progress = workspace.run.progress
    if workspace.busy and progress is not None:
        done = percent(progress.fraction) if workspace.paused else workspace.run.stage_words()
        rows = [("stage", stage_name(progress.stage)), ("done", done)]
        if not workspace.paused:
            total = progress.total_seconds_left
            rows.append(("entire run", f"{duration(total)} left" if total is not None else "estimating time left"))
        for name in ("loss", "psnr", "splats"):
            value, label = progress.figures.get(name), name.replace("psnr", "PSNR")
            if isinstance(value, float):
                rows.append((label, f"{value:.4g}{' dB' * (name == 'psnr')}"))
            elif isinstance(value, int):
                rows.append((label, f"{value:,}"))
                most = workspace.config.train.max_splats if workspace.config is not None else value
                if name == "splats" and progress.stage == "train" and value > most:
                    rows.append(("after pruning", f"{most:,} at most"))
        blocks.append(Block("Paused" if workspace.paused else "Running", rows, progress.label))
    if stage != "review" and workspace.context is not None:
        status = workspace.assessment.stages.get(stage)
        running = "paused" if workspace.paused else "running"
        states = {State.MISSING: "not run", State.PARTIAL: "not finished", State.RUNNING: running}
        rows = [("state", states.get(row.state, row.state))]
        if status is not None and status.seconds is not None:
            rows.append(("time", duration(status.seconds)))
        if stage == "capture":
            rows.append(("footage", row.words))
        summary = status.summary if status is not None else None
        blocks.append(Block(row.title, rows, summary_words(stage, summary) if summary else ""))
        if row.doubts and stage != "capture":
            blocks.insert(0, Block("Warnings", [], "\n".join(row.doubts)))
    return blocks


def camera_rows(player: PlayerPresenter) -> list[Row]:
    """Rows about the capture camera or the free view, and the splats in the image, if it is the wanted one."""
    camera, picture = player.capture_camera, player.picture
    rows = [("camera", "free view")]
    if camera is not None:
        rows = [
            ("camera", camera.name + (", held out" if camera.name in player.held_out else "")),
            ("image", f"{camera.width} x {camera.height}, focal {camera.fx:.0f} px"),
        ]
    if picture is not None and player.current and picture.splats:
        rows.append(("splats", f"{picture.splats:,}"))
    return rows


def figures_picture(blocks: Sequence[Block], width: int, height: int, em: float, down: float = 0.0) -> np.ndarray:
    """(height, width, 3) uint8: stacked blocks, scrolled by `down` pixels; says so if there are more below."""
    canvas = Canvas(width, height, PANEL)
    if _draw_blocks(canvas, blocks, em, 0.3 * em - down) > height:
        size = round(0.88 * em)
        band = line_height(size) + 0.2 * em
        canvas.rect(0, height - band, width, band, PANEL)
        canvas.rect(0.6 * em, height - band, width - 1.2 * em, 1, LINE)
        canvas.text(width / 2, height - band + 0.15 * em, "Scroll for more", size, DIM, align="middle")
    return canvas.pixels


def figures_height(blocks: Sequence[Block], width: int, em: float) -> float:
    """Height of all of `figures_picture` in pixels."""
    return _draw_blocks(Canvas(width, 1), blocks, em, 0.3 * em) + 0.3 * em


def _draw_blocks(canvas: Canvas, blocks: Sequence[Block], em: float, y: float) -> float:
    """Draw blocks from a y coordinate on; return the one below them."""
    size, width = round(0.88 * em), canvas.width
    for block in blocks:
        y = heading(canvas, y, block.title, em)
        for name, value in block.rows:
            names = wrapped(name, size, max(width - 1.8 * em - text_width(value, size), 0.4 * width)) or [name]
            y = canvas.lines(0.6 * em, y, names, size, DIM)
            room = width - text_width(names[-1], size) - 1.8 * em
            canvas.text(width - 0.6 * em, y - line_height(size), value, size, TEXT, align="right", width=room)
        note = wrapped(block.note, size, width - 1.2 * em) if block.note else []
        y = canvas.lines(0.6 * em, y, note, size, BAD if block.bad else DIM) + 0.3 * em
    return y


def heading(canvas: Canvas, y: float, text: str, em: float) -> float:
    """Draw a heading with a line under it; return the y coordinate below it."""
    size = round(0.95 * em)
    canvas.text(0.6 * em, y, text, size, TEXT, width=canvas.width - 1.2 * em)
    y += line_height(size)
    canvas.rect(0.6 * em, y - 2, canvas.width - 1.2 * em, 1, LINE)
    return y + 0.2 * em
