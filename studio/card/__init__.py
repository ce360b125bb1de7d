"""The card of a capture: time, cameras, masks and color, measured on a few frames and graded."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # imported on first use; see __init__.pyi
