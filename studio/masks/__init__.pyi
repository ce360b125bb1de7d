from .mask_source import MaskSource
from .matting_function import FunctionMaskSource, MattingFunction

__all__ = ["FunctionMaskSource", "MaskSource", "MattingFunction"]
