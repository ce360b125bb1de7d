"""Lenses of a solution: in common or not, and with more terms. Runs inside the worker's process.

Sixteen focal lengths that are one in truth are known four times as well when they are solved as one, and the cameras'
places with them; where they are not one, solving them so bends everything. The footage can tell: one lens for all fits
a little worse than a lens each, by little if that is chance and by much if it is not.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from studio.calibration.sfm.verdict import noise, reprojection_errors

LIMIT = 8.0
"""Growth of the misfit, a parameter given up, below which one lens is believed. Chance makes 1 with errors that are
Gaussian and independent, and was measured to make 3 to 5 with SIFT features of 1 to 3 moments. At 12 one lens and a
lens each were measured to place the cameras equally well (focal lengths that differ by 0.1 %); at 35 (0.2 %) one lens
is twice as wrong."""
_FEWEST = 3


def try_one_lens(
    model: Any, free: set[int], width: float, adjust: Callable[[Any], None]
) -> tuple[Any, list[dict[str, Any]]]:
    """The model with one lens for all cameras whose images have the same size, where that fits as well.

    Args:
        model: pycolmap.Reconstruction, adjusted.
        free: camera ids that may be joined (lenses that are not known).
        width: of the Cauchy loss that the model was adjusted under, in pixels.
        adjust: adjusts a model in place under that loss.

    Returns:
        the model, and for each size what was found: images (ids), shared (bool), misfit (growth a parameter).
    """
    told = []
    sizes: dict[tuple[Any, int, int], list[int]] = {}
    used = {model.images[image_id].camera_id for image_id in model.reg_image_ids()}
    for key in sorted(used & free):
        camera = model.cameras[key]
        sizes.setdefault((camera.model, camera.width, camera.height), []).append(key)
    for keys in sizes.values():
        if len(keys) < _FEWEST:
            continue
        one = joined(model, keys)
        adjust(one)
        images = [i for i in sorted(model.reg_image_ids()) if model.images[i].camera_id in keys]
        told.append(_compared(one, model, width, images, (len(keys) - 1) * _free_parameters(model.cameras[keys[0]])))
        if told[-1]["shared"]:
            model = one
    return model, told


def try_own_lenses(
    model: Any, own: dict[int, int], width: float, adjust: Callable[[Any], None]
) -> tuple[Any, list[dict[str, Any]]]:
    """The other way round: a model in which cameras have one lens, with a lens each where that fits much better.

    Args:
        model: pycolmap.Reconstruction, adjusted.
        own: id of each image to that of the camera that it would have on its own.
        width: see `try_one_lens`.
        adjust: see `try_one_lens`.

    Returns:
        as `try_one_lens`.
    """
    joint = camera_of_image(model)
    apart = rebuilt(model, {own[image]: model.cameras[joint[image]] for image in joint}, {i: own[i] for i in joint})
    adjust(apart)
    told = []
    for key in sorted(set(joint.values())):
        images = [image for image in joint if joint[image] == key]
        if len(images) < 2:
            continue
        told.append(_compared(model, apart, width, images, (len(images) - 1) * _free_parameters(model.cameras[key])))
    return (model if all(each["shared"] for each in told) else apart), told


def focal_spread(model: Any, free: set[int]) -> float:
    """Largest focal length by smallest, of free cameras whose images have the same size; 1 where there is nothing to
    compare."""
    sizes: dict[tuple[int, int], list[float]] = {}
    for key in {model.images[image_id].camera_id for image_id in model.reg_image_ids()} & free:
        camera = model.cameras[key]
        sizes.setdefault((camera.width, camera.height), []).append(camera.mean_focal_length())
    return max((max(lengths) / max(min(lengths), 1e-9) for lengths in sizes.values()), default=1.0)


def share_lenses(database: Path, free: set[int]) -> None:
    """Change a database so that images of one size have one camera, as far as their cameras are free."""
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
    """A copy in which several cameras are one, with the medians of their parameters.

    Args:
        model: pycolmap.Reconstruction in which each rig is one camera.
        keys: ids of the cameras; the first one stays.
    """
    import pycolmap

    one = pycolmap.Camera(model.cameras[keys[0]].todict())
    one.params = list(np.median([model.cameras[key].params for key in keys], axis=0))
    cameras = {key: camera for key, camera in model.cameras.items() if key not in keys} | {keys[0]: one}
    before = camera_of_image(model)
    return rebuilt(model, cameras, {image: keys[0] if key in keys else key for image, key in before.items()})


def with_richer_lenses(model: Any, names: dict[int, str]) -> Any:
    """A copy in which cameras of the model SIMPLE_RADIAL are of one with more terms, which are 0.

    Args:
        model: pycolmap.Reconstruction in which each rig is one camera.
        names: camera id to RADIAL, OPENCV or FULL_OPENCV.
    """
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


def camera_of_image(model: Any) -> dict[int, int]:
    """Ids of the images that have a place, and of their cameras."""
    return {image_id: model.images[image_id].camera_id for image_id in sorted(model.reg_image_ids())}


def rebuilt(model: Any, cameras: dict[int, Any], of: dict[int, int]) -> Any:
    """The same images, poses and points with other cameras.

    Args:
        model: pycolmap.Reconstruction in which each rig is one camera.
        cameras: id to pycolmap.Camera; copied.
        of: id of each image to that of its camera.
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
        frame.rig_from_world = old.cam_from_world()
        image.frame_id = image_id
        copy.add_frame(frame)
        copy.add_image(image)
        copy.register_frame(image_id)
    for key in sorted(model.points3D):
        point = model.points3D[key]
        copy.add_point3D(point.xyz, point.track, point.color)
    return copy


def _compared(one: Any, apart: Any, width: float, images: list[int], given_up: int) -> dict[str, Any]:
    """What is told of one lens for `images` against a lens each, which has `given_up` parameters more."""
    growth = (_misfit(one, width) - _misfit(apart, width)) / noise(apart) ** 2 / given_up
    return {"images": images, "shared": bool(growth < LIMIT), "misfit": round(float(growth), 2)}


def _free_parameters(camera: Any) -> int:
    """Of a lens whose principal point is not estimated."""
    return len(camera.params) - len(camera.principal_point_idxs())


def _misfit(model: Any, width: float) -> float:
    """Twice the Cauchy cost in square pixels."""
    errors = reprojection_errors(model)
    return float((width**2 * np.log1p((errors / width) ** 2)).sum())
