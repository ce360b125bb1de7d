"""Bake: size by file, and size at other QPs."""

import math
from collections.abc import Hashable

import numpy as np

from v3studio.gui.drawing.canvas import Canvas, line_height
from v3studio.gui.drawing.palette import ACCENT, DIM, GROUND, PANEL, TEXT
from v3studio.gui.models.take.workspace import Workspace, modified
from v3studio.gui.pages.bake.qp_chart import draw_trial
from v3studio.gui.pages.bake.qp_trial import QpTrial
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.report_table import cells_text
from v3studio.gui.pages.stage_view import Size, StageView
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers
from v3studio.pipelines.takes.results.videos import capture_place
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import StreamReader


def rest_words(sound: bool) -> str:
    """The parts of a stream besides its groups; `sound`: whether it has sound."""
    return "manifest and sound" if sound else "manifest"


def shares(reader: StreamReader) -> dict[str, tuple[int, list[int]]]:
    """Bytes and QPs in the stream, by file; last the rest."""
    parts: list[tuple[str, int, int | None]] = []
    for group in reader.groups:
        parts += [("motion", group.side.bytes, None), ("video", group.video.bytes, group.video.qp)]
    rest = reader.played_bytes - sum(size for _, size, _ in parts)
    parts.append((rest_words(reader.manifest.audio is not None), rest, None))
    by_name: dict[str, tuple[int, list[int]]] = {}
    for name, size, qp in parts:
        before, qps = by_name.get(name, (0, []))
        by_name[name] = (before + size, qps if qp is None else sorted({*qps, qp}))
    return by_name


COLUMNS = ("KB per frame", "share", "QP")  # of the table in mode "bytes"


class BakeView(StageView):
    """Bytes by file, and bytes and PSNR at other QPs. `points`: pixels of each QP and level in their chart."""

    modes = (ViewMode.BYTES, ViewMode.OTHER_QPS)

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self.trial = QpTrial()
        self.numbers = FrameNumbers()
        self.points: dict[int | str, tuple[float, float]] = {}
        self._done = ""
        self._cells: list[list[str]] = []

    def state(self) -> Hashable:
        """The stream on disk, the results of the QP trial and the chosen quality."""
        take = self.workspace.take
        stamp = modified(take.stream / "manifest.json") if take is not None else 0
        config = self.workspace.config
        quality = config.bake.quality if config is not None else 0
        return (take, stamp, self.mode, self.trial.changes, quality, self._done, self.numbers, self.em)

    def draw(self, size: Size, state: Hashable) -> np.ndarray:
        self._cells = []  # no table of another mode or take, also if this one cannot be drawn
        take, config = self.workspace.take, self.workspace.config
        if take is None:
            raise StudioError("gui.no_take", "no take is open", fix="Open a take.")
        if self.mode == ViewMode.OTHER_QPS:
            if config is None:
                raise StudioError("take.no_settings", "the settings of this take cannot be read", file=take.config)
            self.trial.start(self.workspace, self.numbers)
            canvas, self._cells = Canvas(*size, GROUND), self.trial.cells
            self.points = draw_trial(canvas, self.em, self.trial, config.bake.quality, self._done)
            return canvas.pixels
        if not take.has_stream:
            raise StudioError("take.not_baked", "no stream yet", fix="Run all stages.")
        with StreamReader.open(take.stream) as reader:
            return self._bytes(size, reader)

    def _bytes(self, size: Size, reader: StreamReader) -> np.ndarray:
        canvas, em = Canvas(*size, GROUND), self.em
        normal = round(em)
        step = line_height(normal) * 1.5
        frames, rest = reader.frame_count, rest_words(reader.manifest.audio is not None)
        y = em
        per_frame = reader.played_bytes / frames
        words = (
            f"{reader.played_bytes:,} bytes, {per_frame / 1000:.1f} KB per frame with {rest}, "
            f"{per_frame * reader.fps * 8 / 1e6:.2f} Mbit/s at {reader.fps:g} fps"
        )
        canvas.text(em, y, words, normal, TEXT, width=size[0] - 2 * em)
        y += 2 * step
        cells = [["", *COLUMNS]]
        left, right = em + 11 * em, size[0] - em - 15 * em
        columns = (size[0] - em - 9.5 * em, size[0] - em - 4.5 * em, size[0] - em)
        for words, place in zip(COLUMNS, columns, strict=True):
            canvas.text(place, y - step * 0.8, words, round(0.85 * em), DIM, align="right")
        for name, (value, qps) in shares(reader).items():
            canvas.text(em, y, name, normal, TEXT)
            canvas.rect(left, y + 2, right - left, normal, PANEL)
            canvas.rect(left, y + 2, (right - left) * value / reader.played_bytes, normal, ACCENT)
            qp = " to ".join(str(qp) for qp in dict.fromkeys((*qps[:1], *qps[-1:])))
            numbers = (f"{value / frames / 1000:.2f}", f"{100 * value / reader.played_bytes:.1f}%", qp)
            cells.append([name, *numbers])
            for words, place in zip(numbers, columns, strict=True):
                canvas.text(place, y, words, normal, TEXT, align="right")
            y += step
        self._cells = cells
        y += 0.5 * step
        start = capture_place(reader).first_frame
        for group in reader.groups:
            if y + step > size[1]:
                break
            first = start + group.first_frame
            last = first + group.frame_count - 1
            words = (
                f"group {group.index}: frames {self.numbers.number(first)} to {self.numbers.number(last)}, "
                f"{counted(group.splats, 'splat')}, "
                f"{group.bytes / group.frame_count / 1000:.1f} KB per frame without {rest}"
            )
            canvas.text(em, y, words, round(0.9 * em), DIM, width=size[0] - 2 * em)
            y += step * 0.8
        return canvas.pixels

    def click(self, x: float, y: float) -> None:
        """Make a point of the curve or a level that is clicked the setting."""
        if self.mode != ViewMode.OTHER_QPS or not self.points:
            return
        quality, (left, top) = min(self.points.items(), key=lambda item: math.hypot(item[1][0] - x, item[1][1] - y))
        if math.hypot(left - x, top - y) > 1.5 * self.em:
            return
        try:
            self.workspace.change_settings({"bake.quality": quality})
            self._done = f"Quality {quality} is set. Run Bake to use it."
        except StudioError as error:
            self._done = str(error)

    @property
    def table_text(self) -> str:
        return "" if len(self._cells) < 2 else cells_text(self._cells)

    @property
    def status(self) -> str:
        return "Ctrl+C copies the table." if self.table_text else ""
