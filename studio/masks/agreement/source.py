"""Masks on which all cameras agree: evidence of each image, votes of the cameras in space, outlines in each image.

For each frame, with all cameras at once and at reduced size:

1. `evidence` gives log-odds of each image from the empty set and motion. A matting model adds its own (`people`), once
   votes at half the size have found the people. At the end, what the model sees in most cameras is part of the
   performer, even where a set that shows a performer who stands still has outvoted it.
2. `vote` finds for each pixel what the other cameras say about the space behind it. A threshold separates performer
   from set: the one at which votes and evidence agree best.
3. Both, and `outlines.color_odds`, give new log-odds. Steps 2 and 3 are repeated; GrabCut finds the outlines in the
   last rounds. The next votes are mainly from the evidence, and only the last ones from what was found.

A set that was estimated from the footage is first estimated again, outside of the masks of a few frames (`empty_set`),
which are found in the same way at half the size.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.capture.digest import digest_files
from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.agreement.empty_set import cover, uncovered
from v3studio.studio.masks.agreement.evidence import LIMIT, evidence_of, smoothed
from v3studio.studio.masks.agreement.outlines import BINS, color_odds, cut
from v3studio.studio.masks.agreement.people import odds_of_people
from v3studio.studio.masks.agreement.vote import heard
from v3studio.studio.masks.clean_plate import Background, match_exposure, solve_edges
from v3studio.studio.masks.filters import brightness, color_bins, enlarged, keep_components, reduced
from v3studio.studio.masks.mask_cache import cached_mask
from v3studio.studio.masks.mask_source import MaskInputs, MaskSource, evenly_spaced
from v3studio.studio.masks.matting_model import MattingModel, load_model
from v3studio.studio.masks.median_background import background_cache, cached_background
from v3studio.studio.masks.plates import PlateMaskSource, open_clean_plate, open_median_background, shown
from v3studio.studio.memory_cache import MemoryCache

FEWEST_CAMERAS = 6
"""Fewer cannot outvote one."""
_WORK_SIDE, _COARSE_SIDE = 640, 320
"""Longest side of the images at which cameras are compared, and where the set is estimated again."""
SET_FRAMES, _SET_PASSES = 5, 2
"""Frames outside of whose masks the set is estimated again, and how often."""
_NEIGHBORS = (-8, -4, 4, 8)
"""Frames in which motion is searched, relative to a frame."""
_ROUNDS, _COARSE_ROUNDS, _CUTS = 5, 4, 2
"""Rounds of votes, also at half the size, and the last ones, after which outlines are cut."""
_HEARD, _COLORS = 2.0, 0.5
"""Weights of the votes and of colors, against the evidence."""
_IN_COLOR = 1.5
"""Weight of colors that occur in the set only, in the lowest log-odds of a camera's own evidence."""
_CUT, _UNCUT = 1.5, 0.5
"""Log-odds of an outline's inside (and, negative, outside) in the votes after it was cut, and the weight of the
log-odds before the cut."""
_LEARNED = 0.3
"""Share of the agreement in a camera's next vote, except the last ones. The rest is the camera's own evidence:
otherwise, parts that too many cameras miss would shrink in each round."""
_VOTE_LIMIT = 2.0
"""Log-odds of one camera's next vote are clipped to this."""
_SEEN = 0.6
"""Votes on a matting model's log-odds alone, above which what it sees is the performer."""
_KEPT_FRAMES = 4
_KEPT_BYTES = 256 << 20
_SMALLEST = 1e-4  # component, in fractions of the image
_VERSION = 6  # of the algorithm; part of the names of cached files


class AgreedMaskSource(MaskSource):
    """A `MaskSource` whose masks all cameras agree on, by votes in rounds (described at the top of this file).
    `plates`: the empty set of each camera, `estimated` from the footage or not; `model`: its masks of people are part
    of the evidence; `recipes`: digests of all inputs of masks and of sets, for the disk cache."""

    def __init__(
        self,
        inputs: MaskInputs,
        cameras: Mapping[str, Camera],
        plates: PlateMaskSource,
        model: MattingModel | None,
        estimated: bool,
        recipes: tuple[str, str],
    ) -> None:
        self._inputs, self._cameras, self._plates, self._model, self._recipes = inputs, cameras, plates, model, recipes
        common = sorted(set.intersection(*(set(source.frames) for source in inputs.sources.values())))
        self._set_frames = evenly_spaced(common, SET_FRAMES)
        self._estimated = estimated and bool(common)
        self._voters = frozenset(inputs.names) - frozenset(inputs.held_out)
        self._small: MemoryCache[tuple[str, int, int], np.ndarray] = MemoryCache(
            _KEPT_BYTES, lambda image: image.nbytes
        )
        self._agreed: MemoryCache[int, dict[str, np.ndarray]] = MemoryCache(_KEPT_FRAMES)
        self._sets = background_cache()
        self._small_sets: MemoryCache[str, Background] = MemoryCache(math.inf)
        self._covers: MemoryCache[None, list[dict[str, np.ndarray]]] = MemoryCache(math.inf)

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError: a camera's image or plate cannot be read."""
        image = np.ascontiguousarray(image[:, :, :3])

        def make() -> np.ndarray:
            return self._outlined(camera, image, self._agreed.get_or_make(frame, self.agree)[camera])

        return cached_mask(self._inputs.cache_folder, f"agreed {self._recipes[0]} {frame}", image, make)

    def files(self) -> list[Path]:
        return self._plates.files() + (self._model.files() if self._model else [])

    def plate(self, camera: str) -> np.ndarray:
        return shown(self.background(camera))

    def background(self, camera: str) -> Background:
        """The set of `camera`, in raw pixels; if it was estimated, from where the cameras agree that it is empty."""
        if not self._estimated:
            return self._plates.background(camera)
        return self._sets.get_or_make(camera, self._emptied)

    def _emptied(self, camera: str) -> Background:
        def make() -> Background:
            return self._uncovered(camera, self._covers.get_or_make(None, self._cover))

        return cached_background(self._inputs.cache_folder, _digest(self._recipes[1], camera), make)

    def _uncovered(self, camera: str, covers: Sequence[Mapping[str, np.ndarray]]) -> Background:
        images = [self._inputs.image(camera, frame) for frame in self._set_frames]
        return uncovered(self._plates.background(camera), images, [by_camera[camera] for by_camera in covers])

    def _cover(self, _: None) -> list[dict[str, np.ndarray]]:
        """Areas where the performer may be, (h, w) bool, by camera, for each frame of the set."""
        names = self._inputs.names
        sets = {name: self._plates.background(name) for name in names}
        covers: list[dict[str, np.ndarray]] = []
        for number in range(_SET_PASSES):
            if number:
                sets = {name: self._uncovered(name, covers) for name in names}
            coarse = {name: _reduced_background(behind, _COARSE_SIDE) for name, behind in sets.items()}
            covers = []
            for frame in self._set_frames:
                solid = self._vote(frame, coarse, _COARSE_SIDE, _COARSE_ROUNDS, {})
                covers.append({name: cover(mask) for name, mask in solid.items()})
        return covers

    def evidence(self, camera: str, frame: int) -> np.ndarray:
        """(h, w) float32 log-odds from this camera's images alone, without a model, at reduced size."""
        return self._evidence(camera, frame, _reduced_background(self.background(camera)), _WORK_SIDE)

    def _evidence(
        self, camera: str, frame: int, behind: Background, side: int, people: np.ndarray | None = None
    ) -> np.ndarray:
        known = self._inputs.sources[camera].frames
        near = [frame + step for step in _NEIGHBORS if frame + step in known]
        image = self._image(camera, frame, side)
        odds = evidence_of(image, [self._image(camera, neighbor, side) for neighbor in near], behind, self._inputs.spec)
        return self._allowed(camera, frame, odds if people is None else np.clip(odds + people, -LIMIT, LIMIT), side)

    def _people(self, camera: str, frame: int, solid: np.ndarray) -> np.ndarray:
        """(h, w) float32 log-odds of the model; `solid`: roughly where the performer is."""
        assert self._model is not None
        odds = odds_of_people(self._inputs.image(camera, frame), solid, self._model)
        return self._allowed(camera, frame, reduced(odds, _WORK_SIDE), _WORK_SIDE)

    def _allowed(self, camera: str, frame: int, odds: np.ndarray, side: int) -> np.ndarray:
        """Log-odds, the lowest where the garbage mask excludes the performer."""
        if self._inputs.garbage is None:
            return odds
        inside = self._inputs.inside(camera, frame, self._inputs.image(camera, frame))
        return odds if inside is None else np.where(reduced(inside.astype(np.float32), side) > 0.5, odds, -LIMIT)

    def agree(self, frame: int) -> dict[str, np.ndarray]:
        """Areas in which all cameras together see the performer, (h, w) bool at reduced size, by camera."""

        def small(name: str) -> Background:
            return _reduced_background(self.background(name))

        sets = {name: self._small_sets.get_or_make(name, small) for name in self._inputs.names}
        if self._model is None:
            return self._vote(frame, sets, _WORK_SIDE, _ROUNDS, {})
        coarse = {name: _reduced_background(behind, _COARSE_SIDE) for name, behind in sets.items()}
        rough = self._vote(frame, coarse, _COARSE_SIDE, _COARSE_ROUNDS, {})
        with ThreadPoolExecutor(self._inputs.threads or None, thread_name_prefix="masks") as pool:
            odds = pool.map(lambda name: self._people(name, frame, rough[name]), rough)
            people = dict(zip(rough, odds, strict=True))
        solid = self._vote(frame, sets, _WORK_SIDE, _ROUNDS, people)
        votes = heard(people, self._sized(people), self._voters)
        return {name: mask | ((votes[name] > _SEEN) & (people[name] > 0)) for name, mask in solid.items()}

    def _sized(self, images: Mapping[str, np.ndarray]) -> dict[str, Camera]:
        """The cameras of images (h, w, ...) of any size."""
        return {name: self._cameras[name].resized(image.shape[1], image.shape[0]) for name, image in images.items()}

    def _vote(
        self, frame: int, sets: Mapping[str, Background], side: int, rounds: int, people: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Areas that the cameras vote for, (h, w) bool, by camera. `people`: a model's log-odds, by camera; empty:
        there is no model."""
        with ThreadPoolExecutor(self._inputs.threads or None, thread_name_prefix="masks") as pool:

            def each(function: Callable[..., np.ndarray], *mappings: Mapping[str, Any]) -> dict[str, np.ndarray]:
                arguments = [[by_camera[name] for name in names] for by_camera in mappings]
                return dict(zip(names, pool.map(function, *arguments), strict=True))

            names = self._inputs.names
            own_name = {name: name for name in names}
            images = each(lambda name: self._image(name, frame, side), own_name)
            own = each(lambda name, behind: self._evidence(name, frame, behind, side, people.get(name)), own_name, sets)
            grays = each(brightness, images)
            bins = each(partial(color_bins, bins=BINS), images)
            cameras = self._sized(images)
            voting, colors = own, {name: np.zeros_like(odds) for name, odds in own.items()}
            solid: dict[str, np.ndarray] = {}
            agreed = any(behind.agreed is not None for behind in sets.values())
            for turn in range(rounds):
                votes = heard(voting, cameras, self._voters)
                threshold = best_threshold(votes, voting)
                others = {name: _HEARD * (votes[name] - threshold) + _COLORS * colors[name] for name in names}
                alone = each(_in_color, own, colors) if agreed else own
                odds = each(lambda gray, mine, theirs: smoothed(gray, mine + theirs), grays, alone, others)
                if turn >= rounds - _CUTS:
                    solid = each(cut, images, odds, colors)
                    if turn == rounds - 1:
                        break
                    odds = each(_after_cut, odds, solid)
                shared = np.concatenate([bins[name][odds[name] > 2.0] for name in names])
                colors = each(partial(color_odds, shared=shared), bins, odds)
                voting = odds if turn == rounds - 2 else each(_next_vote, own, odds)
        return solid

    def _image(self, camera: str, frame: int, side: int) -> np.ndarray:
        def load(key: tuple[str, int, int]) -> np.ndarray:
            return reduced(self._inputs.image(*key[:2]), side)

        return self._small.get_or_make((camera, frame, side), load)

    def _outlined(self, camera: str, image: np.ndarray, solid: np.ndarray) -> np.ndarray:
        """The mask at full size with soft edges."""
        width, behind, larger = image.shape[1], self.background(camera), enlarged(solid, image.shape)
        kept = keep_components(larger, self._inputs.spec.mask_components, int(_SMALLEST * larger.size))
        if not kept.any():
            return kept
        gain = match_exposure(image.astype(np.float32), behind.plate.astype(np.float32), behind.known)
        reach = max(2.0, 2.0 * width / solid.shape[1])
        return solve_edges(image, behind.plate, gain, kept, reach if width > solid.shape[1] else 2.0, behind.known)


def best_threshold(votes: Mapping[str, np.ndarray], odds: Mapping[str, np.ndarray]) -> float:
    """The threshold of votes at which their masks have the largest IoU with the masks of the log-odds."""
    candidates = np.arange(-1.0, 1.95, 0.1)
    counts = np.zeros((2, len(candidates) + 1))  # set, performer: pixels by the number of candidates that they exceed
    for name, vote in votes.items():
        front = odds[name][::2, ::2] > 0
        exceeded = np.searchsorted(candidates, vote[::2, ::2])
        for index, kind in enumerate((exceeded[~front], exceeded[front])):
            counts[index] += np.bincount(kind, minlength=len(candidates) + 1)
    wrong, right = counts[:, ::-1].cumsum(1)[:, -2::-1]
    return float(candidates[int(np.argmax(right / np.maximum(wrong + counts[1].sum(), 1)))])


def _in_color(own: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """A camera's own evidence; where a pixel has a color of the performer, the others can outvote it."""
    return np.maximum(own, _IN_COLOR * np.minimum(colors, 0.0))


def _next_vote(own: np.ndarray, agreed: np.ndarray) -> np.ndarray:
    alone, together = np.clip(own, -_VOTE_LIMIT, _VOTE_LIMIT), np.clip(agreed, -_VOTE_LIMIT, _VOTE_LIMIT)
    return np.asarray((1 - _LEARNED) * alone + _LEARNED * together)


def _after_cut(odds: np.ndarray, solid: np.ndarray) -> np.ndarray:
    return _UNCUT * np.clip(odds, -2.0, 2.0) + np.where(solid, np.float32(_CUT), np.float32(-_CUT))


def _reduced_background(behind: Background, side: int = _WORK_SIDE) -> Background:
    def area(where: np.ndarray | None) -> np.ndarray | None:
        return None if where is None else reduced(where.astype(np.float32), side) > 0.5

    return Background(
        reduced(behind.plate, side), area(behind.known), area(behind.doubtful), behind.colors, area(behind.agreed)
    )


def open_agreed(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str] | None:
    """Open masks on which all cameras agree, for `SOURCES`."""
    voters = len(inputs.names) - len(inputs.held_out)
    if not required and voters < FEWEST_CAMERAS:
        return None
    if voters < FEWEST_CAMERAS:
        problem = f"capture.masks is agreed, which needs {FEWEST_CAMERAS} cameras for training, but there are {voters}"
        fix = "Set capture.masks to median_background, which looks at each camera alone."
        raise StudioError(
            "mask.too_few_cameras", problem, value=voters, fix=fix, expected=FEWEST_CAMERAS, setting="capture.masks"
        )
    clean = open_clean_plate(inputs, False)
    opened = clean or open_median_background(inputs, required)
    if opened is None:
        return None
    plates, phrase = opened
    model = load_model(inputs) if inputs.spec.mask_model else None
    if inputs.cameras is None:
        alone = PlateMaskSource(inputs, plates.background, plates.files() + (model.files() if model else []))
        return alone, f"those of each camera alone until the cameras are calibrated, {phrase}"
    cameras, recipes = inputs.cameras(), ("", "")
    if inputs.cache_folder is not None:  # the sets do not depend on the model
        masks = sets = _recipe(inputs, cameras, plates)
        if model is not None:
            files = digest_files(inputs.spec.root, model.files())
            masks = _digest(sets, files, inputs.spec.model_dump_json(include={"mask_model"}))
        recipes = masks, sets
    source = AgreedMaskSource(inputs, cameras, plates, model, clean is None, recipes)
    if model:
        phrase += " and a matting model"
    elif clean is None:
        phrase += " (people get better masks with a model: see `v3studio models list`)"
    return source, f"agreed by {voters} cameras, from the {phrase}"


def _recipe(inputs: MaskInputs, cameras: Mapping[str, Camera], plates: PlateMaskSource) -> str:
    """Everything that the sets depend on."""
    spec = inputs.spec
    files = [path for source in inputs.sources.values() for path in source.files()] + plates.files()
    files += [] if inputs.garbage is None else inputs.garbage.files
    return _digest(
        str(_VERSION),
        digest_files(spec.root, files),
        spec.model_dump_json(include={*DifferenceSettings.model_fields, "offsets"}),
        spec.model_dump_json(include={"color_matrix", "transfer", "held_out"}),
        *(f"{camera.to_dict()}" for camera in cameras.values()),
    )


def _digest(*parts: str) -> str:
    return hashlib.blake2b("\0".join(parts).encode(), digest_size=16).hexdigest()
