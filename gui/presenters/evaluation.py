"""The figures of evaluation.json, as `v3studio evaluate` wrote them: nothing is measured here."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipelines.takes.atomic_files import read_json
from pipelines.takes.take import Take
from studio.errors import StudioError

MEASURES = ("psnr_trained", "psnr_decoded", "ssim_trained", "ssim_decoded", "lpips_trained", "lpips_decoded")


class EvaluationFile:
    """Tells when a take's evaluation.json is another one."""

    def __init__(self) -> None:
        self._seen: object = None

    def changed(self, take: Take | None, frame_count: int) -> bool:
        """True at first, and whenever the file, the take or the number of frames has changed since."""
        stamp = None
        if take is not None:
            stamp = (take.root, take.evaluation.stat().st_mtime_ns if take.evaluation.is_file() else 0)
        before, self._seen = self._seen, (stamp, frame_count)
        return before != self._seen


@dataclass(frozen=True)
class Evaluation:
    """What was measured, by frame counted from 0.

    Attributes:
        rows: index to the frame's row of evaluation.json.
        summary, protocol: as there.
        error: a sentence where the file is damaged.
    """

    rows: dict[int, dict[str, Any]] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    protocol: dict[str, Any] = field(default_factory=dict)
    error: str = ""

    @classmethod
    def read(cls, path: Path) -> Evaluation:
        """Of a take; empty where nothing was measured yet."""
        if not path.is_file():
            return cls()
        try:
            found = read_json(path)
            rows = {int(row["index"]): row for row in found["frames"]}
            return cls(rows, found["summary"], found["protocol"])
        except StudioError as error:
            return cls(error=str(error))
        except (KeyError, TypeError, ValueError):
            return cls(error=f"{path}: is not what `v3studio evaluate` writes; run it again.")

    def figures(self, frame: int, camera: str = "") -> tuple[dict[str, float], str]:
        """PSNR, SSIM and (where measured) LPIPS of a frame and whose they are: the camera's own where it was measured,
        else the mean over the measured cameras ("mean of 2 cameras"); ({}, "") where the frame was not measured."""
        row = self.rows.get(frame)
        if row is None:
            return {}, ""
        cameras = row.get("cameras", {})
        if camera in cameras:
            return {name: cameras[camera][name] for name in MEASURES if name in cameras[camera]}, camera
        count = len(cameras)
        return {name: row[name] for name in MEASURES if name in row}, f"mean of {count} camera{'s' * (count != 1)}"

    @property
    def mean(self) -> str:
        """Over which cameras a frame's figures are the mean, in two words."""
        return "held-out mean" if self.protocol.get("held_out", True) else "training mean"

    @property
    def explanation(self) -> str:
        """What the strips over the timeline show; "" where nothing was measured."""
        if not self.rows:
            return ""
        cameras = ", ".join(map(str, self.protocol.get("cameras", ())))
        kind = "held-out" if self.protocol.get("held_out", True) else "training"
        return (
            f"PSNR in dB, higher is better: the mean over the {kind} cameras {cameras}.\n"
            "KB a frame: 1000 bytes; the files of the frame's group, divided by its frames.\n"
            "The numbers on the left are those of the frame that is shown. Click or drag to go to another one."
        )

    def series(self, name: str, frame_count: int) -> list[float | None]:
        """One figure over all frames; None where it was not measured."""
        return [self.rows[frame].get(name) if frame in self.rows else None for frame in range(frame_count)]
