"""Follows a part of the performer that was marked in one frame to the others."""

from collections.abc import Callable, Sequence

import numpy as np

from v3studio.studio.edits.edit_list import DetailMark
from v3studio.studio.errors import StudioError

EVERY = 4  # frames between two points of a path


def follow(
    means_at: Callable[[int], np.ndarray],
    groups: Sequence[range],
    frame: int,
    center: np.ndarray,
    radius: float,
    weight: float,
) -> DetailMark:
    """Follow the splats inside of a ball, in world units, through the frames of a take.

    Within a group, the ball moves by the median of what its splats move. At the border between two groups, which have
    different splats, it continues at the same speed. Where no splats are in it any more, it is not followed further.
    The path has `frame`, the first and last frame of each group, and every `EVERY`th frame between. `means_at` gives
    the (N, 3) means of a frame, counted from 0 in the take; groups are without gaps.
    """
    number = next((at for at, group in enumerate(groups) if frame in group), None)
    if number is None or not len(inside := _inside(means_at(frame), center, radius)):
        raise StudioError(
            "edits.nothing_there",
            f"there are no splats within {radius:.4g} of ({', '.join(f'{value:.4g}' for value in center)}) in this "
            "frame",
            fix="Mark a place on the performer, in a trained frame, or with a larger radius.",
        )
    path: dict[int, np.ndarray] = {frame: np.asarray(center, np.float64)}
    for step in (1, -1):
        members, here, at = inside, frame, number
        while True:
            last = groups[at][-1] if step > 0 else groups[at][0]
            for there in (*range(here, last, step * EVERY), last):
                path[there] = path[here] + _moved(means_at, members, here, there)
            at += step
            if not 0 <= at < len(groups):
                break
            following = last + step
            before = min(max(last - step, groups[at - step][0]), groups[at - step][-1])
            expected = path[last] + _moved(means_at, members, before, last)
            members = _inside(means_at(following), expected, radius)
            if not len(members):
                break
            path[following], here = expected, following
    return DetailMark(
        radius=radius,
        weight=weight,
        path=tuple((frame_number, tuple(path[frame_number].round(6).tolist())) for frame_number in sorted(path)),
    )


def _inside(means: np.ndarray, center: np.ndarray, radius: float) -> np.ndarray:
    return np.flatnonzero(np.linalg.norm(means - center, axis=1) <= radius)


def _moved(means_at: Callable[[int], np.ndarray], members: np.ndarray, start: int, end: int) -> np.ndarray:
    """(3,) how far splats of a group move from one of its frames to another."""
    if start == end:
        return np.zeros(3)
    moved: np.ndarray = np.median(means_at(end)[members] - means_at(start)[members], axis=0)
    return moved.astype(np.float64)
