from .hull import Hull as Hull
from .initialize import InitResult as InitResult
from .initialize import initialize_points as initialize_points
from .settings import InitializeSettings as InitializeSettings
from .surface import Mesh as Mesh
from .surface import sample_surface as sample_surface
from .visual_hull import HullResult as HullResult
from .visual_hull import visual_hull as visual_hull
