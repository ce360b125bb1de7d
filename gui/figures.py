"""Keeps the figures of quality up to date: the evaluation, and what the timeline plots of it."""

from gui.models.evaluation import Evaluation
from gui.models.playback.timeline_plots import PLOTTED, Waveform, plots_of
from gui.models.take.workspace import modified
from gui.shell import Shell
from pipelines.takes.evaluation import measured_earlier_bake


class QualityFigures:
    """See the module; it acts through the main window."""

    def __init__(self, window: Shell) -> None:
        self._window = window
        self._seen: object = None
        self._waveform: Waveform | None = None

    @property
    def camera(self) -> str:
        """The camera whose figures are shown; "" for the mean, as over an edit, which has a view of its own."""
        return self._window.player.camera if self._window.views.shows_player else ""

    def update(self) -> None:
        """Read the evaluation again if it has changed. Call before the window is drawn."""
        window = self._window
        take, frames = window.workspace.take, window.player.transport.frame_count
        stamp: object = None
        if take is not None:
            stamp = (take.root, modified(take.evaluation), modified(take.record("bake")))
        bake = window.workspace.assessment.stages.get("bake")
        changed = bake is not None and bake.state == "stale"
        seen = (stamp, changed, frames, self.camera, window.player.other)
        if self._seen != seen:
            self._seen = seen
            stale = take is not None and (changed or measured_earlier_bake(take))
            window.evaluation = Evaluation() if take is None else Evaluation.read(take.evaluation, stale)
            self._plot(frames)
        self._show_waveform()

    def _plot(self, frames: int) -> None:
        window, camera = self._window, self.camera
        evaluation, other = window.evaluation, window.player.other
        others = {name: other.series(name, camera) for name in PLOTTED} if other is not None else None
        camera = camera if camera in evaluation.cameras else ""
        series = {name: evaluation.series(name, frames, camera) for name in PLOTTED}
        whose = evaluation.whose(camera), evaluation.whose_briefly(camera)
        window.timeline.plots = plots_of(series, whose[0], others, whose[1], ", earlier bake" * evaluation.stale)
        self._waveform = None
        against = f"\nYellow, and in parentheses: {other.label}." if other is not None else ""
        window.timeline.explanation = evaluation.explanation + against

    def _show_waveform(self) -> None:
        """Add the sound's row to the timeline once its waveform is known, or remove it."""
        audio, timeline = self._window.player.audio, self._window.timeline
        waveform = audio.waveform if audio is not None else None
        if waveform is not self._waveform:
            plots = [plot for plot in timeline.plots if not isinstance(plot, Waveform)]
            timeline.plots = (*plots, *((waveform,) if waveform is not None else ()))
            self._waveform = waveform
