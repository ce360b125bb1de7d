// All kernels for one instruction set. A source file defines VS_ISA (the table's name) and VS_ISA_NAME and includes
// this; its compiler flags choose the instructions.

#include <cstddef>
#include <cstdint>
#include <type_traits>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "kernels.h"
#include "threads.h"

namespace vs {

[[noreturn]] void throw_too_many();

namespace VS_ISA {
// clang-format off
#include "simd.h"
#include "attributes.h"
#include "project.h"
#include "tiles.h"
#include "blend.h"
#include "backward.h"
#include "rasterize.h"
#include "loss.h"
// clang-format on
}  // namespace VS_ISA

#define VS_TABLE2(name) kernels_##name
#define VS_TABLE(name) VS_TABLE2(name)

const Kernels VS_TABLE(VS_ISA) = {
    VS_ISA_NAME,
    VS_ISA::forward<float>,
    VS_ISA::forward<double>,
    VS_ISA::backward<float>,
    VS_ISA::backward<double>,
    VS_ISA::photometric_loss,
};

}  // namespace vs
