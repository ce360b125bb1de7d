"""The kernels of training on an NVIDIA GPU, in Triton, which compiles them when they are first used.

These modules import Triton, and are only imported when it is needed. With TRITON_INTERPRET=1, set before, the same code
runs on the CPU.
"""
