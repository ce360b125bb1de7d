"""The chart of the QP trial: PSNR over size, one point per QP, the levels of quality, and a table beside it."""

import numpy as np

from gui.drawing.canvas import Canvas, line_height, text_width
from gui.drawing.palette import ACCENT, DIM, GROUND, RAISED, TEXT
from gui.drawing.plots import Axes, limits
from gui.models.stages import Trial
from gui.pages.bake.qp_trial import TRIED_QPS, QpTrial
from gui.pages.stage_view import Size
from studio.stream.settings import LEVELS

TITLES = ("QP", "KB per frame", "Mbit/s", "PSNR, dB")


class QpChart:
    """See the module. `points`: center of each QP's point, and of each level's name, pixels. `cells`: the table as
    words: titles, then a row for each QP with results."""

    def __init__(self, size: Size, em: float, trial: QpTrial, current: int | str, done: str) -> None:
        self.canvas, self._em, self._current = Canvas(*size, GROUND), em, current
        self._small, self._step = round(0.85 * em), 1.25 * line_height(round(em))
        self.points: dict[int | str, tuple[float, float]] = {}
        results, running = dict(sorted(trial.results.items())), trial.running
        self.cells = [list(TITLES), *(_words(qp, found, trial.fps) for qp, found in results.items())]
        canvas = self.canvas
        canvas.text(em, 0.8 * em, trial.words, round(em), TEXT, width=size[0] - 2 * em)
        note = done or "Click a point or a level to set it, then run Bake. Lower QPs look better and take more bytes."
        canvas.text(em, 2.3 * em, note, self._small, ACCENT if done else DIM, width=size[0] - 2 * em)
        table = 21 * em
        beside = size[0] > 2 * table
        top = 5.2 * em
        self._table(size[0] - table if beside else em, top, results, running)
        if not beside:
            top += (len({*TRIED_QPS, *results}) + 1.5) * self._step
        self._curve(em, top, (size[0] - table if beside else size[0]) - 2 * em, size[1] - top - em, results)

    def _table(self, x: float, y: float, results: dict[int, Trial], running: bool) -> None:
        canvas, em = self.canvas, self._em
        columns = (x + 2.5 * em, x + 8.5 * em, x + 13.5 * em, x + 19 * em)
        for words, place in zip(TITLES, columns, strict=True):
            canvas.text(place, y, words, self._small, DIM, align="right")
        shown = dict(zip(results, self.cells[1:], strict=True))
        for qp in sorted({*TRIED_QPS, *results}):
            y += self._step
            if qp == self._current:
                canvas.rect(x, y - 0.2 * em, 20 * em, self._step, RAISED)
            canvas.text(columns[0], y, str(qp), round(em), ACCENT if qp == self._current else TEXT, align="right")
            if qp not in results:
                canvas.text(columns[1], y, "..." if running else "", round(em), DIM, align="right")
                continue
            for words, place in zip(shown[qp][1:], columns[1:], strict=True):
                canvas.text(place, y, words, round(em), TEXT, align="right")

    def _curve(self, x: float, y: float, width: float, height: float, results: dict[int, Trial]) -> None:
        canvas, em, small = self.canvas, self._em, self._small
        left, wide, high = x + 3.5 * em, width - 4.5 * em, height - 3 * em
        if wide < 6 * em or high < 4 * em:
            return
        canvas.text(x, y - 1.4 * em, "PSNR, dB", small, DIM)
        canvas.text(left + wide, y + high + 1.4 * em, "KB per frame", small, DIM, align="right")
        if not results:
            canvas.text(left + wide / 2, y + high / 2, "baking the first QP", small, DIM, align="middle")
            return
        sizes = np.array([found.bytes_per_frame / 1000 for found in results.values()])
        psnrs = np.array([found.psnr for found in results.values()])
        shown = np.append(psnrs, list(LEVELS.values()))
        axes = Axes(left, y, wide, high, (0.0, 1.1 * float(sizes.max())), limits(shown, 0.05, 0.5))
        axes.draw(canvas, small, columns=True)
        places = axes.places(sizes, psnrs)
        canvas.line(places, ACCENT, 2)
        taken: list[tuple[float, float, float]] = []  # left, right and top of words
        for level, psnr in LEVELS.items():
            row = float(axes.places([0.0], [psnr])[0, 1])
            color = ACCENT if level == self._current else DIM
            canvas.rect(left, row, wide, 1, color)
            across, down = left + 0.4 * em, row - 1.4 * small
            taken.append((across, across + canvas.text(across, down, level, small, color), down))
            self.points[level] = (left + 2 * em, row - 0.7 * small)
        for qp, (x, y) in zip(results, places, strict=True):
            self.points[qp] = (float(x), float(y))
        for qp in sorted(results, key=lambda qp: qp != self._current):
            across, down = self.points[qp]
            now, words = qp == self._current, f"QP {qp}"
            canvas.dot(across, down, 0.42 * em if now else 0.3 * em, TEXT if now else ACCENT)
            room = text_width(words, small)
            for start, top in ((across + 0.5 * em, down + 0.3 * em), (across - 0.5 * em - room, down - 1.5 * small)):
                if all(start > b or start + room < a or abs(top - at) > 1.2 * small for a, b, at in taken):
                    taken.append((start, start + room, top))
                    canvas.text(start, top, words, small, TEXT if now else DIM)
                    break  # where there is room on neither side, the table beside the curve has it


def _words(qp: int, found: Trial, fps: float) -> list[str]:
    """A row of the table."""
    per_frame = found.bytes_per_frame
    return [str(qp), f"{per_frame / 1000:.1f}", f"{per_frame * fps * 8 / 1e6:.2f}", f"{found.psnr:.2f}"]
