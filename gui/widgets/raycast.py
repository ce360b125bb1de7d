"""Shaded meshes rendered by ray casting on the CPU (Open3D with Embree); no GPU is needed."""

from pathlib import Path

import numpy as np
import open3d as o3d

from v3studio.gui.drawing.palette import GROUND, SECOND
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError


class RaycastMesh:
    """A triangle mesh of a PLY file, rendered from any camera. Raises StudioError: `mesh.unreadable`."""

    def __init__(self, path: Path) -> None:
        mesh = o3d.t.io.read_triangle_mesh(str(path)) if path.is_file() else None
        if mesh is None or mesh.is_empty() or "indices" not in mesh.triangle:
            problem = "no readable triangle mesh"
            raise StudioError("mesh.unreadable", problem, file=path, stage="initialize")
        mesh.compute_vertex_normals()
        self.faces = len(mesh.triangle.indices)
        self._triangles = mesh.triangle.indices.numpy()
        self._normals = mesh.vertex.normals.numpy()
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(mesh)

    def seen(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """(H, W, 3) uint8 RGB, gray, lit from the upper left; and (H, W) float32 depth, infinite beside the mesh."""
        rays = o3d.t.geometry.RaycastingScene.create_rays_pinhole(
            o3d.core.Tensor(camera.cv2_K), o3d.core.Tensor(camera.world_to_camera), camera.width, camera.height
        )
        hits = self._scene.cast_rays(rays)
        depth = hits["t_hit"].numpy()  # the rays are 1 long along the viewing axis
        hit = np.isfinite(depth)
        pixels = np.empty((camera.height, camera.width, 3), np.uint8)
        pixels[:] = GROUND
        corners = self._triangles[hits["primitive_ids"].numpy()[hit]]
        u, v = hits["primitive_uvs"].numpy()[hit].T
        weights = np.stack([1 - u - v, u, v], axis=1)
        normals = (self._normals[corners] * weights[..., None]).sum(axis=1)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        light = camera.rotation.T @ np.array([-0.4, -0.6, -0.7]) / 1.005
        shade = 0.22 + 0.78 * np.clip(np.abs(normals @ light), 0, 1)
        pixels[hit] = (shade[:, None] * np.array(SECOND)).astype(np.uint8)
        return pixels, depth
