from .mask_source import MaskSource
from .matting_function import FunctionMaskSource, MaskFunction

__all__ = ["FunctionMaskSource", "MaskFunction", "MaskSource"]
