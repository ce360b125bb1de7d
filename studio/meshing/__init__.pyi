from .hull import Hull
from .initialize import InitResult, initialize_points
from .settings import InitializeSettings
from .surface import Mesh, sample_surface
from .visual_hull import HullResult, visual_hull

__all__ = [
    "Hull",
    "HullResult",
    "InitResult",
    "InitializeSettings",
    "Mesh",
    "initialize_points",
    "sample_surface",
    "visual_hull",
]
