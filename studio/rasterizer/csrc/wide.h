// The widest vectors of the instruction set, for loops that do not depend on the number of lanes: 64 bytes with
// AVX-512, else 32.
#pragma once

#include <cstdint>

#include "isa_namespace.h"
#include "simd.h"

namespace vs::VS_ISA {

#if defined(__AVX512F__)
#define VS_WIDE_BYTES 64
#else
#define VS_WIDE_BYTES 32
#endif

typedef float WFloat __attribute__((vector_size(VS_WIDE_BYTES)));
typedef double WDouble __attribute__((vector_size(VS_WIDE_BYTES)));
typedef int32_t WInt32 __attribute__((vector_size(VS_WIDE_BYTES)));
typedef uint32_t WUint32 __attribute__((vector_size(VS_WIDE_BYTES)));

template <typename T>
struct WideOf;
template <>
struct WideOf<float> {
    using V = WFloat;
};
template <>
struct WideOf<double> {
    using V = WDouble;
};
template <typename T>
using Wide = typename WideOf<T>::V;
template <typename T>
constexpr int WIDTH = VS_WIDE_BYTES / int(sizeof(T));

template <typename T>
VS_INLINE Wide<T> wide_load(const T* p) {
    Wide<T> v;
    __builtin_memcpy(&v, p, sizeof(v));
    return v;
}
template <typename T>
VS_INLINE void wide_store(T* p, Wide<T> v) {
    __builtin_memcpy(p, &v, sizeof(v));
}
template <typename T>
VS_INLINE Wide<T> wide_all(T x) {
    return Wide<T>{} + x;
}
// The sum of the lanes, halves first.
template <typename T>
VS_INLINE T wide_sum(Wide<T> v) {
    T lanes[WIDTH<T>];
    wide_store<T>(lanes, v);
    for (int half = WIDTH<T> / 2; half > 0; half /= 2)
        for (int i = 0; i < half; i++) lanes[i] += lanes[i + half];
    return lanes[0];
}

// 2^x; 0 below -120 in float. The polynomial is that of vexp2.
VS_INLINE WFloat wide_exp2(WFloat x) {
    const WFloat magic = WFloat{} + 12582912.0f;
    const WFloat tiny = WFloat{} - 120.0f;
    WFloat clamped = x < tiny ? tiny : x;
    WFloat shifted = clamped + magic;
    WFloat f = clamped - (shifted - magic);
    WFloat p = WFloat{} + 1.3276538e-3f;
    p = p * f + 9.6755400e-3f;
    p = p * f + 5.5507133e-2f;
    p = p * f + 2.4022120e-1f;
    p = p * f + 6.9314697e-1f;
    p = p * f + 1.0000001f;
    WFloat y = (WFloat)((WInt32)p + ((WInt32)shifted << 23));
    return x < tiny ? WFloat{} : y;
}
VS_INLINE WDouble wide_exp2(WDouble x) {
    for (int i = 0; i < WIDTH<double>; i++) x[i] = __builtin_exp2(x[i]);
    return x;
}

// log2(x) for positive normal x, as vlog2.
VS_INLINE WFloat wide_log2(WFloat x) {
    WInt32 i = (WInt32)x;
    WInt32 e = (i - 0x3f3504f3) >> 23;
    WFloat m = (WFloat)(i - (e << 23));
    WFloat s = (m - 1.0f) / (m + 1.0f);
    WFloat s2 = s * s;
    WFloat p = WFloat{} + 0.32059890f;
    p = p * s2 + 0.41219859f;
    p = p * s2 + 0.57707802f;
    p = p * s2 + 0.96179669f;
    p = p * s2 + 2.8853901f;
    return __builtin_convertvector(e, WFloat) + p * s;
}
VS_INLINE WDouble wide_log2(WDouble x) {
    for (int i = 0; i < WIDTH<double>; i++) x[i] = __builtin_log2(x[i]);
    return x;
}

// exp(x^2) erfc(x) for x >= 0. Float: the Chebyshev fit of Numerical Recipes (relative error below 1.2e-7).
VS_INLINE WFloat wide_erfcx(WFloat x) {
    WFloat t = 1.0f / (1.0f + 0.5f * x);
    WFloat p = WFloat{} + 0.17087277f;
    p = p * t - 0.82215223f;
    p = p * t + 1.48851587f;
    p = p * t - 1.13520398f;
    p = p * t + 0.27886807f;
    p = p * t - 0.18628806f;
    p = p * t + 0.09678418f;
    p = p * t + 0.37409196f;
    p = p * t + 1.00002368f;
    p = p * t - 1.26551223f;
    return t * wide_exp2(p * 1.442695041f);
}
// Double: the asymptotic series where erfc would underflow.
VS_INLINE WDouble wide_erfcx(WDouble x) {
    for (int i = 0; i < WIDTH<double>; i++) {
        const double a = x[i], r = 1 / (2 * a * a);
        x[i] = a < 20 ? __builtin_exp(a * a) * __builtin_erfc(a)
                      : (1 - r * (1 - 3 * r * (1 - 5 * r * (1 - 7 * r)))) / (a * 1.7724538509055160273);
    }
    return x;
}

}  // namespace vs::VS_ISA
