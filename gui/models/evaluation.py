"""Quality figures from evaluation.json, which `v3studio evaluate` writes. Nothing is measured here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipelines.takes.evaluation import FrameQuality, read_evaluation
from pipelines.takes.take import Take
from studio.comparison.metrics import MAIN
from studio.errors import StudioError


class EvaluationFile:
    """Detects changes of a take's evaluation.json."""

    def __init__(self) -> None:
        self._seen: object = None

    def changed(self, take: Take | None, frame_count: int, camera: str = "", other: object = None) -> bool:
        """True on the first call, and if the file, the take or its bake, the number of frames, the camera or what it is
        compared with has changed since the last."""
        stamp = None
        if take is not None:
            files = (take.evaluation, take.record("bake"))
            stamp = (take.root, *(path.stat().st_mtime_ns if path.is_file() else 0 for path in files))
        before, self._seen = self._seen, (stamp, frame_count, camera, other)
        return before != self._seen


@dataclass(frozen=True)
class Evaluation:
    """Figures of all evaluated frames.

    Attributes:
        frames: figures by frame, counted from 0.
        cameras: the evaluated cameras.
        held_out: whether they were held out; if not, they are training cameras.
        error: message if the file is damaged; "" otherwise.
        stale: whether an earlier bake was evaluated, not the one that is there.
    """

    frames: Mapping[int, FrameQuality] = field(default_factory=dict)
    cameras: tuple[str, ...] = ()
    held_out: bool = True
    error: str = ""
    stale: bool = False

    @classmethod
    def read(cls, path: Path, stale: bool = False) -> Evaluation:
        """Read evaluation.json; empty if there is no such file."""
        if not path.is_file():
            return cls()
        try:
            found = read_evaluation(path)
        except StudioError as error:
            return cls(error=str(error))
        frames = {row.index: row for row in found.frames}
        return cls(frames, found.protocol.cameras, found.protocol.held_out, stale=stale)

    def figures(self, frame: int, camera: str = "") -> tuple[Mapping[str, float], str]:
        """PSNR, SSIM and, if measured, LPIPS of a frame, and what they refer to, as in `whose`; ({}, "") if the frame
        was not evaluated."""
        quality = self.frames.get(frame)
        if quality is None:
            return {}, ""
        return quality.cameras.get(camera, quality).measures, self.whose(camera)

    def worst(self, count: int) -> list[tuple[float, int, str]]:
        """Main metric of the decoded frame, frame, and camera, the worst first, `count` at most."""
        name = f"{MAIN.name}_decoded"
        found = [
            (getattr(measured, name), frame, camera)
            for frame, quality in self.frames.items()
            for camera, measured in quality.cameras.items()
        ]
        return sorted(found)[:count]

    def whose(self, camera: str = "") -> str:
        """What figures refer to, for a title: "camera cam05" if it was evaluated, else "mean of held-out cameras";
        "mean" if nothing was evaluated."""
        if self.stale:  # more would not fit
            return f"{self.whose_briefly(camera)} bake"
        if camera in self.cameras:
            return f"camera {camera}"
        return f"mean of {'held-out' if self.held_out else 'training'} cameras" if self.frames else "mean"

    def whose_briefly(self, camera: str = "") -> str:
        """The same in fewer words: "cam05" or "held-out mean"."""
        earlier = ", earlier" if self.stale else ""
        if camera in self.cameras:
            return f"{camera}{earlier}"
        if not self.frames:
            return "mean"
        return f"{'held-out' if self.held_out else 'training'} mean{earlier}"

    @property
    def explanation(self) -> str:
        """What the plots above the timeline show; "" if nothing was evaluated."""
        if not self.frames:
            return ""
        kind = "held-out" if self.held_out else "training"
        return (
            f"PSNR in dB, higher is better: mean over the {kind} cameras {', '.join(self.cameras)}.\n"
            "KB per frame (1 KB = 1000 bytes): size of the frame's group divided by its number of frames.\n"
            "Flicker: change of the error from the frame before, in levels of 255; lower is better.\n"
            "The numbers on the left are for the current frame. Click or drag to seek."
        )

    def series(self, name: str, frame_count: int, camera: str = "") -> list[float | None]:
        """A metric, "bytes" or "flicker" (of all cameras), for every frame; None where not measured.

        Args:
            name: the metric.
            frame_count: number of frames.
            camera: an evaluated camera; "" for the mean.
        """
        found: list[float | None] = []
        for frame in range(frame_count):
            quality = self.frames.get(frame)
            if quality is not None and camera and name not in ("bytes", "flicker"):
                found.append(getattr(quality.cameras.get(camera), name, None))
            else:
                found.append(getattr(quality, name, None))
        return found
