"""Intrinsics of a solution: shared or separate, and with more terms. Runs in the worker process.

If sixteen cameras have the same focal length, a joint estimate is four times as accurate, and so are the poses; if they
do not, sharing it distorts the whole solution. A statistical test decides: shared intrinsics always fit slightly worse
than separate ones, but if the cameras are identical, only by as much as expected by chance.
"""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from v3studio.studio.calibration.sfm.verdict import noise, reprojection_errors
from v3studio.studio.camera_files.colmap_model import Intrinsics, intrinsics

LIMIT = 8.0
"""Increase of the misfit per parameter removed, by sharing or by principal points in the middle of the images, below
which the simpler intrinsics are accepted. Independent Gaussian errors give 1; SIFT features of 1 to 3 sync frames gave
3 to 5. At 13 (focal lengths that differ by 0.1%), shared and separate intrinsics gave equally accurate cameras; at 35
(0.2%), shared intrinsics had twice the error."""
ASPECT_LIMIT = 50.0
"""Increase of the misfit below which pixels are accepted as square. It is larger than `LIMIT`, since a single parameter
exceeds the mean by chance, by 3.5 sigma at misfit 4."""
_ASPECT_STEP = 0.0025
_FEWEST = 3

Tests: TypeAlias = list[tuple[list[int], float]]
"""Ids of the images that would share intrinsics, and `misfit_growth`: below `LIMIT`, they do."""


def try_shared_intrinsics(model: Any, free: set[int], width: float, adjust: Callable[[Any], None]) -> tuple[Any, Tests]:
    """The model with shared intrinsics by image size where they fit equally well, and the tests."""
    tests: Tests = []
    sizes: dict[tuple[Any, int, int], list[int]] = {}
    used = {model.images[image_id].camera_id for image_id in model.reg_image_ids()}
    for key in sorted(used & free):
        camera = model.cameras[key]
        sizes.setdefault((camera.model, camera.width, camera.height), []).append(key)
    for keys in sizes.values():
        if len(keys) < _FEWEST:
            continue
        shared = joined(model, keys)
        adjust(shared)
        images = [i for i in sorted(model.reg_image_ids()) if model.images[i].camera_id in keys]
        growth = misfit_growth(shared, model, width, (len(keys) - 1) * _free_parameters(model.cameras[keys[0]]))
        tests.append((images, growth))
        if growth < LIMIT:
            model = shared
    return model, tests


def try_separate_intrinsics(
    model: Any, own: dict[int, int], width: float, adjust: Callable[[Any], None]
) -> tuple[Any, Tests]:
    """The model with separate intrinsics, if they fit much better than its shared ones; see `try_shared_intrinsics`.

    Args:
        own: image id to the id of its own camera.
    """
    joint = camera_of_image(model)
    apart = rebuilt(model, {own[image]: model.cameras[joint[image]] for image in joint}, {i: own[i] for i in joint})
    adjust(apart)
    tests = []
    for key in sorted(set(joint.values())):
        images = [image for image in joint if joint[image] == key]
        if len(images) < 2:
            continue
        given_up = (len(images) - 1) * _free_parameters(model.cameras[key])
        tests.append((images, misfit_growth(model, apart, width, given_up)))
    return (model if all(growth < LIMIT for _, growth in tests) else apart), tests


def focal_spread(model: Any, free: set[int]) -> float:
    """Largest ratio of two focal lengths of free cameras with the same image size; 1 if there are none."""
    sizes: dict[tuple[int, int], list[float]] = {}
    for key in {model.images[image_id].camera_id for image_id in model.reg_image_ids()} & free:
        camera = model.cameras[key]
        sizes.setdefault((camera.width, camera.height), []).append(camera.mean_focal_length())
    return max((max(lengths) / max(min(lengths), 1e-9) for lengths in sizes.values()), default=1.0)


def share_intrinsics(database: Path, free: set[int]) -> None:
    """Change a database so that images of one size share a camera, if their cameras are free."""
    with closing(sqlite3.connect(database)) as rows, rows:
        sizes: dict[tuple[int, int, int], int] = {}
        listed = "SELECT camera_id, model, width, height FROM cameras ORDER BY camera_id"
        for key, model, width, height in rows.execute(listed).fetchall():
            first = sizes.setdefault((model, width, height), key) if key in free else key
            if first == key:
                continue
            (rig,) = rows.execute("SELECT rig_id FROM rigs WHERE ref_sensor_id = ?", (first,)).fetchone()
            rows.execute(
                "UPDATE frames SET rig_id = ? WHERE frame_id IN (SELECT frame_id FROM frame_data WHERE sensor_id = ?)",
                (rig, key),
            )
            rows.execute("UPDATE frame_data SET sensor_id = ? WHERE sensor_id = ?", (first, key))
            rows.execute("UPDATE images SET camera_id = ? WHERE camera_id = ?", (first, key))


def joined(model: Any, keys: list[int]) -> Any:
    """A copy of a model in which the cameras of these ids are the first one, with the medians of their parameters."""
    import pycolmap

    shared = pycolmap.Camera(model.cameras[keys[0]].todict())
    shared.params = list(np.median([model.cameras[key].params for key in keys], axis=0))
    cameras = {key: camera for key, camera in model.cameras.items() if key not in keys} | {keys[0]: shared}
    before = camera_of_image(model)
    return rebuilt(model, cameras, {image: keys[0] if key in keys else key for image, key in before.items()})


def with_richer_intrinsics(model: Any, names: dict[int, str]) -> Any:
    """A copy in which SIMPLE_RADIAL cameras get the model of `names` (by id); new terms are 0."""
    import pycolmap

    cameras = {}
    for key, camera in model.cameras.items():
        cameras[key] = pycolmap.Camera(camera.todict())
        if key in names:
            focal, cx, cy, k1 = camera.params
            cameras[key] = pycolmap.Camera.create_from_model_name(key, names[key], focal, camera.width, camera.height)
            richer = cameras[key].params
            richer[cameras[key].principal_point_idxs()] = [cx, cy]
            richer[cameras[key].extra_params_idxs()[0]] = k1
            cameras[key].params = list(richer)
    return rebuilt(model, cameras, camera_of_image(model))


def pixel_aspect(model: Any, width: float, adjust: Callable[[Any], None]) -> tuple[float, float]:
    """Height of a pixel divided by its width at which the model fits best, from a parabola through three adjustments,
    and the misfit's growth with square ones, see `misfit_growth`.

    Args:
        adjust: with a Cauchy loss of this `width`, without removing observations.
    """
    unit = noise(model) ** 2

    def misfit(ratio: float) -> float:
        other = stretched(model, ratio)
        adjust(other)
        return _misfit(other, width) / unit

    low, square, high = (misfit(1 + step) for step in (-_ASPECT_STEP, 0, _ASPECT_STEP))
    curve = (low + high) / 2 - square
    if curve <= 0:
        return 1.0, 0.0
    ratio = float(np.clip(1 + _ASPECT_STEP * (low - high) / curve / 4, 0.5, 2))
    return ratio, square - misfit(ratio)


def stretched(model: Any, ratio: float) -> Any:
    """A copy of a model of pixels that are `ratio` times as high as wide, in square pixels of the same area.

    With another area, the errors would be of another size and not comparable.
    """
    model = rebuilt(model, model.cameras, camera_of_image(model))
    scale = square_pixels(ratio)
    for image in model.images.values():
        for point in image.points2D:
            point.xy = point.xy * scale
    for camera in model.cameras.values():
        params = camera.params
        params[camera.principal_point_idxs()] *= scale
        camera.params = params
    return model


def stretched_keypoints(database: Path, ratio: float) -> None:
    """Convert the keypoints of a database to square pixels, in place, as `stretched` does with a model."""
    with closing(sqlite3.connect(database)) as rows, rows:
        for image, columns, data in rows.execute("SELECT image_id, cols, data FROM keypoints").fetchall():
            keypoints = np.frombuffer(data, np.float32).reshape(-1, columns).copy()
            keypoints[:, :2] *= square_pixels(ratio)
            rows.execute("UPDATE keypoints SET data = ? WHERE image_id = ?", (keypoints.tobytes(), image))


def in_given_pixels(camera: Any, ratio: float) -> Intrinsics:
    """The lens of a camera of a `stretched` model for the original pixels."""
    lens = intrinsics(camera.model.name, list(camera.params))
    lens["K"][:2] /= square_pixels(ratio)[:, None]
    return lens


def square_pixels(ratio: float) -> np.ndarray:
    """(2,) factors of x and y that make pixels square, which are `ratio` times as high as wide."""
    return np.array([ratio**-0.5, ratio**0.5])


def camera_of_image(model: Any) -> dict[int, int]:
    """Image id to camera id of the registered images."""
    return {image_id: model.images[image_id].camera_id for image_id in sorted(model.reg_image_ids())}


def rebuilt(model: Any, cameras: dict[int, Any], of: dict[int, int], poses: Any = None) -> Any:
    """A copy of a model with the same images and points but other cameras, by id.

    `poses`: a model whose poses the copy gets; None: those of `model`.
    """
    import pycolmap

    copy = pycolmap.Reconstruction()
    for key in sorted(set(of.values())):
        camera = pycolmap.Camera(cameras[key].todict())
        camera.camera_id = key
        copy.add_camera(camera)
        rig = pycolmap.Rig()
        rig.rig_id = key
        rig.add_ref_sensor(camera.sensor_id)
        copy.add_rig(rig)
    for image_id, camera_id in of.items():
        old = model.images[image_id]
        image = pycolmap.Image(name=old.name, camera_id=camera_id, image_id=image_id)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(point.xy) for point in old.points2D])
        frame = pycolmap.Frame()
        frame.frame_id = image_id
        frame.rig_id = camera_id
        frame.add_data_id(image.data_id)
        frame.rig_from_world = (poses or model).images[image_id].cam_from_world()
        image.frame_id = image_id
        copy.add_frame(frame)
        copy.add_image(image)
        copy.register_frame(image_id)
    for key in sorted(model.points3D):
        point = model.points3D[key]
        copy.add_point3D(point.xyz, point.track, point.color)
    return copy


def misfit_growth(simple: Any, rich: Any, width: float, parameters: int) -> float:
    """Increase of the misfit from a model to one that has fewer `parameters` by this number, for each of them, in units
    of the noise variance: 1 is expected by chance.

    Args:
        simple, rich: adjusted with a Cauchy loss of the same `width` in pixels.
    """
    return float((_misfit(simple, width) - _misfit(rich, width)) / noise(rich) ** 2 / parameters)


def _free_parameters(camera: Any) -> int:
    """Number of parameters without the principal point."""
    return len(camera.params) - len(camera.principal_point_idxs())


def _misfit(model: Any, width: float) -> float:
    """Twice the Cauchy cost in square pixels."""
    errors = reprojection_errors(model)
    return float((width**2 * np.log1p((errors / width) ** 2)).sum())
