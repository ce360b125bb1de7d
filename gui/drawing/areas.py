"""Areas: what can be clicked in an image."""

from typing import Generic, TypeVar

Box = tuple[float, float, float, float]  # x, y, width, height in pixels

T = TypeVar("T")


class Areas(Generic[T]):
    """Parts of an image that can be clicked. `all`: rectangles and their values; later ones are in front."""

    def __init__(self) -> None:
        self.all: list[tuple[Box, T]] = []

    def add(self, box: Box, what: T) -> None:
        self.all.append((box, what))

    def at(self, x: float, y: float) -> T | None:
        """The value at a position; None if there is none."""
        for (left, top, width, height), what in reversed(self.all):
            if left <= x < left + width and top <= y < top + height:
                return what
        return None

    def middles(self, size: tuple[int, int]) -> dict[T, list[float]]:
        """The middle of each, 0 to 1 across and down an image of a size (width, height)."""
        return {
            what: [round((x + width / 2) / size[0], 3), round((y + height / 2) / size[1], 3)]
            for (x, y, width, height), what in self.all
        }
