import pytest

from v3studio.gui.platform import screen


@pytest.mark.parametrize(
    ("resources", "scale"),
    [
        ("", 1.0),
        ("Xft.dpi:\t192\n", 2.0),
        ("Xcursor.size: 48\nXft.dpi: 144.0\nXft.hinting: 1\n", 1.5),
        ("Xft.dpi: 72", 1.0),  # never smaller than the default font size
        ("Xft.dpi: 1.2.3", 1.0),
        ("MyXft.dpi: 192", 1.0),
    ],
)
def test_scale_is_read_from_the_resources(resources: str, scale: float) -> None:
    assert screen.scale_of(resources) == scale


@pytest.mark.parametrize(
    ("width", "height", "dpi", "expected"),
    [
        (1920, 1080, 96, (1280, 800)),
        (3840, 2160, 192, (2560, 1600)),
        (2560, 1600, 192, (2432, 1520)),  # no larger than the screen
        (1024, 768, 96, (1280, 800)),  # the requested size is kept
    ],
)
def test_windows_grow_with_letters(
    monkeypatch: pytest.MonkeyPatch, width: int, height: int, dpi: int, expected: tuple[int, int]
) -> None:
    monkeypatch.setattr(screen, "current_screen", lambda: (width, height, f"Xft.dpi: {dpi}"))
    assert screen.fitting_size((1280, 800)) == expected
