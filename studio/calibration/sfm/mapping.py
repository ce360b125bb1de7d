"""Mapping with COLMAP: cameras and points from a database of matches. Runs in the worker process."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from v3studio.studio.calibration.sfm.bundle_adjustment import adjust, known_model
from v3studio.studio.calibration.sfm.features import say
from v3studio.studio.calibration.sfm.focal_lengths import focal_ratio, guess_focal_lengths, is_any_unknown, longer_side
from v3studio.studio.calibration.sfm.guided import write_guided_matches
from v3studio.studio.calibration.sfm.job import SfmJob
from v3studio.studio.calibration.sfm.shared_intrinsics import (
    ASPECT_LIMIT,
    LIMIT,
    Tests,
    camera_of_image,
    focal_spread,
    misfit_growth,
    pixel_aspect,
    rebuilt,
    share_intrinsics,
    stretched,
    stretched_keypoints,
    try_separate_intrinsics,
    try_shared_intrinsics,
    with_richer_intrinsics,
)
from v3studio.studio.calibration.sfm.uncertainty import uncertainties
from v3studio.studio.calibration.sfm.verdict import (
    MISPLACED,
    TRUSTED,
    WEAK,
    match_inlier_ratio,
    match_inlier_ratios,
    noise,
)

_POLISHINGS = 2  # the second uses the noise estimate of the first
_SPREAD = 1.2  # ratio of focal lengths above which mapping is repeated with shared intrinsics
_SHARING_LOSS = 0.05  # shared intrinsics, which are fewer, may lose this much of the match inlier ratio
_MOST_MISPLACED = 1 / 3
"""Cameras with a ratio below `MISPLACED` are not registered again if they are more than this fraction."""
_LEAST_INLIERS = 0.1  # of a misplaced camera's matches with points, since most of them are wrong
_POINTS_FOR_CENTER = 100  # observations that each camera needs before principal points are estimated
_BANDS = (3.0, 2.0, 2.0)
"""Distances from the epipolar line in pixels within which matches are found again, in this order."""
_AGREEING = 3
"""Images that must see such a point: a wrong match of only two fits their epipolar line, and keeps cameras in place."""
_AS_WELL = 0.01  # smallest loss of the match inlier ratio that counts as one
_ONE_FOCAL_LENGTH = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_CAUCHY = 2.4  # width of the Cauchy loss in standard deviations: 95% efficiency for Gaussian noise


class Mapper:
    """Solves one database. `database`: image n + 1 belongs to camera n."""

    def __init__(self, folder: Path, database: Path, job: SfmJob) -> None:
        self.folder, self.database = folder, database
        self.sync_frames = folder / "sync_frames.db"  # features of each sync frame, from `features.find_matches`
        self.job = job
        self.sharing: Tests = []
        self.recentered = False  # whether principal points were estimated
        self.aspect = 1.0  # see `shared_intrinsics.stretched`, of the databases and the solution
        self.held: set[int] = set()  # camera ids whose intrinsics are temporarily fixed

    def solve(self) -> tuple[Any, str]:
        """The best model of the allowed attempts (None if all fail), and the name of its attempt.

        The best model has the most cameras, then the highest match inlier ratio. The search ends with the first model
        that has all cameras and a match inlier ratio of `TRUSTED` or more.
        """
        best, how, rank = None, "", (0, 0.0)
        self._guess_focal_lengths()
        wanted = self.job.attempts
        if self.job.poses:
            wanted = ("known poses",) if self.job.fix_poses else ("known poses", *wanted)
        for attempt in wanted:
            models = self._attempt(attempt)
            broken = {index for model in models for index in self.broken_intrinsics(model)}
            if broken and attempt != "known poses":
                models += self.with_fixed_focal_lengths(models, broken, attempt)
            for model in models:
                own = self.rank(model)
                if best is None or own > rank:
                    best, how, rank = model, attempt, own
            if best is not None and rank >= (len(self.job.names), TRUSTED):
                break
        if best is None:
            return None, how
        shared = self.with_shared_intrinsics(best)
        if shared is not None:
            return self.polished(self.placed_again(shared), joint=True), f"{how}, shared intrinsics"
        return self.polished(self.placed_again(best)), how

    def with_shared_intrinsics(self, best: Any) -> Any:
        """A model mapped with shared intrinsics, if `best` is doubtful or its focal lengths differ.

        None unless it has as many cameras and its match inlier ratio is lower by `_SHARING_LOSS` at most: a few cameras
        can fit their few matches with any focal lengths.
        """
        free = self.free_cameras()
        doubtful = match_inlier_ratio(best, self.database) < TRUSTED or focal_spread(best, free) > _SPREAD
        if not (self.job.find_shared and doubtful and len(free) > 1) or self.job.poses:
            return None
        database, self.database = self.database, self.folder / "shared.db"
        shutil.copyfile(database, self.database)
        try:
            share_intrinsics(self.database, free)
            self._guess_focal_lengths()
            models = self.incremental(lenient=False)
            if max(map(self.rank, models), default=(0, 0.0)) < (len(self.job.names), TRUSTED):
                models += self.incremental(lenient=True)
            shared = max(models, key=self.rank, default=None)
        finally:
            self.database.unlink()
            self.database = database
        if shared is None or shared.num_reg_images() < best.num_reg_images():
            return None
        least = match_inlier_ratio(best, database) - _SHARING_LOSS
        return shared if match_inlier_ratio(shared, database) >= least else None

    def free_cameras(self) -> set[int]:
        """Ids of the cameras with unknown intrinsics."""
        return {i + 1 for i, intrinsics in enumerate(self.job.intrinsics) if not intrinsics.known}

    def polished(self, model: Any, joint: bool = False) -> Any:
        """The model, fully converged under a robust loss whose width follows from the noise.

        COLMAP's mapper stops early and uses squared errors, but feature errors are not Gaussian: most are about a tenth
        of a pixel, while a few (features on edges, wrong matches) are one or two pixels, and these bias focal length
        and distortion.
        """
        total = _POLISHINGS + 2
        say(step="adjusting", done=0, total=total)
        better = pycolmap.Reconstruction(model)
        for number in range(_POLISHINGS):
            width = _CAUCHY * noise(better)
            self.adjust(better, width)
            say(step="adjusting", done=number + 1, total=total)
        if len(self.broken_intrinsics(better)) > len(self.broken_intrinsics(model)):
            better = model
        if self.job.find_shared:

            def adjust(other: Any) -> None:
                self.adjust(other, width)

            if joint:
                own = {image: self.job.intrinsics_of[image - 1] + 1 for image in camera_of_image(better)}
                better, self.sharing = try_separate_intrinsics(better, own, width, adjust)
            else:
                better, self.sharing = try_shared_intrinsics(better, self.free_cameras(), width, adjust)
        say(step="adjusting", done=total - 1, total=total)
        return self.matched_again(self._stretched(self.placed_again(self._recentered(self._enriched(better)))))

    def _enriched(self, model: Any) -> Any:
        """The model with the full camera models, and with the additional points that then fit."""
        richer = {i + 1: intrinsics.becomes for i, intrinsics in enumerate(self.job.intrinsics) if intrinsics.becomes}
        richer = {k: name for k, name in richer.items() if k in model.cameras and model.cameras[k].model.name != name}
        if not richer:
            return model
        model = with_richer_intrinsics(model, richer)
        self.adjust(model)
        model = self._completed(model)
        for _ in range(_POLISHINGS):
            self.adjust(model)
        return model

    def _recentered(self, model: Any) -> Any:
        """The model with estimated principal points, if each camera has enough points and they fit much better."""
        fewest = min(model.images[image].num_points3D for image in model.reg_image_ids())
        if fewest < _POINTS_FOR_CENTER or not self.free_cameras():
            return model
        width = _CAUCHY * noise(model)
        free = pycolmap.Reconstruction(model)
        for _ in range(_POLISHINGS):
            self.adjust(free, width, centers=True)
        self.recentered = misfit_growth(model, free, width, 2 * len(free.cameras)) >= LIMIT
        return free if self.recentered else model

    def _stretched(self, model: Any) -> Any:
        """The model with an estimated aspect ratio of the pixels of all cameras, if square ones fit much worse."""
        if self.job.poses or any(intrinsics.becomes not in _ONE_FOCAL_LENGTH for intrinsics in self.job.intrinsics):
            return model
        width = _CAUCHY * noise(model)
        ratio, growth = pixel_aspect(model, width, lambda other: self.adjust(other, width, keep=True))
        if growth < ASPECT_LIMIT:
            return model
        self.aspect = ratio
        for database in (self.database, self.sync_frames):
            if database.exists():
                stretched_keypoints(database, ratio)
        model = stretched(model, ratio)
        for _ in range(_POLISHINGS):
            self.adjust(model)
        return model

    def matched_again(self, model: Any) -> Any:
        """The model with cameras from matches along its epipolar lines, if the first matches agree with them as well.

        It happens only if a camera is weak, since it takes as long as mapping. The points remain those of the first
        matches."""
        first = self.database
        if self.job.poses or not self.sync_frames.exists():
            return model
        sigmas = uncertainties(model, self.job, centers=self.recentered)
        if all(position <= WEAK for position, _ in sigmas.values()):
            return model
        better = model
        self.database = self.folder / "guided.db"
        try:
            for band in _BANDS:
                write_guided_matches(self.sync_frames, first, self.database, better, self.job, band)
                better = self._with_own_cameras(better, lambda own: self._triangulated(own, again=True))
                for _ in range(_POLISHINGS):
                    for key in [k for k, point in better.points3D.items() if point.track.length() < _AGREEING]:
                        better.delete_point3D(key)
                    self.adjust(better)
        finally:
            self.database.unlink(missing_ok=True)
            self.database = first
        completed = self._completed(rebuilt(model, better.cameras, camera_of_image(model), poses=better))
        was, now = self.rank(self._completed(model)), self.rank(completed)
        return completed if now[0] >= was[0] and now[1] > was[1] - _AS_WELL else model

    def placed_again(self, model: Any) -> Any:
        """The model in which cameras that most of their matches contradict are registered again, if that fits better.

        In a room that repeats, a camera that was registered early may be where only a wrong part of the room fits. All
        other cameras together know better.
        """
        ratios = match_inlier_ratios(model, self.database)
        misplaced = sorted((image for image in ratios if ratios[image] < MISPLACED), key=lambda image: ratios[image])
        if not misplaced or len(misplaced) > _MOST_MISPLACED * len(ratios) or self.job.poses:
            return model
        better = self._with_own_cameras(model, lambda own: self._registered_again(own, misplaced))
        return better if self.rank(better) > self.rank(model) else model

    def _registered_again(self, model: Any, images: list[int]) -> Any:
        """Register images again, with all others; those that fail stay where they were."""
        options = self._options()
        options.mapper.abs_pose_min_inlier_ratio = _LEAST_INLIERS
        with pycolmap.Database.open(self.database) as database:
            cache = pycolmap.DatabaseCache.create(database, pycolmap.DatabaseCacheOptions())
        for image in images:
            changed = pycolmap.Reconstruction(model)
            changed.deregister_frame(changed.images[image].frame_id)
            mapper = pycolmap.IncrementalMapper(cache)
            mapper.begin_reconstruction(changed)
            if mapper.register_next_image(options.mapper, image):
                mapper.triangulate_image(options.triangulation, image)
                model = changed
            mapper.end_reconstruction(discard=False)
        return model

    def _completed(self, model: Any) -> Any:
        """The model with missing points triangulated."""
        return self._with_own_cameras(model, lambda own: self._triangulated(own, again=False))

    def _with_own_cameras(self, model: Any, change: Callable[[Any], Any]) -> Any:
        """The changed model; `change` gets it with the database's cameras, one per image."""
        joint, intrinsics_of = camera_of_image(model), self.job.intrinsics_of
        own = {image: intrinsics_of[image - 1] + 1 for image in joint}
        model = rebuilt(model, {own[image]: model.cameras[joint[image]] for image in joint}, own)
        with pycolmap.Database.open(self.database) as database:
            for camera in model.cameras.values():
                database.update_camera(camera)
        model = change(model)
        return rebuilt(model, {joint[image]: model.cameras[own[image]] for image in joint}, joint)

    def _triangulated(self, model: Any, *, again: bool, options: Any = None) -> Any:
        """Triangulate the points of the registered cameras: all again, or the missing ones."""
        out = self.folder / "models_known"
        out.mkdir(exist_ok=True)
        return pycolmap.triangulate_points(
            model, self.database, self.folder / "images", out, clear_points=again, options=options or self._options()
        )

    def rank(self, model: Any) -> tuple[int, float]:
        """Number of cameras with plausible intrinsics, then the match inlier ratio; larger is better."""
        return model.num_reg_images() - len(self.broken_intrinsics(model)), match_inlier_ratio(model, self.database)

    def _guess_focal_lengths(self) -> None:
        """Initialize unknown focal lengths with estimates from pairs of images."""
        free = [i + 1 for i, intrinsics in enumerate(self.job.intrinsics) if not intrinsics.prior]
        if free and not self.job.poses:
            guess_focal_lengths(self.database, self.folder, free, self.job.seed)

    def broken_intrinsics(self, model: Any) -> set[int]:
        """Indices of diverged focal lengths, which occur because a few distant points fit any focal length."""
        used = {image.camera_id for image in model.images.values() if image.has_pose}
        ratios = {key: focal_ratio(model.cameras[key]) for key in used}
        if not ratios:
            return set()
        middle = float(np.median(list(ratios.values())))
        free = {i + 1 for i, intrinsics in enumerate(self.job.intrinsics) if not intrinsics.fixed}
        return {key - 1 for key, ratio in ratios.items() if key in free and not 0.3 < ratio / middle < 3.0}

    def with_fixed_focal_lengths(self, models: list[Any], broken: set[int], attempt: str) -> list[Any]:
        """Map again with diverged focal lengths fixed at the median of the others."""
        model = max(models, key=self.rank)
        good = [i for i in range(len(self.job.intrinsics)) if i not in broken and i + 1 in model.cameras]
        focal = float(np.median([focal_ratio(model.cameras[i + 1]) for i in good]))
        with pycolmap.Database.open(self.database) as database:
            for index in range(len(self.job.intrinsics)):
                camera = model.cameras[index + 1] if index in good else database.read_camera(index + 1)
                if index in broken:
                    camera = pycolmap.Camera.create_from_model_id(
                        index + 1, camera.model, focal * longer_side(camera), camera.width, camera.height
                    )
                # the other cameras keep their result; otherwise mapping could start from the diverged camera
                camera.has_prior_focal_length = index not in broken
                database.update_camera(camera)
        self.held = {index + 1 for index in broken}
        remapped = self._attempt(attempt)
        self.held = set()
        return [self._released(model) for model in remapped]

    def _released(self, model: Any) -> Any:
        """The model with all intrinsics refined, unless one diverges again."""
        free = pycolmap.Reconstruction(model)
        adjust(free, self.job)
        return model if self.broken_intrinsics(free) else free

    def _attempt(self, attempt: str) -> list[Any]:
        if attempt == "known poses":
            return [self._from_poses()]
        if attempt == "global":
            return self._global()
        return self.incremental(attempt == "lenient")

    def _options(self) -> Any:
        options = pycolmap.IncrementalPipelineOptions()
        options.num_threads = self.job.threads
        options.random_seed = self.job.seed
        options.mapper.random_seed = self.job.seed
        options.triangulation.random_seed = self.job.seed
        options.mapper.num_threads = self.job.threads
        options.min_model_size = 2
        options.max_num_models = 4
        options.ba_refine_principal_point = False
        fixed = {i + 1 for i, intrinsics in enumerate(self.job.intrinsics) if intrinsics.fixed}
        options.constant_cameras = self.held | fixed
        return options

    def incremental(self, lenient: bool) -> list[Any]:
        options = self._options()
        if lenient:
            # a few cameras far apart share few points: lower the thresholds for the first pair and for registration
            options.min_num_matches = 10
            options.mapper.init_min_num_inliers = 30
            options.mapper.init_min_tri_angle = 6.0
            options.mapper.abs_pose_min_num_inliers = 12
            options.mapper.abs_pose_min_inlier_ratio = 0.15
            options.triangulation.ignore_two_view_tracks = False
        total = len(self.job.names)
        done = 0

        def registered(count: int) -> None:
            nonlocal done
            done = min(count, total)
            say(step="mapping", done=done, total=total)

        registered(0)
        out = self.folder / "models"
        out.mkdir(exist_ok=True)
        models = pycolmap.incremental_mapping(
            self.database,
            self.folder / "images",
            out,
            options=options,
            initial_image_pair_callback=lambda: registered(2),
            next_image_callback=lambda: registered(done + 1),
        )
        return list(models.values())

    def _global(self) -> list[Any]:
        options = pycolmap.GlobalPipelineOptions()
        options.num_threads = self.job.threads
        options.random_seed = self.job.seed
        options.min_model_size = 2
        if any(intrinsics.fixed for intrinsics in self.job.intrinsics):
            # the global mapper cannot fix some intrinsics and refine others
            options.mapper.bundle_adjustment.refine_focal_length = False
            options.mapper.bundle_adjustment.refine_extra_params = False
        out = self.folder / "models_global"
        out.mkdir(exist_ok=True)
        say(step="global mapping", done=0, total=1)
        if not all(intrinsics.prior for intrinsics in self.job.intrinsics) and is_any_unknown(self.database):
            # the global mapper cannot recover from a guessed focal length; if `_guess_focal_lengths` estimated all of
            # them, estimating again would change nothing
            calibration = pycolmap.ViewGraphCalibrationOptions()
            calibration.random_seed = self.job.seed
            pycolmap.calibrate_view_graph(self.database, calibration)
        models = pycolmap.global_mapping(self.database, self.folder / "images", out, options=options)
        return list(models.values())

    def _from_poses(self) -> Any:
        """Triangulate with known poses, then alternate bundle adjustment (unless they are fixed) and triangulation."""
        model = known_model(self.database, self.job.poses)
        rounds = 1 if self.job.fix_poses else 3
        for number in range(rounds):
            say(step="mapping", done=number, total=rounds)
            options = self._options()
            # cameras that were bumped since then are initially off by pixels
            options.triangulation.create_max_angle_error = (6.0, 3.0, 2.0)[number]
            options.triangulation.complete_max_reproj_error = (20.0, 8.0, 4.0)[number]
            options.triangulation.merge_max_reproj_error = (20.0, 8.0, 4.0)[number]
            options.mapper.filter_max_reproj_error = (20.0, 8.0, 4.0)[number]
            model = self._triangulated(model, again=True, options=options)
            adjust(model, self.job, last=number == rounds - 1)
        say(step="mapping", done=rounds, total=rounds)
        return model

    def adjust(self, model: Any, width: float | None = None, centers: bool = False, keep: bool = False) -> None:
        """Adjust under a robust loss whose width follows from the noise, if it is not given."""
        width = width or _CAUCHY * noise(model)
        adjust(model, self.job, width=width, centers=centers or self.recentered, keep=keep)
