from .depths import DepthMap, depth_maps
from .set_splats import SetPoints, first_points, plate_psnr, train_set

__all__ = ["DepthMap", "SetPoints", "depth_maps", "first_points", "plate_psnr", "train_set"]
