"""Actions that write files: screenshots, exports, the report."""

from collections.abc import Sequence
from pathlib import Path

from v3studio.gui.models.take.exports import (
    ALL_FRAMES,
    FORMATS,
    LEAST_SECONDS,
    MOVIE_BACKGROUNDS,
    MOVIE_SIZES,
    MOVIES,
    SIZED,
    WHOLE,
    ExportRequest,
)
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.dialogs.form import Form
from v3studio.pipelines.commands.export import DEFAULT_OF
from v3studio.pipelines.reports.evaluation import update_marks
from v3studio.pipelines.reports.images import write_image
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import EXPORTS


class OutputActions:
    """See the module; it acts through the main window."""

    def __init__(self, window: Shell) -> None:
        self._window = window
        self._kind = next(iter(FORMATS))

    def screenshot(self) -> None:
        """Save the image as shown."""
        window = self._window
        picture = window.player.picture
        if picture is None:
            window.notices.show("No image to save yet.")
            return
        number = window.player.transport.number(picture.request.frame)
        name = f"{picture.request.mode.replace(' ', '_')}_{picture.request.what}_{number:06d}.png"
        opened = window.player.opened
        folder = opened.take.root.parent if opened is not None and opened.take is not None else Path.home()

        def save(text: str) -> None:
            path = Path(text.strip()).expanduser().absolute()
            if path.suffix.lower() != ".png":
                path = path.with_name(path.name + ".png")
            problem = ""
            try:
                write_image(path, picture.image)
            except OSError as error:
                problem = f"{path}: cannot be written ({error.strerror}). Choose another folder."
            if window.notices.outcome("screenshot", problem):
                window.notices.show(f"Written: {path}", path=path)

        words = "PNG file of the viewport's image:"
        window.dialogs.line("screenshot", "Save screenshot", words, str(folder / name), ("save", "Save", save))

    def export(self, kind: str = "") -> None:
        """Ask for the options, then export. `kind`: to begin with; by default the one that was exported last."""
        window = self._window
        opened = window.player.opened
        if opened is None or not opened.sources:
            window.notices.show("Nothing to export yet.")
            return
        first = "trained" if self._stale else DEFAULT_OF  # if it exists
        sources = sorted(opened.sources, key=lambda name: name != first) if opened.take is not None else []
        folder = opened.path.parent if isinstance(opened.path, Path) else Path.home()
        request = ExportRequest(kind or self._kind, str(opened.path), opened.title, folder)
        request.of = sources[0] if sources else ""
        length = window.player.transport.frame_count / window.player.transport.fps
        request.seconds = f"{max(length, LEAST_SECONDS):g}"
        request.ranges = self._ranges()
        self._choose_frames(request)
        self._ask_export(request, sources)

    def _choose_frames(self, request: ExportRequest) -> None:
        """Choose the frames that are usual for the format: the span, the frame under review as a file, else all."""
        every, present, *span = request.ranges
        window = self._window
        reviewed = window.views.stage == "review" and not window.player.transport.playing
        if span:
            request.frames = span[0]
        else:
            request.frames = present if reviewed and EXPORTS[request.kind].holds == "frame" else every

    @property
    def _stale(self) -> bool:
        """Whether the take has changed since its stream was baked."""
        workspace = self._window.workspace
        return workspace.take is not None and workspace.row("bake").state == "stale"

    def _ranges(self) -> dict[str, range | None]:
        """Frames that can be exported: all, the one on screen, the selected span."""
        transport = self._window.player.transport
        frame, span = transport.number(transport.frame), transport.span
        ranges: dict[str, range | None] = {ALL_FRAMES: None, f"frame {frame}": range(frame, frame + 1)}
        if span is not None:
            ranges[transport.range_words(*span).lower()] = range(*map(transport.number, (span[0], span[1] + 1)))
        return ranges

    def _ask_export(self, request: ExportRequest, sources: Sequence[str], error: str = "") -> None:
        """Ask for format, frames, source, a movie's options and the path. `error`: why the export was refused."""
        dialogs = self._window.dialogs
        form = Form(dialogs, request)

        def changed() -> None:
            form.widgets["line"].text_value = request.target
            form.widgets["frames"].enabled = request.kind not in WHOLE
            form.widgets["seconds"].enabled = request.kind == "turntable"
            form.widgets["size"].enabled = request.kind in SIZED
            form.widgets["background"].enabled = request.kind in MOVIES

        def start() -> None:
            try:
                self._window.exports.start(request)
            except (StudioError, OSError) as refused:
                self._ask_export(request, sources, str(refused))
            else:
                self._kind = request.kind
                dialogs.close()

        def other_format() -> None:
            self._choose_frames(request)
            form.widgets["frames"].selected_text = request.frames
            changed()

        form.choice("format", "Format", [label for label, _ in FORMATS.values()], other_format)
        form.choice("frames", "Frames", list(request.ranges), changed)
        if sources:
            form.choice("of", "Splats", sources, changed)
        form.line("seconds", "Seconds")
        form.choice("size", "Size", MOVIE_SIZES)
        form.choice("background", "Background", list(MOVIE_BACKGROUNDS))
        form.output(lambda: self._ask_export(request, sources))
        changed()
        source = "Exports the splats decoded from the stream."
        if sources:
            stale = ", without the latest changes" if self._stale else ""
            source = f"decoded: as played from the stream{stale}.\ntrained: before baking, with all edits."
        options = "Seconds and background apply to movies, size to movies and plates."
        words = (source, options, "Existing files are not overwritten.")
        parts = [form.grid, *map(dialogs.label, words)]
        form.show("export", "Export", parts, ("save", "Export", start), 90, error, "line")

    def report(self) -> None:
        """Write the take's report, or update its marks."""
        window = self._window
        context, take = window.workspace.context, window.workspace.take
        if take is None:
            window.notices.show("A report can only be written for a take, not for a stream.")
        elif context is None or not take.report.is_file() or window.workspace.row("review").state != "done":
            window.workspace.start("review")
            window.views.select("review")
        else:
            with window.notices.reporting("report"):
                changed = update_marks(take, context.groups)
                words = "Updated the marks in the report" if changed else "The report is up to date"
                window.notices.show(f"{words}: {take.report}", path=take.report)
