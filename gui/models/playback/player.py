"""PlayerPresenter: the state of the playback view. The window polls it at each tick."""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from v3studio.gui.drawing.compare import ALONE, Mode, What
from v3studio.gui.models.playback.frame_renderer import DrawFn, FrameRenderer, Picture, RenderRequest
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.gui.models.playback.other_source import OTHERS, OtherSource
from v3studio.gui.models.playback.sources import Opened, first_whole, open_path, reach_of, take_contents, thinned
from v3studio.gui.models.playback.stream_audio import StreamAudio
from v3studio.gui.models.playback.stream_source import StreamSource
from v3studio.gui.models.playback.transport import Transport
from v3studio.gui.models.playback.viewpoint import BACKGROUNDS, NOTHING_OPEN, Rest, Viewpoint
from v3studio.gui.models.scene.compose import draw
from v3studio.gui.models.scene.contents import Surface
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.scene.reader import SceneReader
from v3studio.gui.models.scene.render import Place
from v3studio.gui.models.stage_rows import message_text
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.pipelines.share.cast_frames import CastFrames
from v3studio.pipelines.takes.results.videos import FALLBACK_FPS
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.playback import LeftOut, SoundDevice

NOTHING_TO_SHOW = "Nothing trained or baked yet. Frames appear here as Train and Bake run."

LONGEST_SHARP = 1.0  # seconds that an image at full resolution may take to draw; the next change waits for it


class PlayerPresenter(Viewpoint):
    """The open take or stream, the transport, the view, the comparison, and the newest image. `read_mesh` reads a mesh
    file; an argument, so that this package does not import Open3D."""

    def __init__(
        self,
        draw_function: DrawFn = draw,
        now: Callable[[], float] = time.monotonic,
        output: Callable[[], SoundDevice] = SoundDevice,
        read_mesh: Callable[[Path], Surface | None] = lambda path: None,
    ) -> None:
        super().__init__()
        self._now = now
        self._output = output
        self._renderer = FrameRenderer(draw_function, SceneReader(read_mesh))
        self._worker: LatestWorker[RenderRequest, Picture] = LatestWorker(self._renderer, "v3studio viewport")
        self._asked: RenderRequest | None = None
        self._wanted: str = What.DECODED  # what was chosen, also while there is no such source, as during a bake
        self._shown: deque[float] = deque(maxlen=240)  # when the last images came
        self.contents: tuple[object, ...] = ()  # changes when frames of the open take are trained or baked
        self.filmed_groups: Sequence[int] = ()  # first frame of each group of the footage; empty if unknown
        self.wipe = 0.5
        self.transport = Transport(1, FALLBACK_FPS, now=now)
        self.picture: Picture | None = None
        self.on_screen = True  # whether the viewport shows the player
        self.audio: StreamAudio | None = None  # the sound of the open stream; None if it has none
        self._left_out: tuple[int, str] | None = None
        self._problem = ""  # with what was wanted last
        self._rest = Rest(now)
        self.still = False
        self._sharp: bool | None = None
        self.em = 16.0
        # points of the world that marks are about, by frame counted from 0
        self.places: Mapping[int, tuple[float, float, float]] = {}

    @property
    def message(self) -> str:
        """Text over the image, for as long as its cause lasts; "" if all is well."""
        if self._problem or self.opened is None:
            return self._problem or NOTHING_OPEN
        return self.opened.message or ("" if self.opened.sources else NOTHING_TO_SHOW)

    # The open take or stream

    def adopt(self, opened: Opened, first: Gaussians | None) -> None:
        """Show the result of `load`."""
        self._close_sources(*self.others)
        self._renderer.forget()
        self.opened, self.others, self.context = opened, [], None
        self._load_sound()
        self.contents = take_contents(opened.take) if opened.take else ()
        self.mode, self.camera = Mode.SCENE if opened.cast is not None else Mode.SINGLE, ""
        self.what = self._wanted = opened.default.name if opened.default is not None else What.DECODED
        self.transport = Transport(1, FALLBACK_FPS, now=self._now)
        self.transport.numbers = opened.numbers
        self.span_source()
        self.transport.seek(self.transport.group_starts[0])  # the first that there is
        self._look_home(first)
        self.picture = None
        self._asked = self._left_out = None
        self._problem = ""

    @property
    def other(self) -> OtherSource | None:
        """The other bake or take that comparisons are against; None if there is none."""
        return self.others[0] if self.others else None

    @property
    def shown_other(self) -> OtherSource | None:
        """The other bake or take if it alone is on screen, so that figures and exports are its."""
        return self.other if self.what == What.OTHER and self.mode in ALONE else None

    def compare_with(self, other: OtherSource | None) -> None:
        """Compare with another bake or take, in a wipe unless another comparison is on screen; None to stop. Side by
        side also shows those compared with before, as many as there are `OTHERS`."""
        opened = self.opened
        if opened is None or opened.default is None:
            if other is not None:
                other.close()
            return
        before = self.others
        kept = [source for source in before if other is not None and source.label != other.label][: len(OTHERS) - 1]
        self.others = [*([other] if other is not None else []), *kept]
        self._span_others()
        self._renderer.forget()
        self._asked = None
        if self.what not in (*self.sources, What.FOOTAGE):
            self.what = self._wanted = opened.default.name
        if other is None and self.mode not in ALONE and len(self.sources) < 2 and not self.camera:
            self.mode = Mode.SINGLE
        for source in before:
            if source not in kept:
                source.close()
        self.span_source()
        if other is not None and self.mode in ALONE:
            self.choose_mode(Mode.WIPE)

    def refresh(self) -> bool:
        """Load frames trained and streams baked since opening; True if there were any."""
        if self.opened is None or self.opened.take is None:
            return False
        contents = take_contents(self.opened.take)
        if contents == self.contents:
            return False
        try:
            opened = open_path(self.opened.path)
            first = first_whole(opened.default) if opened.default is not None and not self.opened.sources else None
        except StudioError as error:  # being written; the next refresh will succeed
            self._problem = message_text(error)
            return False
        self.contents = contents
        was_empty = not self.opened.sources
        opened.reach = reach_of(opened) if was_empty else self.opened.reach
        self._close_sources()
        self.opened = opened
        self._span_others()
        self._load_sound()
        self._renderer.forget()
        self._asked = None
        there = (*self.sources, *([What.FOOTAGE] if self.camera else []))
        if self._wanted in there:
            self.what = self._wanted
        elif self.what not in there and opened.default is not None:
            self.what = opened.default.name
        self.span_source()
        if was_empty and first is not None:
            self._look_home(first)
        self._problem = ""
        return True

    def _span_others(self) -> None:
        """Give what is compared with the frames of the open take or stream."""
        base = self.opened.default if self.opened is not None else None
        if base is not None:
            for other in self.others:
                other.span(base)

    def _look_home(self, first: Gaussians | None) -> None:
        assert self.opened is not None
        self.home = OrbitCamera(up=self.opened.up)
        self.points = np.zeros((0, 3))
        if first is not None:
            self.points = np.concatenate([thinned(first), self.opened.reach])
            self.home = OrbitCamera.showing(self.points, self.opened.up, self.opened.view)
        self.orbit = self.home

    def _load_sound(self) -> None:
        """Begin to load the sound of the stream that was opened."""
        volume = self.audio.volume if self.audio is not None else 1.0
        self.audio = None
        decoded = self.opened.sources.get(What.DECODED) if self.opened is not None else None
        if isinstance(decoded, StreamSource | CastFrames) and decoded.has_sound:
            self.audio = StreamAudio(decoded, self._output())
            self.audio.volume = volume

    def _follow_sound(self) -> None:
        """Let the frames follow the sound where they are those of the stream."""
        audio, transport = self.audio, self.transport
        fits = audio is not None and (audio.frame_count, audio.fps) == (transport.frame_count, transport.fps)
        transport.follow(audio.player if audio is not None and fits else None)

    def span(self, frame_count: int, group_starts: Sequence[int], fps: float) -> bool:
        """Set the transport's range; returns whether it changed."""
        now = self.transport
        if (now.frame_count, now.group_starts, now.fps) == (frame_count, tuple(group_starts), fps):
            return False
        now.resize(frame_count, group_starts, fps)
        return True

    def span_source(self) -> bool:
        """Set the transport's range to the current source; returns whether it changed."""
        source = self.source
        return source is not None and self.span(source.frame_count, source.group_starts, source.fps)

    def choose(self, what: str) -> bool:
        """Show one of `What` at the same frame; False, and `refused`, if it is unavailable."""
        what = What(what)
        why = self.why_not(what)
        if why:
            self.refused.emit(why)
            return False
        if what == What.FOOTAGE and not self.camera:
            self.look_through(self.camera_names[0])
        self.what = self._wanted = what
        self.span_source()
        return True

    def exchange(self) -> bool:
        """Show the stream, or if it is on screen what comparisons are against (A and B)."""
        default = self.opened.default if self.opened is not None else None
        self.choose_mode(Mode.SINGLE)
        return self.choose(default.name if default is not None and self.what != default.name else self.reference)

    def choose_mode(self, mode: str) -> bool:
        """Choose one of `Mode`; False, and `refused`, if there is nothing to compare."""
        mode = Mode(mode)
        if mode == Mode.SINGLE:
            self.mode = mode
            self._fit_zoom()
            return True
        if self.opened is None or not self.opened.sources:
            self.refused.emit(NOTHING_TO_SHOW)
            return False
        if mode != Mode.SCENE and len(self.sources) < 2 and not self.camera:
            why = self.why_not(What.FOOTAGE)
            if why:
                self.refused.emit(f"Nothing to compare with. {why}")
                return False
            self.look_through(self.camera_names[0])
        if self.what == What.FOOTAGE and self.opened.default is not None:
            self.what = self._wanted = self.opened.default.name
        self.mode = mode
        self._zoom_follows |= mode != Mode.SCENE and self.camera != "" and self.image_zoom == ImageZoom()
        self._fit_zoom()
        return True

    def grabs(self, x: float, _y: float) -> bool:
        """Whether a pixel of the image is on the wipe's line, within 14 pixels."""
        if self.picture is None or not self.mode == self.picture.request.mode == Mode.WIPE:
            return False
        return abs(x - (self.picture.box.x + self.wipe * self.picture.box.width)) < 14

    def pull(self, x: float, _y: float) -> None:
        """Move the wipe's line to a pixel of the image."""
        if self.picture is not None:
            self.wipe = min(max((x - self.picture.box.x) / max(self.picture.box.width, 1), 0.0), 1.0)

    def release(self) -> None:
        """The wipe's line stays where it is."""

    def toggle_sound(self) -> None:
        if self.audio is None:
            self.refused.emit("This take or stream has no sound.")
        else:
            self.audio.volume = 0.0 if self.audio.volume else 1.0

    # Images

    def poll(self) -> Picture | None:
        """Request the current frame and return a new image if there is one. Call at each tick; never blocks."""
        self._follow_sound()
        if self.opened is not None and self.source is not None:
            request = self._request()
            assert request is not None
            if self._asked is None or request.key != self._asked.key:
                self._asked = request
                self._worker.ask(request)
        done = self._worker.take()
        picture = self._received(done) if done is not None else None
        if self._left_out is not None and (self.picture is None or not self.transport.playing):
            self._problem = f"Frame {self.transport.number(self._left_out[0])}: {self._left_out[1]}"
        return picture

    def _request(self) -> RenderRequest | None:
        """The image that is wanted now; None if there is nothing to show."""
        opened, frame = self.opened, self.transport.frame
        if opened is None or self.source is None:
            return None
        return RenderRequest(
            take=opened.take, context=self.context, rig=opened.rig, cast=opened.cast, sources=self.sources,
            frame=frame, number=self.transport.number(frame) if self.transport.numbers.known else None,
            group=opened.group(frame, self.filmed_groups), place=self.places.get(frame),
            mode=self.mode, what=self.what, reference=self.reference, camera=self.camera, parts=self.scene_parts,
            orbit=self.orbit, home=self.home, image_zoom=self.image_zoom, up=opened.up, points=self.points,
            size=self.size, shape=self.shape if self.mode == Mode.SIDE_BY_SIDE else 1.0, wipe=self.wipe,
            background=BACKGROUNDS[self.background], still=self.still, em=self.em,
        )  # fmt: skip

    @property
    def scene_places(self) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
        """Name and (N, 2) pixels of the frusta in the scene's image, and of the view axes, the front ones last."""
        return (self.picture.cameras, self.picture.ends) if self.picture is not None else ((), ())

    def rests(self, full: tuple[int, int]) -> bool:
        """Whether the view has rested long enough for an image at full resolution, `full`. Call at each tick. That an
        image takes long must not keep the next change waiting: from the time that the present one took, it is decided
        once per rest whether there will be one. A scene always gets one."""
        view = (
            self.mode, self.orbit.key, self.camera, self.image_zoom, self.what, self.reference, self.wipe,
            self.background, self.scene_parts, self.frame,
        )  # fmt: skip
        rests = self._rest.rests(view, self.transport.playing)
        self.still = rests and self.mode == Mode.SCENE
        if not rests:
            self._sharp = None
        elif self._sharp is None and self.picture is not None and self.current and self.settled:
            height, width = self.picture.image.shape[:2]
            larger = full[0] * full[1] / (width * height)
            self._sharp = self.picture.draw_seconds * larger < LONGEST_SHARP
        return self.still or bool(self._sharp)

    @property
    def label(self) -> object:
        """The subject of the wanted image, apart from frame and view; None if there is nothing to show."""
        request = self._request()
        return request.label if request is not None else None

    @property
    def current(self) -> bool:
        """Whether the newest image has the wanted sources, comparison and camera, and when paused the wanted frame."""
        request = self._request()
        if self.picture is None or request is None or self.picture.request.label != request.label:
            return False
        return self.transport.playing or self.picture.request.frame == request.frame

    @property
    def frame(self) -> int:
        """The frame that the window's numbers and plots refer to: during playback that of the newest image."""
        if self.on_screen and self.transport.playing and self.picture is not None and self.current:
            return min(self.picture.request.frame, self.transport.last)
        return self.transport.frame

    @property
    def left_out(self) -> list[str]:
        """Messages about damaged groups that playback skipped."""
        sources = self.sources.values()
        return [str(group) for source in sources if isinstance(source, StreamSource) for group in source.skipped]

    def show_again(self) -> None:
        """Request the image again at the next poll, because the viewport has shown something else."""
        self._asked = None

    def _received(self, done: Done[RenderRequest, Picture]) -> Picture | None:
        if done.request.sources != self.sources:
            return None  # from a source that has been closed
        if isinstance(done.error, LeftOut):
            # as in video players, the last image stays on screen and playback continues
            self._left_out = (done.request.frame, str(done.error))
            return None
        if done.error is not None:
            what = message_text(done.error) if isinstance(done.error, StudioError) else repr(done.error)
            self._problem = f"Frame {self.transport.number(done.request.frame)}: {what}"
            self.transport.pause()
            return None
        wanted = self._request()
        if wanted is not None and done.request.label != wanted.label:
            return None  # the user has chosen something else meanwhile
        self.picture, self._left_out, self._problem = done.result, None, ""
        self._shown.append(self._now())
        return self.picture

    @property
    def doing(self) -> str:
        """Return what is being done while an image is awaited."""
        request = self._request()
        return "finding the masks of this frame" if request and What.FOOTAGE in request.names else "rendering"

    @property
    def settled(self) -> bool:
        """Whether the newest image shows what was last requested."""
        return self._worker.idle

    @property
    def rate(self) -> float:
        """Pictures per second over the last two seconds."""
        recent = [shown for shown in self._shown if shown >= self._now() - 2.0]
        return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0

    @property
    def behind(self) -> bool:
        """Whether playback renders fewer frames per second than it should."""
        transport = self.transport
        return transport.playing and self.rate < 0.95 * transport.fps * transport.speed

    @property
    def status(self) -> str:
        """Status line for the newest image: what neither the panels nor the pressed buttons say."""
        if self.picture is None or self.source is None:
            return ""
        other = self.other
        parts = [other.label] if self.what == What.OTHER and self.mode == Mode.SINGLE and other is not None else []
        if not self.current:
            parts.append("not shown" if self.settled else self.doing)
        count = len(self.left_out)
        if count:
            parts.append(f"{count} damaged group{'s' * (count != 1)} skipped")
        if self.audio is not None and self.audio.message:
            parts.append(self.audio.message)
        return "   ".join(parts)

    def close(self) -> bool:
        """End the thread and close files. Returns whether the thread ended in time."""
        ended = self._worker.close()
        self._close_sources(*self.others)
        self._renderer.forget()
        self.picture = self._asked = None
        return ended

    def _close_sources(self, *others: OtherSource) -> None:
        if self.audio is not None:
            self.transport.follow(None)
            self.audio.close()
        if self.opened is not None:
            self.opened.close()
        for other in others:
            other.close()
