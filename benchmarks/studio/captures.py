"""The captures that the studio renders: who moves, where, and which cameras see it."""

import math
from dataclasses import dataclass, replace

import numpy as np
from rig import Camera, Lens, ring

REDHEAD = {
    "hair": (0.10, 0.035, 0.012), "top": (0.72, 0.69, 0.62), "stripe": (0.02, 0.05, 0.14), "skirt": (0.45, 0.10, 0.05),
    "check": (0.05, 0.10, 0.12), "legs": (0.03, 0.03, 0.045), "shoes": (0.6, 0.58, 0.55),
}  # fmt: skip
BRUNETTE = {
    "hair": (0.025, 0.014, 0.010), "top": (0.05, 0.20, 0.20), "stripe": (0.06, 0.26, 0.24), "skirt": (0.07, 0.09, 0.20),
    "check": (0.30, 0.24, 0.10), "legs": (0.20, 0.05, 0.06), "shoes": (0.05, 0.04, 0.04),
}  # fmt: skip
GRAY = {
    **REDHEAD,
    "top": (0.22, 0.22, 0.22),
    "stripe": (0.2, 0.2, 0.2),
    "skirt": (0.24, 0.24, 0.24),
    "check": (0.2, 0.2, 0.2),
}


@dataclass(frozen=True)
class Capture:
    """A capture that `python benchmarks/studio/render.py NAME FOLDER` renders."""

    about: str
    cameras: tuple[Camera, ...]
    set: str = "room"  # a key of `scene.SETS`
    people: tuple[dict[str, tuple[float, float, float]], ...] = (REDHEAD,)  # colors of each
    ball: bool = False  # thrown through the picture
    frames: int = 30
    fps: float = 25.0
    start: float = 0.24  # time of the first frame, seconds into the dance


def _own(cameras: list[Camera], held_out: tuple[int, ...], seed: int, spread: float = 1.0) -> tuple[Camera, ...]:
    """Cameras whose exposure and color differ a little, as those of one maker do."""
    random = np.random.default_rng(seed)
    return tuple(
        replace(
            camera,
            exposure=float(random.normal(0, 0.05 * spread)),
            white=tuple(float(gain) for gain in np.exp(random.normal(0, 0.015 * spread, 3))),
            held_out=number in held_out,
        )
        for number, camera in enumerate(cameras)
    )


def _room_ring(count: int, **options: object) -> list[Camera]:
    return ring(count, 2.75, (1.05, 1.75, 0.75, 2.25), **options)


def _sample() -> tuple[Camera, ...]:
    """Sixteen cameras, two of them held out: one in the ring, and one that looks down from high above, more than 30
    degrees from every other."""
    cameras = _room_ring(15)
    above = math.radians(66)
    high = Camera("cam15", (1.75 * math.cos(above), 1.75 * math.sin(above), 2.75))
    return _own([*cameras, high], (5, 15), 11)


def _phones() -> tuple[Camera, ...]:
    """Six wide cameras that nobody started together."""
    random = np.random.default_rng(5)
    cameras = ring(
        6, 2.75, (1.3, 1.8), lens=Lens("fisheye", 0.46, (0.03, -0.008, 0.001, 0.0)), shutter=1 / 100, readout=1 / 120
    )
    late = [
        replace(one, offset=float(random.uniform(-0.06, 0.06)), drift=float(random.normal(0, 2e-5))) for one in cameras
    ]
    return _own(late, (), 3, spread=3.0)


def _hall() -> tuple[Camera, ...]:
    """Forty cameras in 4K."""
    cameras = ring(40, 2.75, (0.5, 1.2, 1.9, 2.6), width=3840, height=2160, noise=0.004, crf=18)
    return _own(cameras, (7, 21, 34), 9)


BARREL = Lens("brown", 0.7, (-0.21, 0.06, 0.001, -0.0015, 0.0))
CAPTURES = {
    "sample": Capture("the capture in sample_captures", _sample()),
    "pair": Capture("two people and a ball", _own(_room_ring(16), (5, 12), 11), "room", (REDHEAD, BRUNETTE), ball=True),
    "phones": Capture("six fisheye lenses without genlock, rolling shutter", _phones()),
    "brown": Capture("lenses with strong distortion", _own(_room_ring(12, lens=BARREL), (3, 8), 4)),
    "green": Capture("a green studio, creased and unevenly lit", _own(_room_ring(12), (3, 8), 4), set="green"),
    "floor": Capture("a green floor in the room: contact shadows", _own(_room_ring(12), (3, 8), 4), set="green floor"),
    "gray": Capture("gray clothes before gray walls", _own(_room_ring(12), (3, 8), 4), set="gray", people=(GRAY,)),
    "few": Capture("six cameras", _own(_room_ring(6), (), 4)),
    "hall": Capture("forty cameras in 4K, one frame", _hall(), frames=1),
}  # fmt: skip
