"""PathEditor: the keys of a camera path, kept in the take, with undo."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from v3studio.gui.models.history import Change, History
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.formats.camera_path import EASINGS, CameraPath, Key, read_path_keys, write_path_keys

KEY_SECONDS = 2.0  # seconds of the movie from the last view to one that is added
LEAST_SECONDS = 0.1  # least seconds between two views


class PathEditor:
    """The keys of the take's camera path. Every change is written at once."""

    def __init__(self) -> None:
        self.keys: tuple[Key, ...] = ()  # the views, ordered by time; the first is at 0; with numbers of their frames
        self.selected: int | None = None  # index of the selected view; None for none
        self.error = ""  # why the take's path could not be read, in which case it is never overwritten; "" otherwise
        # of the take's frames. Callers count frames from 0 in the take, the file has their numbers
        self.numbers = FrameNumbers()
        self._file: Path | None = None
        self._history = History()

    def open(self, file: Path | None, history: History) -> None:
        """Read the path of a take; None for a stream, whose path is lost when it is closed."""
        self.keys, self.selected, self.error = (), None, ""
        self._file, self._history = file, history
        if file is None or not file.is_file():
            return
        try:
            self.keys = _from_zero(read_path_keys(file, KEY_SECONDS))
        except StudioError as error:
            self.error = str(error)

    @property
    def duration(self) -> float:
        """Seconds of the movie."""
        return self.keys[-1].time if self.keys else 0.0

    @property
    def frames(self) -> list[int | None]:
        """The frame of each view; None if the take does not have it."""
        return [self.numbers.index(int(key.frame or 0)) for key in self.keys]

    def add(self, camera: Camera, frame: int) -> None:
        """Add a view: after the selected one, in the middle of the time to the next, or at the end."""
        at = len(self.keys) if self.selected is None else self.selected + 1
        if at < len(self.keys):
            time = 0.5 * (self.keys[at - 1].time + self.keys[at].time)
        else:
            time = self.duration + KEY_SECONDS if self.keys else 0.0
        key = Key(time, camera, self.numbers.number(frame), EASINGS[0])
        self._set([*self.keys[:at], key, *self.keys[at:]], "a view of the camera path")
        self.selected = at

    def update(self, index: int, camera: Camera, frame: int) -> None:
        """Give a key another view and frame."""
        self._change(index, "a view of the camera path", camera=camera, frame=self.numbers.number(frame))

    def remove(self, index: int) -> None:
        """Remove a view; the movie begins with the first that is left."""
        left = [*self.keys[:index], *self.keys[index + 1 :]]
        self._set(_from_zero(left), "a removed view of the camera path")
        self.selected = min(index, len(left) - 1) if left else None

    def load(self, keys: Sequence[Key]) -> None:
        """Replace all views by keys with numbers of frames; none: remove them."""
        self._set(_from_zero(keys), "the camera path")
        self.selected = None

    def move(self, index: int, by: int) -> None:
        """Move a view before or behind its neighbors; the times stay where they are."""
        to = index + by
        if not 0 <= to < len(self.keys):
            return
        order = list(self.keys)
        order.insert(to, order.pop(index))
        times = [key.time for key in self.keys]
        self._set([replace(key, time=time) for key, time in zip(order, times, strict=True)], "the order of views")
        self.selected = to

    def set_time(self, index: int, seconds: float) -> None:
        """Set when a view is reached; later ones move by as much. Raises StudioError: not after the view before it."""
        least = self.keys[index - 1].time + LEAST_SECONDS if index else 0.0
        if index == 0 or not least <= seconds <= 3600:
            problem = (
                "the first view is at 0 s"
                if index == 0
                else f"{seconds:g} s is not between {least:.1f} s, after the view before it, and 3600 s"
            )
            raise StudioError("camera_path.times", problem, value=seconds)
        by = seconds - self.keys[index].time
        later = [replace(key, time=key.time + by) for key in self.keys[index:]]
        self._set([*self.keys[:index], *later], "times of the camera path")

    def set_frame(self, index: int, frame: int) -> None:
        """Set the frame that a view shows."""
        number = self.numbers.number(frame)
        if self.keys[index].frame != number:
            self._change(index, "the frame of a view", frame=number)

    def next_easing(self, index: int) -> None:
        """Change how the camera moves on from a view, to the next of `EASINGS`."""
        now = EASINGS.index(self.keys[index].easing)
        self._change(index, "the easing of a view", easing=EASINGS[(now + 1) % len(EASINGS)])

    def path(self, width: int, height: int) -> CameraPath:
        """The path for a size of the movie. Raises StudioError: there are no views, or as `fitted_keys`."""
        return CameraPath(self.fitted_keys(width, height), width, height)

    def fitted_keys(self, width: int, height: int) -> list[Key]:
        """The keys for a size of the movie. Raises StudioError: the take does not have the frame of a view."""
        keys = []
        for number, (key, frame) in enumerate(zip(self.keys, self.frames, strict=True), 1):
            if frame is None:
                problem = f"view {number} of the camera path shows frame {key.frame}, which the take does not have"
                fix = "Drag its diamond on the timeline to another frame, or remove this view."
                raise StudioError("camera_path.frame_missing", problem, value=key.frame, fix=fix)
            keys.append(replace(key, camera=reframed(key.camera, width, height), frame=float(frame)))
        return keys

    def _change(self, index: int, words: str, **values: Any) -> None:
        self._set([*self.keys[:index], replace(self.keys[index], **values), *self.keys[index + 1 :]], words)

    def _set(self, keys: Sequence[Key], words: str) -> None:
        """Write other keys, and note the change for undo. Raises StudioError: the take's path is damaged; OSError."""
        before, now = self.keys, tuple(keys)
        self._write(now)

        def put(keys: tuple[Key, ...]) -> None:
            self._write(keys)
            self.selected = None

        self._history.add(Change(words, partial(put, before), partial(put, now)))

    def _write(self, keys: tuple[Key, ...]) -> None:
        if self.error:
            fix = "Repair or delete the file, then open the take again."
            raise StudioError("camera_path.damaged", self.error, fix=fix)
        if self._file is not None:
            if keys:
                write_path_keys(keys, self._file)
            else:
                self._file.unlink(missing_ok=True)
        self.keys = keys


def _from_zero(keys: Sequence[Key]) -> tuple[Key, ...]:
    """Keys with numbers of frames, the first at 0 seconds."""
    return tuple(replace(key, time=key.time - keys[0].time, frame=int(key.frame or 0)) for key in keys)


def reframed(camera: Camera, width: int, height: int) -> Camera:
    """The view at another image size: same vertical field of view, with the sides cropped or extended."""
    scale = height / camera.height
    K = camera.K.copy()
    K[:2] *= scale
    K[0, 2] += 0.5 * (width - camera.width * scale)
    return Camera(camera.name, width, height, K, camera.world_to_camera)
