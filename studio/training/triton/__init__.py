"""The kernels of training on an NVIDIA GPU, in Triton, which is imported when they are first used."""
