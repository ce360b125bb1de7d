"""Simulates what swings: the skirt as a mesh of particles (Mueller et al. 2007, "Position based dynamics"), and the
hair.

Both are computed frame after frame from the body's motion, with the same numbers each time.
"""

from collections.abc import Callable

import numpy as np
from body import Body

STEP = 1 / 250  # seconds
ITERATIONS = 12
GRAVITY = np.array([0.0, 0.0, -9.81])
DAMPING = 1.8  # share of the velocity lost per second

CLEARANCE = 0.012  # meters between the skirt and the skin
PARTING = 0.018  # meters to the left of the middle


def skull(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Center and half axes of an ellipsoid in the head at rest, (3,) each."""
    return body.bones[body.bone("head")].head + np.array([0, -0.006, 0.045]), np.array([0.073, 0.089, 0.092])


def normals_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(N, 3) unit normals of the vertices of a mesh of quads."""
    a, b, c, d = (vertices[faces[:, corner]] for corner in range(4))
    across = np.cross(c - a, d - b)
    sums = np.zeros_like(vertices)
    for corner in range(4):
        np.add.at(sums, faces[:, corner], across)
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)


class Skirt:
    """A skirt that hangs from the hips and is pushed by the legs."""

    def __init__(self, body: Body, top: float, bottom: float) -> None:
        """`top`, `bottom`: heights at rest in meters; above `top` the skirt moves with the body."""
        self.body = body
        chosen = body.members("helper-skirt") & (body.vertices[:, 2] > bottom)
        self.indices = np.flatnonzero(chosen)
        place = np.full(len(body.vertices), -1)
        place[self.indices] = np.arange(len(self.indices))
        self.quads = body.faces_of(chosen)
        self.faces = place[body.faces[self.quads]]
        self.rest = body.vertices[self.indices] * (1.0, 1.0, 1.0)
        below = np.clip((top - self.rest[:, 2]) / (top - bottom), 0, 1)
        # Wider toward the hem, so that it swings.
        middle = np.array([0.0, self.rest[self.rest[:, 2] > top, 1].mean()])
        self.rest[:, :2] = middle + (self.rest[:, :2] - middle) * (1.05 + 0.28 * below)[:, None]
        self.free = self.rest[:, 2] < top
        self.edges = np.unique(np.sort(np.vstack([self.faces[:, [a, (a + 1) % 4]] for a in range(4)]), axis=1), axis=0)
        diagonals = np.sort(np.vstack([self.faces[:, [0, 2]], self.faces[:, [1, 3]]]), axis=1)
        self.links = np.vstack([self.edges, diagonals])
        self.stiffness = np.hstack([np.full(len(self.edges), 1.0), np.full(len(diagonals), 0.25)])
        self.lengths = np.linalg.norm(self.rest[self.links[:, 0]] - self.rest[self.links[:, 1]], axis=1)
        near = (
            body.members("helper-tights") & (body.vertices[:, 2] > bottom - 0.15) & (body.vertices[:, 2] < top + 0.05)
        )
        near &= np.abs(body.vertices[:, 0]) < 0.25
        self.skin = np.flatnonzero(near)
        place[self.skin] = np.arange(len(self.skin))
        self.skin_faces = place[body.faces[body.faces_of(near)]]
        self.counts = np.maximum(1, np.bincount(self.links.ravel(), minlength=len(self.rest)))[:, None]

    def simulate(self, bones: Callable[[float], np.ndarray], times: np.ndarray, before: float = 1.0) -> np.ndarray:
        """(N, S, 3) vertices at increasing `times` in seconds; the motion begins `before` the first, from rest."""
        time = times[0] - before
        now = self._carried(bones(time))
        velocity = np.zeros_like(now)
        frames = []
        for wanted in times:
            while time < wanted - 1e-9:
                step = min(STEP, wanted - time)
                time += step
                transforms = bones(time)
                now, velocity = self._advance(now, velocity, transforms, step)
            frames.append(now.copy())
        return np.array(frames)

    def _carried(self, transforms: np.ndarray) -> np.ndarray:
        return self.body.posed(transforms, self.rest, self.indices)

    def _advance(
        self, now: np.ndarray, velocity: np.ndarray, transforms: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities one step later."""
        velocity = velocity * (1 - DAMPING * step) + GRAVITY * step
        carried = self._carried(transforms)
        guess = np.where(self.free[:, None], now + velocity * step, carried)
        first, second = self.links.T
        weight = self.free.astype(float)
        share = weight[first] + weight[second]
        skin = self.body.posed(transforms, chosen=self.skin)
        outward = normals_of(skin, self.skin_faces)
        nearest = ((guess[:, None] - skin) ** 2).sum(axis=2).argmin(axis=1)
        skin, outward = skin[nearest], outward[nearest]
        for _ in range(ITERATIONS):
            apart = guess[second] - guess[first]
            length = np.linalg.norm(apart, axis=1)
            pull = (self.stiffness * (length - self.lengths) / np.maximum(length * np.maximum(share, 1), 1e-9))[:, None]
            change = np.zeros_like(guess)
            np.add.at(change, first, weight[first, None] * pull * apart)
            np.add.at(change, second, -weight[second, None] * pull * apart)
            guess += change / self.counts * 2.2
            depth = CLEARANCE - ((guess - skin) * outward).sum(axis=1)
            guess += np.where(self.free & (depth > 0), depth, 0)[:, None] * outward
        return guess, (guess - now) / step


class Hair:
    """Strands that hang around the head and lag behind its turns."""

    def __init__(self, body: Body, roots: np.ndarray, normals: np.ndarray, length: float, seed: int) -> None:
        """`roots`, `normals`: (R, 3) on the scalp at rest; `length` in meters."""
        self.body, self.bone = body, body.bone("head")
        random = np.random.default_rng(seed)
        self.center, self.radii = skull(body)
        points = 14
        step = length * random.uniform(0.82, 1.0, len(roots)) / (points - 1)
        layer = random.uniform(0.002, 0.016, len(roots))
        side = np.where(roots[:, 0] > PARTING, 1.0, -1.0)
        here, way = roots.copy(), 0.35 * normals
        way += np.stack([0.9 * side, np.full(len(roots), 0.35), np.zeros(len(roots))], axis=1)
        way += random.normal(0, 0.10, way.shape)
        strands = [here]
        for number in range(1, points):
            way = way / np.linalg.norm(way, axis=1, keepdims=True)
            way = way + np.array([0, 0.03, -0.5]) + random.normal(0, 0.03, way.shape)
            here = here + way / np.linalg.norm(way, axis=1, keepdims=True) * step[:, None]
            here = self._outside(here, layer * min(1.0, number / 3))
            way = here - strands[-1]
            strands.append(here)
        self.strands = np.stack(strands, axis=1)  # (R, P, 3) at rest

    def at(self, bones: Callable[[float], np.ndarray], time: float) -> np.ndarray:
        """(R, P, 3) strands at a time in seconds."""
        points = self.strands.shape[1]
        result = np.empty_like(self.strands)
        for number in range(points):
            moved = bones(time - 0.075 * (number / (points - 1)) ** 1.5)[self.bone]
            now = bones(time)[self.bone]
            lagging = self.strands[:, number] @ moved[:3, :3].T + moved[:3, 3]
            local = (lagging - now[:3, 3]) @ now[:3, :3]
            local = self._outside(local, 0.004)
            result[:, number] = local @ now[:3, :3].T + now[:3, 3]
        return result

    def _outside(self, points: np.ndarray, layer: np.ndarray | float) -> np.ndarray:
        """Points moved out of the head's ellipsoid, by a layer in meters."""
        radii = self.radii + np.asarray(layer)[..., None] * np.ones(3)
        relative = (points - self.center) / radii
        distance = np.linalg.norm(relative, axis=-1, keepdims=True)
        # Below the ears hair hangs freely behind and beside the neck.
        free = points[..., 2:] < self.center[2] - 0.075
        return np.where((distance < 1) & ~free, self.center + relative / np.maximum(distance, 1e-6) * radii, points)
