"""Masks corrected by hand: clicks say what is the performer and what is not, in one frame of one camera.

GrabCut finds the part that was meant, `cut_part`. The part is carried to `REACH` frames before and after with optical
flow, and to the other cameras through space: along each of its rays, it is where most training cameras see the
performer. There, it is a hint where GrabCut starts, as clicks are.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.masks.filters import largest_channel, reduced, touching
from v3studio.studio.memory_cache import MemoryCache

REACH = 5
"""Frames before and after, to which a correction is carried."""
_SIDE = 640
"""Longest side, in pixels, of the images in which parts are found."""
_WINDOW = 0.2
"""Distance from a click, in sides of the image, up to which masks may change."""
_DOT = 0.006
"""Radius of a click, in sides of the image."""
_NEAR = 0.03
"""Distance from a carried hint, in sides of the image, up to which masks may change."""
_LEAK = 1.6
"""A carried part is at most so many times as large as its hint, or it is the hint."""
_FEWEST = 6
"""Pixels that a hint must change, below which a mask stays as it is."""
_DEPTHS = 160
_AGREED = 0.6
"""Share of the cameras that must see the performer where a part is in space."""
_COLOR = 30.0
"""Difference of colors, 0 to 255, below which another camera sees the removed part, not what is before it."""
_STILL = 1.5
"""Pixels by which flow forth and back may differ."""

_Pixel = Annotated[float, Field(ge=0, le=100_000)]


class MaskClick(BaseModel):
    """A click that corrects the mask of a camera and frame; an edit of a take."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    camera: str = Field(min_length=1, max_length=200)
    frame: int = Field(ge=0, le=10_000_000)  # its number in the footage

    at: tuple[_Pixel, _Pixel]
    """Column and row in pixels of the footage; 0, 0 is the upper left corner of the image."""

    performer: bool = True  # whether it is on the performer; else, on what is not the performer


class Parts(NamedTuple):
    """Pixels that are added to a mask and removed from it, (h, w) bool each."""

    added: np.ndarray
    removed: np.ndarray


class _InSpace(NamedTuple):
    """A part in space: points (N, 3), some of its colors (M, 3), and its area across the view, in squared units."""

    points: np.ndarray
    colors: np.ndarray
    size: float


class Corrections:
    """The corrections of a footage's masks.

    Attributes:
        clicks: which are applied to masks of their camera, and, if the cameras are known and theirs is for training,
            carried to the others.
    """

    def __init__(
        self, clicks: Sequence[MaskClick], frames: Sequence[int], image: Callable[[str, int], np.ndarray],
        mask: Callable[[str, int], np.ndarray], cameras: Mapping[str, Camera], voters: Sequence[str],
    ) -> None:  # fmt: skip
        """`image`, `mask`: of a camera and frame, (H, W, 3) and (H, W) uint8, as the clicks found them; `cameras`: of
        these images, by name; empty before calibration. `voters`: names of the training cameras."""
        self.clicks = tuple(clicks)
        self._frames, self._image, self._mask, self._voters = tuple(frames), image, mask, tuple(voters)
        self._cameras = cameras
        self._small: MemoryCache[tuple[str, int], tuple[np.ndarray, np.ndarray]] = MemoryCache(
            128 << 20, lambda pair: pair[0].nbytes + pair[1].nbytes
        )
        self._parts: MemoryCache[tuple[str, int, int], Parts] = MemoryCache(200)
        self._hints: MemoryCache[tuple[str, int, int], tuple[_InSpace, _InSpace]] = MemoryCache(200)
        self._index = {frame: index for index, frame in enumerate(self._frames)}

    def corrected(self, camera: str, frame: int, mask: np.ndarray) -> np.ndarray:
        """The mask (H, W) uint8 of a camera and frame with all corrections; itself if there are none. Raises
        StudioError: an image or a mask that is needed cannot be read."""
        import cv2

        if frame not in self._index:
            return mask
        away = {
            (click.camera, click.frame): abs(self._index[click.frame] - self._index[frame])
            for click in self.clicks
            if click.frame in self._index
        }
        near = [at for at, frames in away.items() if frames <= REACH]
        for at in sorted(near, key=lambda at: (at[0] == camera, -away[at])):  # the nearest ones last, to stay
            for part, value in zip(self._parts_in(camera, frame, at), (255, 0), strict=True):
                if part.any():
                    share = cv2.resize(part.astype(np.float32), mask.shape[::-1], interpolation=cv2.INTER_LINEAR)
                    mask = np.rint(share * value + (1 - share) * mask).astype(np.uint8)
        return mask

    def _parts_in(self, camera: str, frame: int, at: tuple[str, int]) -> Parts:
        """The parts that the clicks at a camera and frame change in another."""
        if camera == at[0]:
            return self._tracked(camera, frame, at[1])
        image, mask = self._pair(camera, frame)
        nothing = Parts(*np.zeros((2, *mask.shape), bool))
        if not {camera, at[0]} <= self._cameras.keys() or at[0] not in self._voters:
            return nothing
        hints, most = [], []
        for points, colors, size in self._in_space(at, frame):
            own = self._sized(camera, mask)
            places, depth = own.project(points)
            hint = _dots(mask.shape, places, depth)
            most.append(_LEAK * size * (own.fx / np.median(depth)) ** 2 if len(depth) else 0.0)
            if hint.any():  # others of its pixels show what is before or behind the part
                hint[hint] = np.abs(image[hint].astype(np.float32)[:, None] - colors[None]).mean(2).min(1) < _COLOR
            hints.append(hint)
        return carried(image, mask, Parts(*hints), most)

    def _tracked(self, camera: str, frame: int, start: int) -> Parts:
        """The parts of the clicks at a camera and frame `start`, in another frame of this camera."""
        image, mask = self._pair(camera, frame)
        if frame == start:
            return self._parts.get_or_make((camera, frame, start), lambda _: self._clicked(camera, frame))
        step = 1 if frame < start else -1  # back towards the clicks
        before = self._frames[self._index[frame] + step]

        def follow(_: object) -> Parts:
            earlier = self._tracked(camera, before, start)
            hints = Parts(*_moved(self._pair(camera, before)[0], image, earlier))
            return carried(image, mask, hints, [_LEAK * part.sum() for part in hints])

        return self._parts.get_or_make((camera, frame, start), follow)

    def _clicked(self, camera: str, frame: int) -> Parts:
        image, mask = self._pair(camera, frame)
        scale, radius = mask.shape[1] / self._image(camera, frame).shape[1], max(1.0, _DOT * max(mask.shape))
        rows, columns = np.mgrid[: mask.shape[0], : mask.shape[1]] + 0.5
        hints, likely = (Parts(*np.zeros((2, *mask.shape), bool)) for _ in range(2))
        for click in self.clicks:
            if (click.camera, click.frame) == (camera, frame):
                x, y = scale * np.array(click.at)
                dot = np.hypot(columns - x, rows - y) <= radius
                kind = 0 if click.performer else 1
                np.logical_or(hints[kind], dot, out=hints[kind])
                np.logical_or(likely[kind], _patch(image, dot), out=likely[kind])
        return cut_part(image, mask, hints, likely)

    def _in_space(self, at: tuple[str, int], frame: int) -> tuple[_InSpace, _InSpace]:
        """The added and the removed part of the clicks at a camera and frame, in another frame."""

        def find(_: object) -> tuple[_InSpace, _InSpace]:
            camera = at[0]
            image, mask = self._pair(camera, frame)
            added, removed = self._tracked(camera, frame, at[1])
            own = self._sized(camera, mask)

            def placed(part: np.ndarray, beside: np.ndarray | None) -> _InSpace:
                points = self._points(camera, frame, _inside(part), beside)
                depth = float(np.median(own.project(points)[1])) if len(points) else 0.0
                return _InSpace(points, _colors(image, part), float(part.sum()) * (depth / own.fx) ** 2)

            return placed(added, (mask > 127) & ~removed), placed(removed, None)

        return self._hints.get_or_make((*at, frame), find)

    def _points(self, camera: str, frame: int, part: np.ndarray, beside: np.ndarray | None) -> np.ndarray:
        """(N, 3) places of the pixels of a part. Where the cameras do not agree, since they lack it, too, it is as far
        away as what is `beside` it; None: it has no place."""
        import cv2

        own = self._sized(camera, part)
        reach = 2 * round(_WINDOW * max(part.shape) / 4) + 1
        count, numbers = cv2.connectedComponents(part.astype(np.uint8))
        places = [np.zeros((0, 3))]
        for number in range(1, count):
            pixels = _some(numbers == number)
            depths, share = self._depths(own, frame, pixels)
            sure = share >= _AGREED
            if sure.mean() < 0.5 and beside is not None:
                around = cv2.dilate((numbers == number).astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
                others, agreed = self._depths(own, frame, _some(beside & around))
                if (agreed >= _AGREED).any():
                    beside_it = float(np.median(others[agreed >= _AGREED]))
                    depths[:], sure[:] = self._depth(own, frame, pixels, beside_it), True
            places.append(own.center + own.ray_directions(pixels[sure]) * depths[sure, None])
        return np.concatenate(places)

    def _depth(self, own: Camera, frame: int, pixels: np.ndarray, near: float) -> float:
        """The distance, around `near`, at which a part that all cameras lack has the same colors in the cameras that
        see it best, and is closest to their masks."""
        import cv2

        steps = near * np.linspace(0.75, 1.25, 41)
        rows, columns = pixels.astype(int).T[::-1]
        colors = cv2.blur(self._pair(own.name, frame)[0], (3, 3))[rows, columns].astype(np.float32)
        points = own.center + own.ray_directions(pixels)[None] * steps[:, None, None]
        costs = []
        for name in self._others(own.name):
            image, mask = self._pair(name, frame)
            places, depth = self._sized(name, mask).project(points.reshape(-1, 3))
            inside = _seen(places, depth, mask.shape)
            column, row = places[inside].astype(int).T
            away = cv2.distanceTransform((mask <= 127).astype(np.uint8), cv2.DIST_L2, 3)
            cost = np.full(len(inside), 2.0)
            apart = np.abs(cv2.blur(image, (3, 3))[row, column] - np.tile(colors, (len(steps), 1))[inside]).mean(1)
            cost[inside] = np.minimum(apart / _COLOR, 1) + np.minimum(
                away[row, column] / (_DOT * 6 * max(mask.shape)), 1
            )
            costs.append(cost.reshape(len(steps), -1).mean(1))
        if not costs:
            return near
        best = np.sort(costs, axis=0)[: max(2, len(costs) // 2)]
        return float(steps[int(np.argmin(best.mean(0)))])

    def _others(self, camera: str) -> list[str]:
        return [name for name in self._voters if name != camera and name in self._cameras]

    def _depths(self, own: Camera, frame: int, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances along the rays of pixels where most other training cameras see the performer, and the share of
        those that do, (N,) each."""
        rig = Rig(tuple(self._cameras[name] for name in self._voters if name in self._cameras))
        away = float(np.linalg.norm(own.center - rig.focus))
        steps = np.linspace(0.15, 1.85, _DEPTHS) * away
        points = own.center + own.ray_directions(pixels)[:, None] * steps[:, None]
        votes, seen = np.zeros(points.shape[:2]), np.zeros(points.shape[:2])
        for name in self._others(own.name):
            mask = self._pair(name, frame)[1]
            places, depth = self._sized(name, mask).project(points.reshape(-1, 3))
            inside = _seen(places, depth, mask.shape)
            column, row = places[inside].astype(int).T
            hit = np.zeros(len(inside))
            hit[inside] = mask[row, column] > 127
            votes += hit.reshape(votes.shape)
            seen += inside.reshape(seen.shape)
        share = np.where(seen >= 2, votes / np.maximum(seen, 1), 0.0)
        best = share.max(1)
        most = (share >= best[:, None] - 0.02) & (best[:, None] > 0)  # the middle of where they agree
        return (most * steps).sum(1) / np.maximum(most.sum(1), 1), best

    def _sized(self, camera: str, image: np.ndarray) -> Camera:
        return self._cameras[camera].resized(image.shape[1], image.shape[0])

    def _pair(self, camera: str, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Image and uncorrected mask at reduced size."""

        def read(_: object) -> tuple[np.ndarray, np.ndarray]:
            return reduced(self._image(camera, frame), _SIDE), reduced(self._mask(camera, frame), _SIDE)

        return self._small.get_or_make((camera, frame), read)


def cut_part(image: np.ndarray, mask: np.ndarray, hints: Parts, likely: Parts | None = None) -> Parts:
    """What the hints mean, pixels that belong to the performer and that do not: the parts that a mask lacks and that it
    has too much, connected to them. `image`: (h, w, 3) uint8 RGB; `mask`: (h, w) uint8; `likely`: what may mean the
    same as the hints, from which colors are learned."""
    import cv2

    every, before = hints.added | hints.removed, mask > 127
    result = before.copy()
    if every.any():
        reach = round(_WINDOW * max(mask.shape))
        left, top, width, height = cv2.boundingRect(every.astype(np.uint8))
        place = slice(max(top - reach, 0), top + height + reach), slice(max(left - reach, 0), left + width + reach)
        labels = np.where(before, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
        if likely is not None:
            labels[likely.added], labels[likely.removed] = cv2.GC_PR_FGD, cv2.GC_PR_BGD
        labels[hints.added], labels[hints.removed] = cv2.GC_FGD, cv2.GC_BGD
        part, pixels = np.ascontiguousarray(labels[place]), np.ascontiguousarray(image[place])
        if 10 < (part & 1).sum() < part.size - 10:
            cv2.setRNGSeed(0)
            models = np.zeros((1, 65)), np.zeros((1, 65))
            cv2.grabCut(pixels, part, (0, 0, 1, 1), *models, 3, cv2.GC_INIT_WITH_MASK)
            result[place] = (part & 1) > 0
    result = (result | hints.added) & ~hints.removed
    added = touching(result & ~before, hints.added)
    return Parts(added, touching(before & ~result, hints.removed))


def carried(image: np.ndarray, mask: np.ndarray, hints: Parts, most: Sequence[float]) -> Parts:
    """What carried hints change: as `cut_part`, but nothing where a mask is already as they say or far from the hints,
    and no more than the hints where that would be more than `most` pixels."""
    import cv2

    changed = hints.added & (mask <= 127), hints.removed & (mask > 127)
    wanted = [part if part.sum() >= _FEWEST else np.zeros_like(part) for part in changed]
    if not np.any(wanted):
        return Parts(*wanted)
    cores, reach = Parts(*map(_inside, wanted)), 2 * round(_NEAR * max(mask.shape)) + 1
    near = [cv2.dilate(part.astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0 for part in wanted]
    likely = Parts(*(_patch(image, core) & around for core, around in zip(cores, near, strict=True)))
    parts = [part & around for part, around in zip(cut_part(image, mask, cores, likely), near, strict=True)]
    return Parts(
        *(part if part.sum() <= limit else hint for part, hint, limit in zip(parts, wanted, most, strict=True))
    )


def _patch(image: np.ndarray, dot: np.ndarray) -> np.ndarray:
    """The pixels around a dot with its color: of several tolerances, with the largest that keeps it a patch."""
    import cv2

    if not dot.any():
        return dot
    blurred = cv2.GaussianBlur(image, (3, 3), 0).astype(np.float32)
    apart = largest_channel(np.abs(blurred - np.median(image[dot], axis=0)))
    for tolerance in (40, 28, 20, 14):
        patch = touching((apart < tolerance) | dot, dot)
        if patch.sum() < (_WINDOW * max(dot.shape)) ** 2:
            return patch
    return dot


def _colors(image: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(N, 3) float32: about a hundred colors of a part."""
    return image[part].astype(np.float32)[:: max(1, int(part.sum()) // 100)]


def _inside(part: np.ndarray) -> np.ndarray:
    """The part without its edge, which may be wrong by a pixel; itself if it is thin."""
    import cv2

    core = cv2.erode(part.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return core if core.any() else part


def _some(part: np.ndarray) -> np.ndarray:
    """(N, 2) centers of at most 400 pixels of a part."""
    rows, columns = np.nonzero(part)
    step = max(1, len(rows) // 400)
    return np.stack([columns, rows], 1)[::step] + 0.5


def _dots(shape: tuple[int, ...], places: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels on projected points, and between neighbors."""
    import cv2

    image = np.zeros(shape, np.uint8)
    columns, rows = places[_seen(places, depth, shape)].astype(int).T
    image[rows, columns] = 1
    return cv2.morphologyEx(image, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8)) > 0


def _seen(places: np.ndarray, depth: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(N,) bool: whether projected points are within an image of this shape."""
    return np.asarray((depth > 0) & (places >= 0).all(1) & (places < (shape[1], shape[0])).all(1))


def _moved(before: np.ndarray, after: np.ndarray, parts: Parts) -> tuple[np.ndarray, ...]:
    """The parts of an image in another one, by optical flow, without pixels whose flow does not lead back."""
    import cv2

    finder = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    old, new = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (before, after))
    back, forth = finder.calc(new, old, None), finder.calc(old, new, None)  # type: ignore[call-overload]
    rows, columns = np.mgrid[: old.shape[0], : old.shape[1]].astype(np.float32)
    x, y = columns + back[..., 0], rows + back[..., 1]
    home = np.linalg.norm(cv2.remap(forth, x, y, cv2.INTER_LINEAR) + back, axis=-1) < _STILL
    return tuple((cv2.remap(part.astype(np.float32), x, y, cv2.INTER_LINEAR) > 0.5) & home for part in parts)
