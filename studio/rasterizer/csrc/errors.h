// Errors that the kernels raise. Defined once, outside the code that is compiled per instruction set.
#pragma once

namespace vs {

// Throws std::length_error: the number of splats or of (tile, splat) pairs exceeds 32 bits.
[[noreturn]] void throw_too_many_tiles();

}  // namespace vs
