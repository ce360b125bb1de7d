"""Matches the cameras of a camera file with those of the footage, by name."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePosixPath

from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.capture.patterns import natural_key, without_extension
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.counts import cameras_listed
from v3studio.studio.errors import StudioError
from v3studio.studio.yaml_text import inline_yaml

_LEAST_CAMERAS = 2  # A visual hull and triangulation need so many


def rig_of_footage(rig: Rig, spec: CaptureSettings, names: Sequence[str], without_masks: Sequence[str] = ()) -> Rig:
    """The cameras that the footage (`names`) and a camera file share, matched as in `match_rig`, under their names in
    the footage. `left_out` has the cameras of the footage that are not used; `notes` say which of either are not used.

    Footage of cameras that the file does not have, or has without a pose, is not used. The former is refused
    (StudioError `calibration.camera_missing`) if the file has other cameras that the footage lacks, since names may
    then differ or count from another number; if fewer than two cameras would remain; and if `spec.cameras` asks for
    these cameras. The file need not have those `without_masks`.
    """
    matched = _matched(rig, (*names, *without_masks))
    posed = [name for name in names if matched.get(name) in rig]
    unused = [name for name in rig.names if name not in matched.values()]
    absent = [name for name in names if name not in matched]
    if not unused and len(posed) >= _LEAST_CAMERAS and not spec.cameras:
        wanted = list(matched)
    else:
        wanted = [*names, *(name for name in without_masks if name in matched)]
    cameras = tuple(camera for name, camera in match_rig(rig, wanted).items() if name in names)
    notes = list(rig.notes)
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
    matched = _matched(rig, names)
    without = [name for name in names if name not in matched]
    if without:
        known = sorted(rig.names, key=natural_key)
        shared = [name for name in names if name in matched]
        others = (
            f"Set capture.cameras to {inline_yaml(shared)} to use only the others, or rename" if shared else "Rename"
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
    return {name: replace(rig[own], name=name) for name, own in matched.items() if own in rig}


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


def _matched(rig: Rig, names: Sequence[str]) -> dict[str, str]:
    """Name in the footage to name in the rig or its `left_out`, for the cameras that are in both."""
    known = dict.fromkeys((*rig.names, *rig.left_out))
    by_name = {name: name for name in known}
    if not set(names) <= set(by_name):
        stems = {PurePosixPath(without_extension(name)).name: name for name in known}
        if len(stems) == len(known) and len(set(names) & set(stems)) > len(set(names) & set(by_name)):
            by_name = stems
    if not set(names) <= set(by_name):
        by_name = _by_number(by_name, names) or by_name
    return {name: by_name[name] for name in names if name in by_name}


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
