"""Geometry from masks: visual hull, its surface, colored points on it."""

from studio.meshing.hull import Hull, HullSettings
from studio.meshing.initialize import InitResult, initialize_points
from studio.meshing.sampling import sample_surface
from studio.meshing.silhouettes import Silhouettes
from studio.meshing.surface import Mesh
from studio.meshing.visual_hull import HullResult, visual_hull
from studio.views import ViewLike

__all__ = [
    "Hull",
    "HullResult",
    "HullSettings",
    "InitResult",
    "Mesh",
    "Silhouettes",
    "ViewLike",
    "initialize_points",
    "sample_surface",
    "visual_hull",
]
