"""Exports: `v3studio export` as a child process, and the camera path that views are collected for."""

from __future__ import annotations

import contextlib
import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from gui.presenters.jobs import ChildProcess, v3studio_command
from pipelines.cancel import EXIT_CANCELLED
from pipelines.files import remove, write_json
from studio.cameras import Camera
from studio.errors import StudioError

FORMATS: dict[str, tuple[str, str]] = {
    "ply": ("PLY, a file a frame", ""),
    "spz": ("SPZ, a file a frame", ""),
    "glb": ("GLB, a file a frame", ""),
    "videogs": ("VideoGS layout", ""),
    "turntable": ("Movie: turntable", ".mp4"),
    "camera-path": ("Movie: along the camera path", ".mp4"),
}
"""What can be written: words, and the ending of the file (folders have none)."""

KEY_SECONDS = 2.0
"""Seconds of the movie from one collected view to the next."""

MOVIE_SIZE = (1280, 720)


@dataclass(frozen=True)
class PathKey:
    """A view that was collected: the camera, and the frame that was shown."""

    camera: Camera
    frame: int


@dataclass
class Exports:
    """One export at a time.

    Attributes:
        keys: views collected for a camera path.
        words: how far the export is; "" where none runs.
        result: what came of the last one, a sentence to be shown once.
        failed: whether that is an error.
    """

    keys: list[PathKey] = field(default_factory=list)
    words: str = ""
    result: str = ""
    failed: bool = False
    _process: ChildProcess | None = None
    _target: Path | None = None
    _stopping: bool = False

    @property
    def running(self) -> bool:
        """Whether one is at work."""
        return self._process is not None

    def start(self, kind: str, source: str, of: str, target: Path) -> None:
        """Begin.

        Args:
            kind: of `FORMATS`.
            source: take, stream or address.
            of: "trained" or "decoded"; "" for a bare stream.
            target: file or folder to write; it must not exist yet.

        Raises:
            StudioError: one runs already, or the path has no views, or the target is there.
        """
        if self._process is not None:
            raise StudioError("An export runs already; wait for it or stop it (menu Export).")
        if target.exists():
            raise StudioError(f"{target} is there already; nothing is overwritten, so choose another name.")
        command = [*v3studio_command(), "export", source, "--format", kind, "--out", str(target), "--json"]
        if of:
            command += ["--of", of]
        scratch = Path(tempfile.mkdtemp(prefix="v3studio-export-"))
        if kind == "camera-path":
            command += ["--path", str(self._write_path(scratch)), "--size", f"{MOVIE_SIZE[0]}x{MOVIE_SIZE[1]}"]
        self._process = ChildProcess(command, scratch / "errors.txt", scratch)
        self._target, self._stopping = target, False
        self.words, self.result = f"export {kind}: starting", ""

    def _write_path(self, folder: Path) -> Path:
        from studio.export import Key, path_to_json

        if len(self.keys) < 2:
            raise StudioError("A camera path needs two views or more; collect them with K, then export again.")
        keys = [
            Key(number * KEY_SECONDS, fitted(key.camera, *MOVIE_SIZE), float(key.frame))
            for number, key in enumerate(self.keys)
        ]
        path = folder / "path.json"
        write_json(path, path_to_json(keys))
        return path

    def poll(self) -> bool:
        """Take in what the process has told; returns whether something changed."""
        process = self._process
        if process is None:
            return False
        before = self.words
        for line in process.take_lines():
            with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError):
                told = json.loads(line)
                if told["kind"] == "progress":
                    self.words = f"{told['what']}: {told['done']} of {told['total']}"
        status = process.status
        if status is None:
            return self.words != before
        self._process, self.words = None, ""
        self.failed = status not in (0, EXIT_CANCELLED)
        last = process.last_words().strip().splitlines()[-1:] or [f"it ended with status {status}"]
        remove(process.errors.parent)
        if status == 0:
            self.result = f"Written: {self._target}"
        elif self._stopping or status == EXIT_CANCELLED:
            self.result, self.failed = "The export was stopped; nothing was left behind.", False
        else:
            self.result = f"The export failed: {last[0].removeprefix('error: ')}"
        return True

    def stop(self) -> None:
        """Ask it to end; what is half written is removed."""
        if self._process is not None:
            self._stopping = True
            self._process.cancel()


def fitted(camera: Camera, width: int, height: int) -> Camera:
    """The view in a picture of another size and shape: as high as before, the sides cut or widened."""
    scale = height / camera.height
    K = camera.K.copy()
    K[:2] *= scale
    K[0, 2] += 0.5 * (width - camera.width * scale)
    return Camera(camera.name, width, height, K, camera.world_to_camera)
