"""The source of an export: a take, or a stream in a folder, in a file or at a URL, opened once."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.export import DEFAULT_OF
from v3studio.pipelines.takes.frames.frame_numbers import trained_numbers
from v3studio.pipelines.takes.results.videos import (
    capture_place,
    decoded_video,
    footage_cameras,
    is_take,
    open_reader,
    stream_numbers,
    trained_video,
)
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from v3studio.studio.audio import Pcm
    from v3studio.studio.cameras import Camera
    from v3studio.studio.splat_video import SplatVideo
    from v3studio.studio.stream import StreamReader


class Source:
    """A context manager, which closes what it has opened. `place`: folder, file or URL.

    `of`, here and below: "decoded", the frames of the stream; "trained", those of the take; "set": what is behind them;
    None: `DEFAULT_OF`.
    """

    def __init__(self, place: str) -> None:
        self.place = place
        self._opened = ExitStack()

    def __enter__(self) -> Source:
        return self

    def __exit__(self, *error: object) -> None:
        self._opened.close()

    @cached_property
    def take(self) -> Take | None:
        """The take; None for a stream alone."""
        return Take.open(Path(self.place).expanduser()) if is_take(self.place) else None

    @cached_property
    def reader(self) -> StreamReader:
        """The stream. StudioError: a take without one (`take.no_stream`), or as `open_reader`."""
        if self.take is not None and not self.take.has_stream:
            fix = "Run `v3studio bake`, or export trained frames with --of trained."
            raise StudioError("take.no_stream", "this take has no stream yet", file=self.place, fix=fix, stage="bake")
        return self._opened.enter_context(open_reader(self.place))

    def video(self, of: str | None) -> SplatVideo:
        """The frames, with their numbers in the footage. StudioError as `reader` and `trained_video`."""
        if of == "set":
            return self._set()
        if (of or DEFAULT_OF) == "decoded":
            return replace(decoded_video(self.reader), numbers=stream_numbers(self.place, self.reader).known)
        if self.take is None:
            problem, fix = "--of trained needs a take", "Remove --of."
            raise StudioError("command.invalid_option", problem, file=self.place, value=of, fix=fix, option="--of")
        return trained_video(self.take.root)

    def _set(self) -> SplatVideo:
        """The set as a video of one frame. StudioError: there is none (`export.no_set`), or as `video`."""
        of = None if self.take is None or self.take.has_stream else "trained"
        video = self.video(of)
        splats = video.behind()
        if splats is None:
            problem, fix = "there are no splats of a set", "Run `v3studio set` and `v3studio bake`, or remove --of."
            raise StudioError("export.no_set", problem, file=self.place, fix=fix, option="--of")
        return replace(video, frame_count=1, group_starts=(0,), read=lambda _: splats, numbers=(), sound=None)

    def sound(self, of: str | None, video: SplatVideo) -> Pcm | None:
        """The sound of the stream, also for trained frames; None if it has none, or was baked for later frames."""
        if of == "set" or (self.take is not None and not self.take.has_stream):
            return None
        sound = self.reader.sound()
        if sound is None:
            return None
        self._opened.callback(sound.close)
        if of != "trained" or self.take is None:
            return sound
        from v3studio.studio.audio.pcm import part_of

        early = (trained_numbers(self.take).index(video.number(0)) or 0) - capture_place(self.reader).first_frame
        if early == 0 and video.frame_count == self.reader.frame_count:
            return sound
        return None if early < 0 else part_of(sound, early / video.fps, video.duration)

    def cameras(self, of: str | None) -> tuple[Camera, ...]:
        """The cameras of the take's footage in the world of the splats; () if they are not known."""
        return footage_cameras(self.place, decoded=of != "trained")
