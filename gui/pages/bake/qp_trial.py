"""Size and quality at other QPs, measured on a whole group of a take."""

from v3studio.gui.models.stages import Inputs, Part, Trial, longest_part, measure
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers

TRIED_QPS = (14, 18, 20, 22, 26, 30, 36)

_Request = tuple[object, Inputs, Part]  # what is tried


class QpTrial:
    """Bakes the take's longest group at several QPs on a thread, as the stage does. `words`: or the error."""

    def __init__(self) -> None:
        self.results: dict[int, Trial] = {}
        self.words = ""
        self.fps = 30.0
        self.changes = 0
        self._of: object = None
        self._worker: LatestWorker[_Request, None] = LatestWorker(self._run, "v3studio trial", self._ended)

    @property
    def running(self) -> bool:
        return not self._worker.idle

    @property
    def cells(self) -> list[list[str]]:
        """The table: titles, and a row for each QP that was tried."""
        rows = [["QP", "KB per frame", "Mbit/s", "PSNR, dB"]]
        for qp, result in sorted(self.results.items()):
            size = result.bytes_per_frame
            rows.append([str(qp), f"{size / 1000:.1f}", f"{size * self.fps * 8 / 1e6:.2f}", f"{result.psnr:.2f}"])
        return rows

    def start(self, workspace: Workspace, numbers: FrameNumbers) -> None:
        """Start, unless these frames and settings have been tried. Raises StudioError: `take.not_trained`."""
        take, context = workspace.take, workspace.context
        assert take is not None
        assert context is not None
        part = longest_part(context)
        files, _ = take.trained_files()
        of = (
            tuple(files),
            files[part.indices[-1]].stat().st_mtime_ns,
            context.config.bake.model_copy(update={"quality": 0}).model_dump_json(),
            context.edits.model_dump_json(),
        )
        if of == self._of:
            return
        self._of, self.results = of, {}
        self.fps = float(context.raw_footage.fps)
        first, last = numbers.number(part.indices[0]), numbers.number(part.indices[-1])
        frames = f"frames {first} to {last}" if last > first else f"frame {first}"
        self.words = f"Group {part.index} ({frames}) baked at other QPs. PSNR: decoded against trained."
        self._worker.ask((of, Inputs(take, context.config), part))

    def _run(self, request: _Request) -> None:
        (of, context, part), results = request, self.results
        qps = sorted({*TRIED_QPS, context.config.bake.qp})
        # the extremes and the current one first: a curve is there early
        qps.sort(key=lambda qp: (qp != context.config.bake.qp, qp not in (TRIED_QPS[0], TRIED_QPS[-1]), qp))
        for qp in qps:
            if of is not self._of or self._worker.closed:
                return
            settings = context.config.bake.replace(quality=qp, ladder=())
            results[qp] = measure(context, part, settings)
            self.changes += 1

    def _ended(self, done: Done[_Request, None]) -> None:
        """Forget the frames that were tried, and note why that failed."""
        if done.error is not None and done.request[0] is self._of:
            self.words = str(done.error)
        self.changes += 1
