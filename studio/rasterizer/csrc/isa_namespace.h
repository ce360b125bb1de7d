// VS_ISA, the namespace of all code that is compiled once per instruction set. It keeps the linker from merging a
// function that was compiled for a newer processor into the code for an older one.
#pragma once

// isa_*.cpp define it. The default lets tools such as clangd read each header alone.
#if !defined(VS_ISA)
#define VS_ISA baseline
#endif

#define VS_INLINE static inline __attribute__((always_inline))
