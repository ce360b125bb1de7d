// The table of kernels for one instruction set. A source file defines VS_ISA (namespace and name of the table) and
// VS_ISA_NAME (what Python sees) and includes this header. Its compiler flags select the instructions.
#pragma once

#include "coded.h"
#include "field.h"
#include "isa_namespace.h"
#include "kernels.h"
#include "loss.h"
#include "random.h"
#include "rasterize.h"

#if !defined(VS_ISA_NAME)
#define VS_ISA_NAME "baseline"
#endif

#define VS_JOIN2(a, b) a##b
#define VS_JOIN(a, b) VS_JOIN2(a, b)

#define VS_KERNELS(T)                                                                                         \
    {VS_ISA::forward<T>,    VS_ISA::backward<T>,      VS_ISA::field_forward<T>,    VS_ISA::field_backward<T>, \
     VS_ISA::coded_loss<T>, VS_ISA::planes_values<T>, VS_ISA::planes_gradients<T>, VS_ISA::dropout<T>}

namespace vs {

const Kernels VS_JOIN(kernels_, VS_ISA) = {
    VS_ISA_NAME, VS_ISA::photometric_loss, VS_ISA::over_color, VS_KERNELS(float), VS_KERNELS(double),
};

}  // namespace vs
