"""Quality figures from evaluation.json, which `v3studio evaluate` writes. Nothing is measured here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from v3studio.gui.models.stage_rows import message_text
from v3studio.pipelines.takes.results.evaluation import FrameQuality, MaskCheck, Quality, read_evaluation
from v3studio.studio.comparison.metrics import MAIN
from v3studio.studio.counts import listed
from v3studio.studio.errors import StudioError

DECODED = f"{MAIN.name}_decoded"


@dataclass(frozen=True)
class WorstFrame:
    """A decoded frame, counted from 0, as a camera sees it. `value`: the main metric; `measures`: all, by name."""

    value: float
    frame: int
    camera: str
    measures: Mapping[str, float]


@dataclass(frozen=True)
class Evaluation:
    """Figures of all evaluated frames."""

    frames: Mapping[int, FrameQuality] = field(default_factory=dict)  # figures by frame, counted from 0
    cameras: Mapping[str, Quality] = field(default_factory=dict)
    held_out: bool = True  # whether they were held out; if not, they are training cameras
    error: str = ""  # message if the file is damaged; "" otherwise
    # whether an earlier bake was evaluated: not the one that is there, or not the take as it is set now
    stale: bool = False
    of: str = ""  # name of another bake or take whose figures they are; "" for the open one
    masks: MaskCheck | None = None

    @classmethod
    def read(cls, path: Path, stale: bool = False) -> Evaluation:
        """Read evaluation.json; empty if there is no such file."""
        if not path.is_file():
            return cls()
        try:
            evaluation = read_evaluation(path)
        except StudioError as error:
            return cls(error=message_text(error))
        frames = {row.index: row for row in evaluation.frames}
        return cls(frames, evaluation.cameras, evaluation.protocol.held_out, stale=stale, masks=evaluation.masks)

    def figures(self, frame: int, camera: str = "") -> tuple[Mapping[str, float], str]:
        """PSNR, SSIM and, if measured, LPIPS of a frame, and whose they are (`whose`); ({}, "") if not evaluated."""
        quality = self.frames.get(frame)
        if quality is None:
            return {}, ""
        return quality.cameras.get(camera, quality).measures, self.whose(camera)

    def wrong_masks(self, frame: int) -> tuple[str, list[tuple[str, str]]]:
        """A sentence on masks that contradict the footage, "" if none does; and those of a frame, counted from 0, as
        camera and kind, and share of the performer's area."""
        if self.masks is None or not self.masks.words:
            return "", []
        number = self.frames[frame].frame if frame in self.frames else None
        rows = [
            (f"{each.camera}, {each.kind}", f"{each.share:.0%} of the performer")
            for each in self.masks.contradictions
            if each.frame == number
        ]
        return f"{self.masks.words[:1].upper()}{self.masks.words[1:]}.", rows

    def worst(self, count: int | None = None) -> list[WorstFrame]:
        """Decoded frames as cameras see them, the worst first, `count` at most."""
        frames = [
            WorstFrame(measured.measures[DECODED], frame, camera, measured.measures)
            for frame, quality in self.frames.items()
            for camera, measured in quality.cameras.items()
        ]
        return sorted(frames, key=lambda shown: (shown.value, shown.frame, shown.camera))[:count]

    def worst_by_camera(self) -> list[WorstFrame]:
        """The worst frame of each camera, the worst first."""
        by_camera: dict[str, WorstFrame] = {}
        for worst in self.worst():
            by_camera.setdefault(worst.camera, worst)
        return list(by_camera.values())

    def mean(self, camera: str, what: str = "decoded") -> float | None:
        """The main metric of a camera, "trained" or "decoded", mean over the frames; None if it was not measured."""
        return getattr(self.cameras.get(camera), f"{MAIN.name}_{what}", None)

    @property
    def kind(self) -> str:
        """The kind of the measured cameras: "held-out" or "training"."""
        return "held-out" if self.held_out else "training"

    def whose(self, camera: str, briefly: bool = False) -> str:
        """Words for what figures refer to: "camera cam05" if it was evaluated, else "mean of held-out cameras";
        "mean" if nothing was evaluated. In few words: "cam05" or "held-out mean"."""
        of_camera = camera in self.cameras
        if of_camera:
            words, few = f"camera {camera}", f"camera {camera}" if camera.isdecimal() else camera
        else:
            words, few = (f"mean of {self.kind} cameras", f"{self.kind} mean") if self.frames else ("mean", "mean")
        if self.of:
            return self.of if briefly else f"{self.of}, {words}"
        if self.stale:  # more would not fit
            return f"{few if of_camera else 'mean'}, earlier" if briefly else f"{few}, earlier bake"
        return few if briefly else words

    @property
    def explanation(self) -> str:
        """An explanation of the plots above the timeline; "" if nothing was evaluated."""
        if not self.frames:
            return ""
        return (
            f"PSNR in dB, higher is better: mean over the {self.kind} cameras {listed(list(self.cameras))}.\n"
            "KB per frame (1 KB = 1000 bytes): size of the frame's group divided by its number of frames.\n"
            "Flicker: change of the error from the frame before, in levels of 255; lower is better.\n"
            "The numbers on the left are for the current frame. Click or drag to seek."
        )

    def series(self, name: str, frame_count: int, camera: str = "") -> list[float | None]:
        """A metric, "bytes" or "flicker" of every frame, of a camera, else the mean; None where not measured."""
        rows: list[FrameQuality | Quality | None] = [self.frames.get(frame) for frame in range(frame_count)]
        if camera in self.cameras and name not in ("bytes", "flicker"):
            rows = [row.cameras.get(camera) if isinstance(row, FrameQuality) else None for row in rows]
        return [getattr(row, name, None) for row in rows]
