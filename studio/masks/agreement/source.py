"""Masks on which all cameras agree, whatever each of them knows: one or several sources of masks are evidence.

For each frame, with all cameras at once and at reduced size:

1. `evidence` gives log-odds of each image, added up: from the empty set and motion, from a screen, and from the masks
   of other sources. A matting model adds its own (`people`), once votes at half the size have found the people. At the
   end, what the model sees in most cameras is part of the performer, even where an estimated set, which may show a
   performer who stands still, has outvoted it.
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
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.capture.digest import digest_files
from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.counts import listed
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.agreement.empty_set import cover, uncovered
from v3studio.studio.masks.agreement.evidence import LIMIT, evidence_of, evidence_of_screen, smoothed
from v3studio.studio.masks.agreement.outlines import BINS, color_odds, cut
from v3studio.studio.masks.agreement.people import odds_of_people, odds_of_tiles, sees_people
from v3studio.studio.masks.agreement.vote import heard
from v3studio.studio.masks.chroma_key import ChromaMaskSource, screen_behind
from v3studio.studio.masks.clean_plate import Background, match_exposure, solve_edges
from v3studio.studio.masks.despill import despill
from v3studio.studio.masks.filters import brightness, color_bins, enlarged, keep_components, reduced
from v3studio.studio.masks.mask_cache import cached_mask
from v3studio.studio.masks.mask_source import (
    FEWEST_VOTERS,
    MaskInputs,
    MaskSource,
    ShowsSet,
    evenly_spaced,
    masked_cameras,
)
from v3studio.studio.masks.matting_model import MattingModel, ModelMaskSource
from v3studio.studio.masks.median_background import background_cache, cached_background
from v3studio.studio.masks.plates import PlateMaskSource, shown
from v3studio.studio.memory_cache import MemoryCache

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
_CERTAIN = -2.0
"""Log-odds before a set that was not estimated, below which a model is not believed."""
_GIVEN = 3.0
"""Log-odds of a mask of another source."""
_SMALLEST = 1e-4  # component, in fractions of the image
_VERSION = 8  # of the algorithm; part of the names of cached files


class AgreedMaskSource(MaskSource):
    """A `MaskSource` whose masks all cameras agree on, by votes in rounds (described at the top of this file), with the
    evidence of other `sources`. If the cameras cannot vote (`MaskInputs.can_vote`), it has the masks of the first one.

    Attributes:
        votes: whether the cameras vote.
    """

    def __init__(self, inputs: MaskInputs, sources: Mapping[str, MaskSource]) -> None:
        self._inputs, self._sources = inputs, tuple(sources.values())
        self.votes = inputs.can_vote
        self._plates = next((source for source in self._sources if isinstance(source, PlateMaskSource)), None)
        self._screen = next((source for source in self._sources if isinstance(source, ChromaMaskSource)), None)
        self._model = next((source.model for source in self._sources if isinstance(source, ModelMaskSource)), None)
        known = (PlateMaskSource, ChromaMaskSource, ModelMaskSource)
        self._given = [source for source in self._sources if not isinstance(source, known)]
        common = sorted(set.intersection(*(set(source.frames) for source in inputs.sources.values())))
        self._set_frames = evenly_spaced(common, SET_FRAMES)
        self._estimated = "median_background" in sources and bool(common)
        self._cameras: Mapping[str, Camera] = {}
        self._recipes = "", ""
        if self.votes:
            assert inputs.cameras is not None
            self._cameras = inputs.cameras()
            self._recipes = _recipes(inputs, self._cameras, sources)
        self._small: MemoryCache[tuple[str, int, int], np.ndarray] = MemoryCache(
            _KEPT_BYTES, lambda image: image.nbytes
        )
        self._agreed: MemoryCache[int, dict[str, np.ndarray]] = MemoryCache(_KEPT_FRAMES)
        self._sets = background_cache()
        self._small_sets: MemoryCache[str, Background] = MemoryCache(math.inf)
        self._covers: MemoryCache[None, list[dict[str, np.ndarray]]] = MemoryCache(math.inf)

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError: a camera's image or plate cannot be read."""
        if not self.votes:
            return self._sources[0].mask(camera, frame, image)
        image = np.ascontiguousarray(image[:, :, :3])

        def make() -> np.ndarray:
            return self._outlined(camera, image, self._agreed.get_or_make(frame, self.agree)[camera])

        return cached_mask(self._inputs.cache_folder, f"agreed {self._recipes[0]} {frame}", image, make)

    def files(self) -> list[Path]:
        return [path for source in self._sources for path in source.files()]

    @property
    def has_plates(self) -> bool:
        """Tell whether plates, given or estimated, are evidence."""
        return self._plates is not None

    def plate(self, camera: str) -> np.ndarray | None:
        if not self.votes:
            return self._sources[0].plate(camera) if isinstance(self._sources[0], ShowsSet) else None
        return None if self._plates is None else shown(self._background(camera, self._plates))

    def _background(self, camera: str, plates: PlateMaskSource) -> Background:
        """The set of `camera`, in raw pixels; if it was estimated, from where the cameras agree that it is empty."""
        if not self._estimated:
            return plates.background(camera)
        return self._sets.get_or_make(camera, self._emptied)

    def _emptied(self, camera: str) -> Background:
        def make() -> Background:
            return self._uncovered(camera, self._covers.get_or_make(None, self._cover))

        return cached_background(self._inputs.cache_folder, _digest(self._recipes[1], camera), make)

    def _uncovered(self, camera: str, covers: Sequence[Mapping[str, np.ndarray]]) -> Background:
        assert self._plates is not None
        images = [self._inputs.image(camera, frame) for frame in self._set_frames]
        return uncovered(self._plates.background(camera), images, [by_camera[camera] for by_camera in covers])

    def _cover(self, _: None) -> list[dict[str, np.ndarray]]:
        """Areas where the performer may be, (h, w) bool, by camera, for each frame of the set."""
        assert self._plates is not None
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
        behind = self._small_set(camera) if self._plates is not None else None
        return self._evidence(camera, frame, behind, _WORK_SIDE)

    def _small_set(self, camera: str) -> Background:
        assert self._plates is not None
        plates = self._plates
        return self._small_sets.get_or_make(camera, lambda name: _reduced_background(self._background(name, plates)))

    def _evidence(
        self, camera: str, frame: int, behind: Background | None, side: int, people: np.ndarray | None = None
    ) -> np.ndarray:
        image, parts = self._image(camera, frame, side), [] if people is None else [people]
        if behind is not None:
            known = self._inputs.sources[camera].frames
            near = [self._image(camera, frame + step, side) for step in _NEIGHBORS if frame + step in known]
            parts.append(evidence_of(image, near, behind, self._inputs.spec))
        if self._screen is not None:
            with suppress(StudioError):  # this camera does not see it
                parts.append(evidence_of_screen(image, self._screen.screen(camera), self._inputs.spec))
        given = [source for source in self._given if masked_cameras(source, (camera,))]
        if given:
            whole = self._inputs.sources[camera].read(frame)
            masks = [_at(source.mask(camera, frame, whole), side) for source in given]
            parts += [_GIVEN * (mask.astype(np.float32) / 127.5 - 1) for mask in masks]
        total = sum(parts, start=np.zeros(image.shape[:2], np.float32))
        return self._allowed(camera, frame, np.clip(total, -LIMIT, LIMIT), side)

    def _people(self, camera: str, frame: int, solid: np.ndarray | None, side: int, model: MattingModel) -> np.ndarray:
        """(h, w) float32 log-odds of the model; `solid`: roughly where the performer is; None: not known."""
        image = self._inputs.image(camera, frame)
        odds = odds_of_tiles(image, model) if solid is None else odds_of_people(image, solid, model)
        return self._allowed(camera, frame, _at(odds, side), side)

    def _allowed(self, camera: str, frame: int, odds: np.ndarray, side: int) -> np.ndarray:
        """Log-odds, the lowest where the garbage mask excludes the performer."""
        if self._inputs.garbage is None:
            return odds
        inside = self._inputs.inside(camera, frame, self._inputs.image(camera, frame))
        return odds if inside is None else np.where(_at(inside.astype(np.float32), side) > 0.5, odds, -LIMIT)

    def agree(self, frame: int) -> dict[str, np.ndarray]:
        """Areas in which all cameras together see the performer, (h, w) bool at reduced size, by camera. StudioError
        `mask.nobody_seen`: a matting model is all the evidence, and it sees no people."""
        names, model = self._inputs.names, self._model
        sets = {} if self._plates is None else {name: self._small_set(name) for name in names}
        if model is None:
            return self._vote(frame, sets, _WORK_SIDE, _ROUNDS, {})
        alone = self._plates is None and not self._given  # so that the model has to find the people

        def looked(solid: Mapping[str, np.ndarray], side: int) -> dict[str, np.ndarray]:
            with ThreadPoolExecutor(self._inputs.threads or None, thread_name_prefix="masks") as pool:
                odds = pool.map(lambda name: self._people(name, frame, solid.get(name), side, model), names)
                return dict(zip(names, odds, strict=True))

        coarse = {name: _reduced_background(behind, _COARSE_SIDE) for name, behind in sets.items()}
        seen = looked({}, _COARSE_SIDE) if alone else {}
        rough = self._vote(frame, coarse, _COARSE_SIDE, _COARSE_ROUNDS, seen)
        people = looked(rough, _WORK_SIDE)
        small = [_at(people[name], _COARSE_SIDE) for name in names]
        if self._inputs.spec.mask_model == "auto" and not sees_people(small, [rough[name] for name in names]):
            if alone and self._screen is None:
                problem = f"no people are seen in frame {frame}, and a matting model for people is all the evidence"
                fix = "Add masks, clean plates or more frames, or set capture.masks to another source."
                raise StudioError("mask.nobody_seen", problem, fix=fix, frame=frame, setting="capture.masks")
            return self._vote(frame, sets, _WORK_SIDE, _ROUNDS, {})
        solid = self._vote(frame, sets, _WORK_SIDE, _ROUNDS, people)
        votes = heard(people, self._sized(people), self._inputs.voters)
        seen = {name: (votes[name] > _SEEN) & (odds > 0) for name, odds in people.items()}
        if not self._estimated:  # a clean plate or a screen shows no performer, so that what is certain stays
            seen = {name: there & (self.evidence(name, frame) > _CERTAIN) for name, there in seen.items()}
        return {name: mask | seen[name] for name, mask in solid.items()}

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
            own = each(lambda name: self._evidence(name, frame, sets.get(name), side, people.get(name)), own_name)
            grays = each(brightness, images)
            bins = each(partial(color_bins, bins=BINS), images)
            cameras = self._sized(images)
            voting, colors = own, {name: np.zeros_like(odds) for name, odds in own.items()}
            solid: dict[str, np.ndarray] = {}
            agreed = any(behind.agreed is not None for behind in sets.values())
            for turn in range(rounds):
                votes = heard(voting, cameras, self._inputs.voters, pool.map)
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
            return _at(self._inputs.image(*key[:2]), side)

        return self._small.get_or_make((camera, frame, side), load)

    def _outlined(self, camera: str, image: np.ndarray, solid: np.ndarray) -> np.ndarray:
        """The mask at full size with soft edges."""
        width, larger = image.shape[1], enlarged(solid, image.shape)
        kept = keep_components(larger, self._inputs.spec.mask_components, int(_SMALLEST * larger.size))
        if not kept.any():
            return kept
        gain = np.ones(3, np.float32)
        if self._plates is not None:
            behind = self._background(camera, self._plates)
            plate, known = behind.plate, behind.known
            gain = match_exposure(image.astype(np.float32), plate.astype(np.float32), known)
        else:  # what is beside the performer is also behind their outline
            plate, known = screen_behind(image, kept), None
        reach = max(2.0, 2.0 * width / solid.shape[1])
        return solve_edges(image, plate, gain, kept, reach if width > solid.shape[1] else 2.0, known)


class _BeforeScreen(AgreedMaskSource):
    """Agreement before a screen, whose light is removed from outlines (see `Recolors`)."""

    def recolored(self, camera: str, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        assert self._screen is not None
        try:
            color = self._screen.screen(camera).color
        except StudioError:  # this camera does not see it
            return image
        return despill(image, mask, screen_behind(image, (mask > 127).astype(np.uint8)), color)


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


def _at(image: np.ndarray, side: int) -> np.ndarray:
    """An image at most `side` pixels long. Via `_WORK_SIDE`, so that its size is the same from wherever it comes."""
    return reduced(reduced(image, _WORK_SIDE), side)


def _reduced_background(behind: Background, side: int = _WORK_SIDE) -> Background:
    def area(where: np.ndarray | None) -> np.ndarray | None:
        return None if where is None else _at(where.astype(np.float32), side) > 0.5

    return Background(
        _at(behind.plate, side), area(behind.known), area(behind.doubtful), behind.colors, area(behind.agreed)
    )


def open_agreed(inputs: MaskInputs, opened: Mapping[str, tuple[MaskSource, str]]) -> tuple[MaskSource, str]:
    """Masks on which the cameras agree, with sources as evidence, by name, each with a phrase that describes it; and
    such a phrase."""
    sources = {name: source for name, (source, _) in opened.items()}
    phrases = {name: phrase for name, (_, phrase) in opened.items()}
    if "model" in phrases and inputs.spec.mask_model == "auto":
        phrases["model"] += " where it sees people (capture.mask_model null: without)"
    kind = _BeforeScreen if any(isinstance(source, ChromaMaskSource) for source in sources.values()) else None
    source = (kind or AgreedMaskSource)(inputs, sources)
    if source.votes:
        return source, f"agreed by {len(inputs.voters)} cameras, from {listed(list(phrases.values()))}"
    why = "the cameras are calibrated" if inputs.cameras is None else f"there are {FEWEST_VOTERS} for training"
    return source, f"{next(iter(phrases.values()))}, by each camera alone: cameras agree once {why}"


def _recipes(inputs: MaskInputs, cameras: Mapping[str, Camera], sources: Mapping[str, MaskSource]) -> tuple[str, str]:
    """Digests of everything that masks and sets depend on, for the disk cache; sets do not depend on a model."""
    if inputs.cache_folder is None:
        return "", ""
    spec = inputs.spec
    others = {name: source for name, source in sources.items() if name != "model"}
    files = [path for source in inputs.sources.values() for path in source.files()]
    files += [path for source in others.values() for path in source.files()]
    files += [] if inputs.garbage is None else inputs.garbage.files
    sets = _digest(
        str(_VERSION),
        digest_files(spec.root, files),
        " ".join(others),
        spec.model_dump_json(include={*DifferenceSettings.model_fields, "offsets", "key_color", "mask_labels"}),
        spec.model_dump_json(include={"color_matrix", "transfer", "held_out"}),
        *(f"{camera.to_dict()}" for camera in cameras.values()),
    )
    model = [path for source in sources.values() if source not in others.values() for path in source.files()]
    return (_digest(sets, digest_files(model[0].parent, model), f"{spec.mask_model}") if model else sets), sets


def _digest(*parts: str) -> str:
    return hashlib.blake2b("\0".join(parts).encode(), digest_size=16).hexdigest()
