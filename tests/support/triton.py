"""Triton kernels in tests: interpreted on the CPU, and compiled for GPUs that are not there."""

import importlib.util
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

import pytest

from tests.support.warm_python import warm_python

needs_triton = pytest.mark.skipif(
    importlib.util.find_spec("triton") is None,
    reason="Triton is not installed; PyTorch's CUDA builds for Linux bring it",
)


def run_interpreted(files: Sequence[Path], count: int) -> None:
    """Run the tests of some files with Triton's interpreter; all `count` must pass."""
    command = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *files]
    # The variable is read when Triton is imported, so that this takes a process of its own.
    environment = {**os.environ, "TRITON_INTERPRET": "1", "OMP_NUM_THREADS": "1"}
    done = warm_python().run(command, env=environment, text=True, timeout=280)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    assert done.stdout.splitlines()[-1].startswith(f"{count} passed"), done.stdout


def compile_kernels(
    module: ModuleType,
    types: Mapping[str, str],
    warps: Mapping[str, int],
    capability: int,
    variants: Mapping[str, Sequence[Mapping[str, Any]]] = MappingProxyType({}),
) -> None:
    """Compile all public kernels of a module for a GPU, and see that none uses atomic operations.

    Args:
        types: Triton's types of the arguments that are not pointers to float32.
        warps: warps of each kernel; must name them all.
        capability: of the GPU, such as 90.
        variants: for kernels with constexpr arguments, the values of these with which to compile.
    """
    import triton
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource

    kernels = {name: kernel for name, kernel in vars(module).items() if isinstance(kernel, triton.JITFunction)}
    assert set(warps) == {name for name in kernels if not name.startswith("_")}
    for name, count in warps.items():
        for constants in variants.get(name, ({},)):
            known = {**types, **dict.fromkeys(constants, "constexpr")}
            signature = {argument: known.get(argument, "*fp32") for argument in kernels[name].arg_names}
            source = ASTSource(kernels[name], signature, dict(constants))
            options = {"num_warps": count, "enable_fp_fusion": True}
            compiled = triton.compile(source, target=GPUTarget("cuda", capability, 32), options=options)
            assert compiled.asm["cubin"][:4] == b"\x7fELF"
            assert f".target sm_{capability}" in compiled.asm["ptx"]
            # The order of atomic additions would change the bits.
            assert re.search(r"\b(atom|red)\.", compiled.asm["ptx"]) is None
            # TF32 would round what tl.dot multiplies to 10 bits.
            assert "tf32" not in compiled.asm["ptx"]
