"""Calibration boards: what they look like, and where their corners are in a picture.

A board's own coordinates are OpenCV's: the origin is the outer corner of the first square, x runs along the columns, y
down the rows, z into the board; meters. Pixels are ours (origin at the image corner; OpenCV's are half a pixel less).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from studio.errors import StudioError

KINDS = ("charuco", "chessboard")
LEAST_CORNERS = 6
"""Views of fewer corners say too little of where the board is."""


@dataclass(frozen=True)
class CalibrationTarget:
    """A flat board of squares.

    Attributes:
        kind: "charuco" (each corner is told by the markers beside it, so that parts of the board are enough) or
            "chessboard" (all corners must be in view).
        columns, rows: squares, not inner corners: a chessboard of 7 x 4 inner corners has 8 x 5 squares.
        square: side of a square in meters, as measured on the print.
        marker: side of a marker in meters; charuco only.
        dictionary: OpenCV's name of the markers' dictionary, as in DICT_4X4_50; charuco only.
        legacy: drawn by OpenCV before 4.6, whose boards of an even number of rows begin with a white square.
        inverted: black and white are exchanged.

    Raises:
        StudioError: a board that cannot be.
    """

    kind: str = "charuco"
    columns: int = 8
    rows: int = 5
    square: float = 0.06
    marker: float = 0.045
    dictionary: str = "DICT_4X4_50"
    legacy: bool = False
    inverted: bool = False

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise StudioError(f"The board '{self.kind}' is unknown; choose one of {', '.join(KINDS)}.")
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 100:
            raise StudioError(f"A board needs 3 to 100 squares each way, found {self.columns} x {self.rows}.")
        if not 0 < self.square < 10:
            raise StudioError(f"The board's squares are {self.square:g} m wide; give meters, as in 0.06 for 60 mm.")
        if self.kind == "charuco":
            if not 0 < self.marker < self.square:
                raise StudioError(
                    f"The board's markers ({self.marker:g} m) must be smaller than its squares ({self.square:g} m)."
                )
            known = _dictionaries()
            if self.dictionary not in known:
                raise StudioError(f"OpenCV has no dictionary '{self.dictionary}'; it has {', '.join(known)}.")
            needed = self.columns * self.rows // 2
            if needed > self.size_of_dictionary:
                raise StudioError(
                    f"A board of {self.columns} x {self.rows} squares needs {needed} markers, {self.dictionary} has "
                    f"{self.size_of_dictionary}; take a larger dictionary."
                )

    @property
    def is_symmetric(self) -> bool:
        """Whether the board looks the same upside down: cameras that see it from two sides then disagree on it."""
        return self.kind == "chessboard" and (self.columns + self.rows) % 2 == 0

    @cached_property
    def corners(self) -> np.ndarray:
        """(N, 3): the inner corners in board coordinates, row by row."""
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * self.square

    @property
    def middle(self) -> np.ndarray:
        """(3,): the board's middle in board coordinates."""
        return np.array([self.columns, self.rows, 0.0]) * self.square / 2

    @property
    def size_of_dictionary(self) -> int:
        """How many markers the dictionary has."""
        return len(self._dictionary.bytesList)

    @property
    def _dictionary(self) -> Any:
        import cv2

        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    @cached_property
    def charuco(self) -> Any:
        """OpenCV's object of a charuco board."""
        import cv2

        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, self._dictionary)
        board.setLegacyPattern(self.legacy)
        return board

    @cached_property
    def _detector(self) -> Any:
        import cv2

        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        return cv2.aruco.CharucoDetector(self.charuco, detectorParams=parameters)

    def detect(self, image: np.ndarray) -> TargetObservation | None:
        """Find the board.

        Args:
            image: (H, W, 3) RGB or (H, W), uint8.

        Returns:
            the corners seen, or None where there are fewer than six, or all on one line.
        """
        import cv2

        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image
        if self.inverted:
            gray = 255 - gray
        view = self._charuco_view(gray) if self.kind == "charuco" else self._chessboard_view(gray)
        if view is None or len(view.ids) < LEAST_CORNERS or view.on_one_line(self):
            return None
        return view

    def _charuco_view(self, gray: np.ndarray) -> TargetObservation | None:
        corners, ids, _, _ = self._detector.detectBoard(gray)
        if ids is None or len(ids) == 0:
            return None
        return TargetObservation(np.ravel(ids).astype(np.int64), np.asarray(corners, np.float64).reshape(-1, 2) + 0.5)

    def _chessboard_view(self, gray: np.ndarray) -> TargetObservation | None:
        import cv2

        across, down = self.columns - 1, self.rows - 1
        longest = max(gray.shape)
        for side in (1000, 2000):  # a board is found several times faster in a small picture
            factor = min(1.0, side / longest)
            if side > 1000 and longest <= 1000:
                return None
            small = gray
            if factor < 1:
                small = cv2.resize(gray, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            # EXHAUSTIVE finds boards that are tilted or in poor light
            flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
            found, corners = cv2.findChessboardCornersSB(small, (across, down), flags=flags)
            if found:
                break
        else:
            return None
        scale = np.array([gray.shape[1] / small.shape[1], gray.shape[0] / small.shape[0]])
        grid = ((np.asarray(corners, np.float64).reshape(-1, 2) + 0.5) * scale - 0.5).reshape(down, across, 2)
        steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
        window = int(np.clip(0.3 * min(steps), 2, 30))
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
        start = grid.reshape(-1, 1, 2).astype(np.float32)
        exact = cv2.cornerSubPix(gray, start, (window, window), (-1, -1), stop)
        grid = np.asarray(exact, np.float64).reshape(down, across, 2)
        right, below = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if right[0] * below[1] - right[1] * below[0] < 0:  # nobody sees a board from behind: the order is mirrored
            grid = grid[:, ::-1]
        if not self.is_symmetric and _is_lighter(gray, grid):
            grid = grid[::-1, ::-1]
        return TargetObservation(np.arange(across * down), grid.reshape(-1, 2) + 0.5)


def _is_lighter(gray: np.ndarray, grid: np.ndarray) -> bool:
    """Whether the square between the first four inner corners, which is black, is the lighter one of two."""

    def mean(part: np.ndarray) -> float:
        center = part.reshape(-1, 2).mean(0)
        inside = center + 0.5 * (part.reshape(-1, 2) - center)
        columns = np.clip(inside[:, 0].round().astype(int), 0, gray.shape[1] - 1)
        rows = np.clip(inside[:, 1].round().astype(int), 0, gray.shape[0] - 1)
        return float(gray[rows, columns].mean())

    return mean(grid[:2, :2]) > mean(grid[:2, 1:3])


@dataclass(frozen=True)
class TargetObservation:
    """A board as one picture shows it.

    Attributes:
        ids: (M,) int64, indices into `CalibrationTarget.corners`.
        pixels: (M, 2) where they are, origin at the image corner.
    """

    ids: np.ndarray
    pixels: np.ndarray

    def on_one_line(self, board: CalibrationTarget) -> bool:
        """Whether the corners seen lie on one line of the board, which fixes no pose."""
        spread = board.corners[self.ids, :2]
        return bool(np.linalg.matrix_rank(spread - spread.mean(0), tol=0.1 * board.square) < 2)

    def keep(self, chosen: np.ndarray) -> TargetObservation:
        """The corners that a boolean array (M,) marks."""
        return TargetObservation(self.ids[chosen], self.pixels[chosen])


def _dictionaries() -> tuple[str, ...]:
    import cv2

    return tuple(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))
