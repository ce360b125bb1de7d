"""Geometry from masks: the visual hull, its surface, and colored points on it."""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from studio.meshing.hull import Hull
    from studio.meshing.initialize import InitResult, initialize_points
    from studio.meshing.sampling import sample_surface
    from studio.meshing.settings import InitializeSettings
    from studio.meshing.silhouettes import Silhouettes
    from studio.meshing.surface import Mesh
    from studio.meshing.visual_hull import HullResult, visual_hull
    from studio.views import ViewLike

__all__ = [
    "Hull",
    "HullResult",
    "InitResult",
    "InitializeSettings",
    "Mesh",
    "Silhouettes",
    "ViewLike",
    "initialize_points",
    "sample_surface",
    "visual_hull",
]

lazy_exports(__name__)
