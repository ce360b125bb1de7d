"""Triangle mesh of a hull, and depth maps of a mesh."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from v3studio.studio.atomic_files import atomic_path
from v3studio.studio.cameras import Camera
from v3studio.studio.counts import short_repr
from v3studio.studio.errors import StudioError
from v3studio.studio.meshing.hull import Hull
from v3studio.studio.process import logged

_LOG = logging.getLogger(__name__)

_FILTERS = threading.Lock()


def open3d() -> Any:
    """The open3d module, imported on first use; untyped, because its stubs do not accept arrays and strings."""
    import open3d as module

    return module


@dataclass
class Mesh:
    """A triangle mesh: (V, 3) float64 world coordinates, (F, 3) int32 vertex indices, counterclockwise from outside."""

    vertices: np.ndarray
    faces: np.ndarray

    __repr__ = short_repr

    def to_open3d(self) -> Any:
        """Convert to an `open3d.geometry.TriangleMesh`."""
        o3d = open3d()
        return o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(self.vertices), o3d.utility.Vector3iVector(self.faces)
        )

    @property
    def corners(self) -> np.ndarray:
        """(F, 3, 3): the vertices of each face."""
        return self.vertices[self.faces]

    @property
    def areas(self) -> np.ndarray:
        """(F,) areas of the faces in square world units."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)

    @property
    def vertex_normals(self) -> np.ndarray:
        """(V, 3) unit normals, weighted by area."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        normal = np.cross(b - a, c - a)
        total = np.zeros_like(self.vertices)
        for corner in range(3):
            for axis in range(3):
                total[:, axis] += np.bincount(self.faces[:, corner], normal[:, axis], len(self.vertices))
        return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)

    def save(self, path: Path | str) -> None:
        """Write a PLY file, atomically; StudioError: `mesh.unwritable`."""
        with atomic_path(Path(path)) as temporary:
            if not open3d().io.write_triangle_mesh(str(temporary), self.to_open3d(), print_progress=False):
                fix = "Check the free disk space and the permissions of the folder."
                raise StudioError("mesh.unwritable", "cannot write the mesh", file=path, fix=fix)

    @classmethod
    def load(cls, path: Path | str) -> Mesh:
        """Read a mesh file (PLY, OBJ, ...); StudioError: `mesh.missing` or `mesh.unreadable`."""
        if not Path(path).is_file():
            raise StudioError("mesh.missing", "mesh file not found", file=path)
        mesh = open3d().io.read_triangle_mesh(str(path))
        if len(mesh.triangles) == 0:
            problem = "the file contains no readable triangles"
            raise StudioError("mesh.unreadable", problem, file=path, fix="Create the file again.")
        return cls(np.array(mesh.vertices, np.float64), np.array(mesh.triangles, np.int32))


def smooth_field(field: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian smoothing of a (Z, Y, X) float32 field, standard deviation `sigma` voxels; replicates border values."""
    if sigma <= 0:
        return field
    reach = max(1, round(3 * sigma))
    taps = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=torch.float32) / sigma) ** 2)
    taps /= taps.sum()
    volume = torch.from_numpy(np.ascontiguousarray(field))
    for axis in range(3):
        # Shifted sums need less memory than conv3d and are faster on machines with few cores.
        padded = torch.movedim(volume, axis, 0)
        padded = torch.cat([padded[:1].expand(reach, -1, -1), padded, padded[-1:].expand(reach, -1, -1)])
        length = padded.shape[0] - 2 * reach
        total = padded[:length] * taps[0]
        for tap in range(1, 2 * reach + 1):
            total.add_(padded[tap : tap + length], alpha=float(taps[tap]))
        volume = torch.movedim(total, 0, axis)
    return volume.contiguous().numpy()


_LEAST_COMPONENT = 0.01  # components whose area is below this fraction of the largest one's are removed


def extract_surface(hull: Hull, smoothing: float) -> Mesh:
    """The surface of a hull by marching cubes, normals outward; empty if no voxel is inside. `refined` is slow."""
    o3d = open3d()
    field = smooth_field(hull.field, smoothing)
    if not (field > 0).any():
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    # Exact zeros at voxels would produce degenerate triangles.
    field = np.where(np.abs(field) < 1e-6 * hull.voxel, np.float32(-1e-6 * hull.voxel), field)
    raw = o3d.t.geometry.TriangleMesh.create_isosurfaces(o3d.core.Tensor(np.ascontiguousarray(field)), [0.0])
    vertices = raw.vertex.positions.numpy().astype(np.float64) * hull.voxel + hull.origin
    mesh = Mesh(vertices, raw.triangle.indices.numpy().astype(np.int32))
    return _large_components(mesh)


def _large_components(mesh: Mesh) -> Mesh:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    # of vertices; Open3D's clustering of triangles takes 40 times as long
    faces, count = mesh.faces, len(mesh.vertices)
    edges = (np.concatenate([faces[:, 0], faces[:, 1]]), np.concatenate([faces[:, 1], faces[:, 2]]))
    graph = coo_matrix((np.ones(len(edges[0]), np.int8), edges), (count, count))
    components, of_vertex = connected_components(graph, directed=False)
    label = of_vertex[faces[:, 0]]
    area = np.bincount(label, mesh.areas, components)
    faces = faces[area[label] >= _LEAST_COMPONENT * area.max()]
    if len(faces) == len(mesh.faces):
        return mesh
    used = np.zeros(count, bool)
    used[faces] = True
    return Mesh(mesh.vertices[used], (np.cumsum(used) - 1).astype(np.int32)[faces])


def refined(mesh: Mesh, max_faces: int) -> Mesh:
    """The mesh, smoothed, decimated to `max_faces` and made manifold with PyMeshLab's filters; see `extract_surface`.

    One thread at a time: the filters share state, and two at once damaged the heap.
    """
    if len(mesh.faces) == 0:
        return mesh

    import pymeshlab

    with _FILTERS, logged(_LOG, f"PyMeshLab's filters of {len(mesh.faces)} faces"):
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int32)))
        meshes.apply_coord_taubin_smoothing(stepsmoothnum=10)
        if len(mesh.faces) > max_faces:
            meshes.meshing_decimation_quadric_edge_collapse(
                targetfacenum=max_faces, preservenormal=True, preservetopology=True
            )
        meshes.meshing_repair_non_manifold_edges()
        meshes.meshing_remove_unreferenced_vertices()
        refined = meshes.current_mesh()
        return Mesh(refined.vertex_matrix(), refined.face_matrix().astype(np.int32))


class MeshViews:
    """Casts rays at one mesh from many cameras."""

    def __init__(self, mesh: Mesh) -> None:
        o3d = open3d()
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            o3d.core.Tensor(mesh.vertices.astype(np.float32)), o3d.core.Tensor(mesh.faces.astype(np.uint32))
        )

    def depth(self, camera: Camera) -> np.ndarray:
        """(H, W) float32 depth along the optical axis at each pixel center; infinity where no surface is hit."""
        o3d = open3d()
        columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        local = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(camera.K).T
        directions = local @ camera.rotation  # their third component in camera coordinates is 1, so t is the depth
        rays = np.empty((camera.height, camera.width, 6), np.float32)
        rays[..., :3] = camera.center
        rays[..., 3:] = directions
        return self._scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()


def sample_surface(mesh: Mesh, count: int, *, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Sample `count` (at least 1) points by area, (count, 3) float32, with unit normals interpolated between the
    vertices.

    The total area is divided into `count` equal parts along the list of faces, and one point is drawn from each part
    (stratified sampling). This distributes points more evenly than independent draws, without a neighbor search.
    StudioError: `mesh.point_count`: `count` is below 1; `mesh.no_area`.
    """
    if count < 1:
        problem = f"The number of points is {count}"
        raise StudioError("mesh.point_count", problem, value=count, fix="It must be at least 1.")
    total = np.cumsum(mesh.areas)
    if len(total) == 0 or not total[-1] > 0:
        problem = "The mesh has no area to sample points from"
        raise StudioError("mesh.no_area", problem, fix="Check the masks and the camera poses.")
    random = np.random.default_rng(seed)
    place = (np.arange(count) + random.random(count)) / count * total[-1]
    face = np.minimum(np.searchsorted(total, place, side="right"), len(total) - 1)
    root, second = np.sqrt(random.random(count)), random.random(count)
    weights = np.stack([1 - root, root * (1 - second), root * second], 1)  # uniform in a triangle
    points = (mesh.corners[face] * weights[:, :, None]).sum(1)
    normals = (mesh.vertex_normals[mesh.faces[face]] * weights[:, :, None]).sum(1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return points.astype(np.float32), normals.astype(np.float32)
