"""The window's title tells how far a run is."""

from __future__ import annotations

from types import SimpleNamespace

from gui.overlays import window_title


def workspace(stage: str = "", fraction: float | None = None, paused: bool = False) -> SimpleNamespace:
    progress = None if fraction is None else SimpleNamespace(fraction=fraction)
    return SimpleNamespace(busy=stage != "", run=SimpleNamespace(stage=stage, progress=progress), paused=paused)


def test_titles() -> None:
    found = [
        window_title(name, space, queued)  # type: ignore[arg-type]
        for name, space, queued in (
            ("walk", workspace(), None),
            ("", workspace(), None),
            ("walk", workspace("train", 0.379), None),
            ("walk", workspace("train"), None),
            ("walk", workspace("train", 0.5, paused=True), None),
            ("", workspace(), ("night", "bake", 0.05)),
            ("", workspace(), ("night", "", None)),
            ("walk", workspace("train", 0.5), ("night", "bake", 0.05)),
        )
    ]
    assert found == [
        "walk - V3 Studio",
        "V3 Studio",
        "37% train - walk - V3 Studio",
        "train - walk - V3 Studio",
        "50% train, paused - walk - V3 Studio",
        "5% bake - night - V3 Studio",
        "night - V3 Studio",
        "50% train - walk - V3 Studio",
    ]
