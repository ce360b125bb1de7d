"""From the hull's field to a clean triangle mesh, and what the mesh looks like from each camera."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from studio.cameras import Camera
from studio.errors import StudioError
from studio.meshing.hull import Hull


def open3d() -> Any:
    """The open3d module, imported when first needed; untyped, because its stubs know neither arrays nor strings."""
    import open3d as module

    return module


@dataclass
class Mesh:
    """Triangles.

    Attributes:
        vertices: (V, 3) float64 world coordinates.
        faces: (F, 3) int32, counter-clockwise seen from outside.
    """

    vertices: np.ndarray
    faces: np.ndarray

    def to_open3d(self) -> Any:
        """The same as an `open3d.geometry.TriangleMesh`."""
        o3d = open3d()

        return o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(self.vertices), o3d.utility.Vector3iVector(self.faces)
        )

    @classmethod
    def from_open3d(cls, mesh: Any) -> Mesh:
        """From an `open3d.geometry.TriangleMesh`."""
        return cls(np.array(mesh.vertices, np.float64), np.array(mesh.triangles, np.int32))

    @property
    def corners(self) -> np.ndarray:
        """(F, 3, 3): the vertices of every face."""
        return self.vertices[self.faces]

    @property
    def areas(self) -> np.ndarray:
        """(F,) world units squared."""
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

    def save(self, path: Path) -> None:
        """Write as PLY, atomically."""
        o3d = open3d()

        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.stem}.{os.getpid()}.ply")
        try:
            if not o3d.io.write_triangle_mesh(str(temporary), self.to_open3d(), print_progress=False):
                raise StudioError(f"{path}: the mesh could not be written; check the disk and the permissions.")
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)

    @classmethod
    def load(cls, path: Path) -> Mesh:
        """Read a mesh file (PLY, OBJ, ...).

        Raises:
            StudioError: the file is missing or holds no triangles.
        """
        o3d = open3d()

        if not Path(path).is_file():
            raise StudioError(f"{path}: there is no such mesh file.")
        mesh = cls.from_open3d(o3d.io.read_triangle_mesh(str(path)))
        if len(mesh.faces) == 0:
            raise StudioError(f"{path}: the file holds no readable triangles; make it again.")
        return mesh


def smooth_field(field: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian smoothing of a (Z, Y, X) field, sigma in voxels; the border keeps its values."""
    if sigma <= 0:
        return field
    reach = max(1, round(3 * sigma))
    taps = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=torch.float32) / sigma) ** 2)
    taps /= taps.sum()
    volume = torch.from_numpy(np.ascontiguousarray(field))
    for axis in range(3):
        # Shifted sums instead of conv3d: less memory, and faster on few cores.
        padded = torch.movedim(volume, axis, 0)
        padded = torch.cat([padded[:1].expand(reach, -1, -1), padded, padded[-1:].expand(reach, -1, -1)])
        length = padded.shape[0] - 2 * reach
        total = padded[:length] * taps[0]
        for tap in range(1, 2 * reach + 1):
            total.add_(padded[tap : tap + length], alpha=float(taps[tap]))
        volume = torch.movedim(total, 0, axis)
    return volume.contiguous().numpy()


def extract_surface(
    hull: Hull, *, smoothing: float = 0.7, min_component: float = 0.01, max_faces: int = 100_000, taubin: int = 10
) -> Mesh:
    """The surface of a hull.

    Args:
        hull: the field.
        smoothing: of the field, in voxels.
        min_component: components with less than this share of the largest one's area are dropped.
        max_faces: decimated by quadric error above this.
        taubin: passes of Taubin smoothing (it does not shrink the mesh).

    Returns:
        a mesh with no loose vertices, normals outward; it may be empty (no voxel inside).
    """
    o3d = open3d()

    field = smooth_field(hull.field, smoothing)
    if not (field > 0).any():
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    # An exact zero on a voxel would give triangles without area.
    field = np.where(np.abs(field) < 1e-6 * hull.voxel, np.float32(-1e-6 * hull.voxel), field)
    raw = o3d.t.geometry.TriangleMesh.create_isosurfaces(o3d.core.Tensor(np.ascontiguousarray(field)), [0.0])
    vertices = raw.vertex.positions.numpy().astype(np.float64) * hull.voxel + hull.origin
    mesh = Mesh(vertices, raw.triangle.indices.numpy().astype(np.int32))
    return _refined(_large_pieces(mesh, min_component), taubin, max_faces)


def _large_pieces(mesh: Mesh, min_component: float) -> Mesh:
    """The mesh without components of less than `min_component` of the largest one's area."""
    o3d = open3d()

    whole = mesh.to_open3d()
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        label, _, area = whole.cluster_connected_triangles()
    label, area = np.asarray(label), np.asarray(area)
    if len(area) <= 1:
        return mesh
    whole.remove_triangles_by_mask(area[label] < min_component * area.max())
    whole.remove_unreferenced_vertices()
    return Mesh.from_open3d(whole)


def _refined(mesh: Mesh, taubin: int, max_faces: int) -> Mesh:
    """Smoothed, decimated where it has more than `max_faces`, and manifold: PyMeshLab's filters."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int32)))
    if taubin:
        meshes.apply_coord_taubin_smoothing(stepsmoothnum=taubin)
    if len(mesh.faces) > max_faces:
        meshes.meshing_decimation_quadric_edge_collapse(
            targetfacenum=max_faces, preservenormal=True, preservetopology=True
        )
    meshes.meshing_repair_non_manifold_edges()
    meshes.meshing_remove_unreferenced_vertices()
    refined = meshes.current_mesh()
    return Mesh(refined.vertex_matrix(), refined.face_matrix().astype(np.int32))


class MeshViews:
    """Ray casting of one mesh from many cameras."""

    def __init__(self, mesh: Mesh) -> None:
        o3d = open3d()

        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            o3d.core.Tensor(mesh.vertices.astype(np.float32)), o3d.core.Tensor(mesh.faces.astype(np.uint32))
        )

    def depth(self, camera: Camera) -> np.ndarray:
        """(H, W) float32: depth along the viewing axis at every pixel center, infinity where the mesh is not hit."""
        o3d = open3d()

        columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        local = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(camera.K).T
        directions = local @ camera.rotation  # third component in camera axes is 1, so t is the depth
        rays = np.empty((camera.height, camera.width, 6), np.float32)
        rays[..., :3] = camera.center
        rays[..., 3:] = directions
        return self._scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
