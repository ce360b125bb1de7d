"""Export of splat videos: the VideoGS layout, PLY, SPZ and GLB sequences, and movies along camera paths."""

from studio.export.camera_path import CameraPath, Key, read_path_keys, turntable, write_path_keys
from studio.export.movie import render_movie
from studio.export.movie_sound import movie_sound
from studio.export.rigid_motion import turned, upright
from studio.export.sequence import axes_of, export_frame, export_sequence
from studio.export.videogs import export_videogs

__all__ = [
    "CameraPath",
    "Key",
    "axes_of",
    "export_frame",
    "export_sequence",
    "export_videogs",
    "movie_sound",
    "read_path_keys",
    "render_movie",
    "turned",
    "turntable",
    "upright",
    "write_path_keys",
]
