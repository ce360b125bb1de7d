from .mask_source import MaskSource as MaskSource
from .matting_function import FunctionMaskSource as FunctionMaskSource
from .matting_function import MaskFunction as MaskFunction
