"""Moves the performer: key poses of a short dance, from which the pose at any time follows smoothly."""

import math
from dataclasses import dataclass

import numpy as np
from body import Body


@dataclass(frozen=True)
class Key:
    """A key pose. Angles are in degrees; arms and legs are (left, right), and mirrored for the right side."""

    time: float  # seconds
    spin: float = 0.0  # about the vertical axis
    lift: float = 0.0  # meters between the floor and the lower foot
    lean: float = 0.0  # of the trunk, forward
    twist: float = 0.0  # of the trunk, to the left
    head: float = 0.0  # of the head, to the left
    raised: tuple[float, float] = (-40.0, -40.0)  # arms from 45 degrees below the horizon, upward
    swung: tuple[float, float] = (0.0, 0.0)  # arms, forward
    elbow: tuple[float, float] = (15.0, 15.0)
    hip: tuple[float, float] = (0.0, 0.0)  # thighs, forward
    spread: tuple[float, float] = (4.0, 4.0)  # thighs, outward
    knee: tuple[float, float] = (4.0, 4.0)


DANCE = (
    Key(0.0, spin=-35, twist=-22, head=12, lean=4, raised=(-18, -30), swung=(55, -25), elbow=(50, 30), knee=(14, 14),
        hip=(8, 8)),
    Key(0.3, spin=-20, twist=-30, head=20, lean=8, raised=(-5, -15), swung=(70, -45), elbow=(65, 25), knee=(38, 34),
        hip=(24, 20)),
    Key(0.6, spin=55, lift=0.02, twist=12, head=-8, lean=2, raised=(42, 48), swung=(15, 10), elbow=(20, 25),
        knee=(16, 62), hip=(8, 34)),
    Key(0.85, spin=150, lift=0.13, twist=18, head=-14, lean=-2, raised=(60, 62), swung=(8, 12), elbow=(14, 16),
        knee=(8, 78), hip=(0, 44)),
    Key(1.1, spin=235, lift=0.03, twist=4, head=6, raised=(38, 52), swung=(20, 4), elbow=(30, 20), knee=(12, 40),
        hip=(6, 26)),
    Key(1.4, spin=300, twist=-14, head=14, lean=10, raised=(-8, 10), swung=(48, 20), elbow=(70, 60), knee=(44, 36),
        hip=(28, 22)),
    Key(1.65, spin=325, twist=4, lean=2, raised=(26, 20), swung=(72, 74), elbow=(34, 36), knee=(12, 10), hip=(6, 4)),
    Key(1.8, spin=325, twist=2, lean=2, raised=(22, 18), swung=(82, 84), elbow=(58, 60), knee=(10, 10), hip=(5, 5)),
    Key(1.95, spin=325, twist=0, lean=1, raised=(40, 34), swung=(60, 62), elbow=(40, 38), knee=(8, 8), hip=(4, 4)),
    Key(2.3, spin=325, twist=8, head=-10, raised=(-30, 66), swung=(10, 12), elbow=(20, 62), knee=(6, 8), hip=(3, 4)),
    Key(2.6, spin=325, twist=4, head=-16, raised=(-34, 58), swung=(6, 20), elbow=(16, 38), knee=(5, 6), hip=(3, 3)),
    Key(3.0, spin=325, raised=(-38, -34), swung=(2, 2), elbow=(14, 16)),
)  # fmt: skip
"""She winds up, hops and turns once around, lands, claps and waves: 3 seconds."""


def turned(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """(3, 3) rotation by degrees about y, then x, then z."""
    result = np.eye(3)
    for axis, angle in ((1, y), (0, x), (2, z)):
        result = about(np.eye(3)[axis], angle) @ result
    return result


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation by degrees about an axis (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    radians = math.radians(angle)
    return np.eye(3) + math.sin(radians) * cross + (1 - math.cos(radians)) * cross @ cross


def values_at(time: float, keys: tuple[Key, ...] = DANCE) -> np.ndarray:
    """(17,) the fields of `Key` after `time`, flat, on a Catmull-Rom spline through the keys; constant beyond them."""
    times = np.array([key.time for key in keys])
    table = np.array([np.hstack([*list(vars(key).values())[1:]]) for key in keys])
    time = float(np.clip(time, times[0], times[-1]))
    slopes = np.gradient(table, times, axis=0)
    slopes[[0, -1]] = 0  # starts and ends at rest
    index = int(np.clip(np.searchsorted(times, time) - 1, 0, len(times) - 2))
    width = times[index + 1] - times[index]
    u = (time - times[index]) / width
    return (
        (2 * u**3 - 3 * u**2 + 1) * table[index]
        + (u**3 - 2 * u**2 + u) * width * slopes[index]
        + (-2 * u**3 + 3 * u**2) * table[index + 1]
        + (u**3 - u**2) * width * slopes[index + 1]
    )


def bones_at(body: Body, time: float) -> np.ndarray:
    """(B, 4, 4) bone transforms at a time in seconds; the lower foot is `lift` above the floor."""
    spin, lift, lean, twist, head, *sides = values_at(time)
    pairs = np.array(sides).reshape(6, 2)
    pose = {
        "root": turned(z=spin),
        "spine05": turned(x=lean * 0.4, z=twist * 0.2),
        "spine03": turned(x=lean * 0.3, z=twist * 0.4),
        "spine01": turned(x=lean * 0.3, z=twist * 0.4),
        "neck01": turned(z=head * 0.4),
        "head": turned(x=-lean * 0.6, z=head * 0.6),
    }
    for number, (side, sign) in enumerate((("L", 1.0), ("R", -1.0))):
        raised, swung, elbow, hip, spread, knee = pairs[:, number]
        shoulder = body.bones[body.bone(f"upperarm01.{side}")].head
        wrist = body.bones[body.bone(f"wrist.{side}")].head
        along = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
        bend = np.cross(along, (0, -1, 0))  # the forearm moves forward
        pose[f"clavicle.{side}"] = turned(y=-sign * raised * 0.15)
        pose[f"upperarm01.{side}"] = turned(x=-swung, y=-sign * raised * 0.85)
        pose[f"lowerarm01.{side}"] = about(bend, elbow)
        pose[f"upperleg01.{side}"] = turned(x=-hip, y=-sign * spread)
        pose[f"lowerleg01.{side}"] = turned(x=knee)
        pose[f"foot.{side}"] = turned(x=hip - knee + (18 if lift > 0.01 else 0) * min(1.0, lift / 0.08))
        for finger in range(1, 6):
            for joint in range(1, 4):
                pose[f"finger{finger}-{joint}.{side}"] = about(bend, 5 if finger == 1 else 7 + 2 * finger)
    transforms = body.transforms(pose)
    soles = body.groups["body"][body.vertices[body.groups["body"], 2] < 0.03]
    transforms[:, 2, 3] += max(0.0, lift) - body.posed(transforms, chosen=soles)[:, 2].min()
    return transforms
