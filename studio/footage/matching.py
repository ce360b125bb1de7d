"""Matches the cameras of a camera file with those of the footage, by name."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePosixPath

import numpy as np

from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.capture.patterns import camera_in, natural_key, without_extension
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.counts import cameras_listed
from v3studio.studio.errors import StudioError
from v3studio.studio.validation import camera_error
from v3studio.studio.yaml_text import inline_yaml

_LEAST_CAMERAS = 2  # A visual hull and triangulation need so many


def rig_of_footage(
    rig: Rig,
    spec: CaptureSettings,
    names: Sequence[str],
    without_masks: Sequence[str] = (),
    every: Sequence[str] = (),
) -> Rig:
    """The cameras that the footage (`names`) and a camera file share, matched as in `match_rig`, under their names in
    the footage. `left_out` has the cameras of the footage that are not used; `notes` say which of either are not used.

    Footage of cameras that the file does not have, or has without a pose, is not used. The former is refused
    (StudioError `calibration.camera_missing`) if the file has other cameras that the footage lacks, since names may
    then differ or count from another number; if fewer than two cameras would remain; and if `spec.cameras` asks for
    these cameras. The file need not have those `without_masks`. `every` camera of the footage, also those that
    `spec.cameras` leaves out, tells how names are numbered.
    """
    every = tuple(dict.fromkeys((*names, *without_masks, *every)))
    rig = _one_pose_per_camera(rig, every)
    matched, how = _matched(rig, every)
    matched = {name: own for name, own in matched.items() if name in names or name in without_masks}
    posed = [name for name in names if matched.get(name) in rig]
    unused = [name for name in rig.names if name not in matched.values()]
    absent = [name for name in names if name not in matched]
    if not unused and len(posed) >= _LEAST_CAMERAS and not spec.cameras:
        wanted = list(matched)
    else:
        wanted = [*names, *(name for name in without_masks if name in matched)]
    _refuse_unmatched(rig, wanted, matched, bool(unused) and not spec.cameras)
    cameras = tuple(
        replace(rig[own], name=name) for name, own in matched.items() if name in names and name in wanted and own in rig
    )
    notes = [*rig.notes, how] if how else list(rig.notes)
    if rig.left_out:
        notes.append(
            f"Not used, since the camera file has no pose for them or disables them: {cameras_listed(rig.left_out)}."
        )
    if absent:
        notes.append(f"Not used, since they are not among the calibrated cameras: {cameras_listed(absent)}.")
    if unused and not spec.cameras:
        notes.append(f"{cameras_listed(unused, 'Camera')} of the calibration: not in the footage that is used.")
    tested = [name for name in names if matched.get(name) in rig.for_evaluation]
    if tested and not spec.held_out:
        notes.append(f"In the camera file for evaluation: capture.held_out: {inline_yaml(tested)}.")
    left_out = [*(name for name, own in matched.items() if own not in rig), *absent]
    return Rig(cameras, tuple(notes), tuple(left_out))


def match_rig(rig: Rig, names: Sequence[str]) -> dict[str, Camera]:
    """Cameras of a rig, renamed, by the names in the footage: matched by name, else by name without folder and
    extension, else by the number in the name if that is unambiguous and both have the same numbers; without those in
    `Rig.left_out`, and without those that the footage does not have. StudioError `calibration.camera_missing`: a camera
    of the footage is not in the rig."""
    rig = _one_pose_per_camera(rig, names)
    matched, _ = _matched(rig, names)
    _refuse_unmatched(rig, names, matched, False)
    return {name: replace(rig[own], name=name) for name, own in matched.items() if own in rig}


def _refuse_unmatched(rig: Rig, names: Sequence[str], matched: Mapping[str, str], rig_has_more: bool) -> None:
    """Raise StudioError unless all `names` are matched. If the rig has other cameras (`rig_has_more`), names may be
    shifted, so that to leave out those that are not matched would give the others wrong poses."""
    without = [name for name in names if name not in matched]
    if without:
        known = sorted(rig.names, key=natural_key)
        shared = [name for name in names if name in matched]
        others = (
            f"Set capture.cameras to {inline_yaml(shared)} to use only the others, or rename"
            if shared and not rig_has_more
            else "Give each camera the same name in both: rename"
        )
        raise StudioError(
            "calibration.camera_missing",
            f"{cameras_listed(without, 'Camera')} of the footage not found in the calibration, "
            f"which has {', '.join(known)}",
            value=without[0],
            fix=f"{others} the files, or calibrate again.",
            cameras=tuple(without),
            known=tuple(known),
            setting="capture.cameras",
        )


def refuse_missing(rig: Rig, names: Sequence[str]) -> None:
    """Check that the footage has all cameras of a take's rig."""
    missing = [name for name in rig.names if name not in names]
    if missing:
        problem = f"{cameras_listed(missing, 'Camera')} of the take's cameras not found in the footage"
        value = missing[0]
        fix = f"Add the missing files, or set capture.cameras to {inline_yaml(list(names))}."
        raise StudioError(
            "footage.camera_missing", problem, value=value, fix=fix, cameras=tuple(missing), setting="capture.cameras"
        )


def _matched(rig: Rig, names: Sequence[str]) -> tuple[dict[str, str], str]:
    """Name in the footage to name in the rig or its `left_out`, for the cameras that are in both; and how they were
    matched, as a sentence, unless by name."""
    known = dict.fromkeys((*rig.names, *rig.left_out))
    by_name, how = {name: name for name in known}, ""
    if not set(names) <= set(by_name):
        stems = {PurePosixPath(without_extension(name)).name: name for name in known}
        if len(stems) == len(known) and len(set(names) & set(stems)) > len(set(names) & set(by_name)):
            by_name = stems
    if not set(names) <= set(by_name):
        if by_number := _by_number(by_name, names):
            by_name, how = by_number, "Cameras are matched by the numbers in their names"
        elif by_order := _by_order(by_name, names):
            by_name, how = by_order, "The footage and the camera file count cameras from another number"
    if how:
        first = next(name for name in names if name in by_name)
        how += f": '{first}' of the footage is '{by_name[first]}' in the camera file."
    return {name: by_name[name] for name in names if name in by_name}, how


def _by_order(cameras: Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """Names of cameras by the name in the footage, if both count the same number of cameras without gaps, one from 0
    and the other from 1; otherwise empty."""
    counted = []
    for group in (names, cameras):
        numbers = {int(parts[0]): name for name in group if len(parts := re.findall(r"\d+", name)) == 1}
        if len(numbers) != len(group) or sorted(numbers) != list(range(min(numbers), min(numbers) + len(numbers))):
            return {}
        counted.append(numbers)
    mine, others = counted
    if len(mine) != len(others) or {min(mine), min(others)} != {0, 1}:
        return {}
    return {mine[number]: cameras[others[other]] for number, other in zip(sorted(mine), sorted(others), strict=True)}


_MOST_APART = 0.02  # of the size of the rig
_MOST_TURNED = np.radians(2)


def _one_pose_per_camera(rig: Rig, names: Sequence[str]) -> Rig:
    """The rig with a pose for each of the footage's cameras if it has several, each named after an image, as in a
    reconstruction from several moments: that nearest to the median. StudioError (camera.moves) if they differ."""
    direct, _ = _matched(rig, names)
    best: dict[str, list[Camera]] = {}
    most = len(direct)
    for way in range(1, len(camera_in("-"))):
        groups: dict[str, list[Camera]] = {}
        for camera in rig:
            groups.setdefault(camera_in(camera.name)[way], []).append(camera)
        if "" in groups or len(groups) == len(rig):
            continue
        named = Rig(tuple(replace(group[0], name=name) for name, group in groups.items()))
        matched, _ = _matched(named, names)
        if len(matched) > most:
            best, most = groups, len(matched)
    if not best:
        return rig
    middles = {name: np.median([camera.center for camera in group], axis=0) for name, group in best.items()}
    size = float(np.ptp(list(middles.values()), axis=0).max())
    cameras, apart = [], 0.0
    for name, group in best.items():
        distances = [float(np.linalg.norm(camera.center - middles[name])) for camera in group]
        nearest = group[int(np.argmin(distances))]
        turns = [np.trace(camera.rotation @ nearest.rotation.T) for camera in group]
        turned = float(np.arccos(np.clip((min(turns) - 1) / 2, -1, 1)))
        if max(distances) > _MOST_APART * size or turned > _MOST_TURNED:
            problem = f"its {len(group)} poses in the camera file differ by up to {max(distances):.3g} units"
            problem += f" and {np.degrees(turned):.2g} degrees, but cameras must not move"
            fix = "Calibrate from a single moment, or delete the wrong poses."
            raise camera_error("camera.moves", name, problem, value=max(distances), fix=fix)
        apart = max(apart, *distances)
        cameras.append(replace(nearest, name=name))
    note = (
        f"The camera file has {len(rig)} poses for {len(best)} cameras, up to {apart:.3g} units apart: of each, the "
        "one nearest to the median is used."
    )
    return replace(rig, cameras=tuple(cameras), notes=(*rig.notes, note))


def _by_number(cameras: Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """Names of cameras by the name in the footage that has the same numbers, as in `00000007` and `cam_7` or `hd_00_03`
    and `00_03`; empty unless this is unambiguous and holds for all of the footage. Of names with a single number, the
    rig must have no other: it may count from 0 and the footage from 1."""
    mine, others = ({tuple(map(int, re.findall(r"\d+", name))): name for name in group} for group in (names, cameras))
    ambiguous = len(mine) != len(names) or len(others) != len(cameras) or () in mine
    if ambiguous or not set(mine) <= set(others):
        return {}
    if set(mine) != set(others) and min(map(len, mine)) < 2:
        return {}
    return {name: cameras[others[numbers]] for numbers, name in mine.items()}
