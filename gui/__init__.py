"""The window. Widgets are in `widgets`, state is in `models` (which do not use Open3D)."""

import sys
from types import ModuleType

# Open3D imports Dash, which takes a second, for functions that draw in a browser. Nothing here calls them.
_drawing = ModuleType("open3d.visualization.draw_plotly")
vars(_drawing).update(dict.fromkeys(("get_plotly_fig", "draw_plotly", "draw_plotly_server")))
sys.modules.setdefault(_drawing.__name__, _drawing)
