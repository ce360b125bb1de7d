"""Evaluation protocols: which cameras, which pixels, which background, which size."""

import re
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class EvaluationProtocol:
    """The way in which images are compared: names of the cameras (none: those held out); pixels around the bounding box
    of the performer's mask (None: the full frame); RGB, 0 to 1, behind performer and splats (footage without masks
    covers it); scale of the footage's stored size (None: that of the take)."""

    name: str
    title: str
    cameras: tuple[str, ...]
    padding: int | None
    background: tuple[float, float, float]
    scale: float | None


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        EvaluationProtocol(
            "box", "held-out cameras at the take's size, bounding box of the mask padded by 8 px, over black",
            (), 8, (0.0, 0.0, 0.0), None,
        ),
        EvaluationProtocol(
            "hifi4g",
            "camera 48 at half the footage's size, full frame over white, as published for V3 and 4DGCPro on HiFi4G",
            ("48",), None, (1.0, 1.0, 1.0), 0.5,
        ),
        EvaluationProtocol(
            "n3dv",
            "camera cam00 at half the footage's size, full frame, as published for Neural 3D Video; over black where "
            "the capture has masks",
            ("cam00",), None, (0.0, 0.0, 0.0), 0.5,
        ),
    )
}  # fmt: skip
"""Presets by name. The full frame of a performer is mostly background, which everybody gets right: PSNR is higher by
about 10 log10(frame / box) dB than in the box. Compare only figures of one protocol."""


def find_camera(name: str, names: Sequence[str]) -> str | None:
    """The camera of that name, or else the only one with that number (48 finds cam048); None if there is none."""
    if name in names:
        return name
    number = _number(name)
    matches = [] if number is None else [each for each in names if _number(each) == number]
    return matches[0] if len(matches) == 1 else None


def _number(name: str) -> int | None:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else None
