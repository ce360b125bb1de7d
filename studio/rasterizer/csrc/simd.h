// Vectors of eight floats or doubles, written with the vector extensions of GCC and clang. The compiler maps them to
// the instructions of the target: 2 x SSE, AVX2, 2 x NEON.
#pragma once

#include <cstdint>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

#include "isa_namespace.h"

namespace vs::VS_ISA {

constexpr int LANES = 8;

#define VS_INLINE static inline __attribute__((always_inline))

typedef float VFloat __attribute__((vector_size(32)));
typedef double VDouble __attribute__((vector_size(64)));
typedef int32_t VInt32 __attribute__((vector_size(32)));
typedef int64_t VInt64 __attribute__((vector_size(64)));

template <typename T>
struct VecOf;
template <>
struct VecOf<float> {
    using V = VFloat;
    using M = VInt32;
    using Bits = uint32_t;
};
template <>
struct VecOf<double> {
    using V = VDouble;
    using M = VInt64;
    using Bits = uint64_t;
};
template <typename T>
using Vec = typename VecOf<T>::V;
template <typename T>
using Mask = typename VecOf<T>::M;

template <typename T>
VS_INLINE Vec<T> broadcast(T value) {
    return Vec<T>{} + value;
}

template <typename T>
VS_INLINE Vec<T> load(const T* p) {
    Vec<T> v;
    __builtin_memcpy(&v, p, sizeof(v));
    return v;
}
template <typename T>
VS_INLINE void store(T* p, Vec<T> v) {
    __builtin_memcpy(p, &v, sizeof(v));
}

template <typename T>
VS_INLINE Mask<T> ge(Vec<T> a, Vec<T> b) {
    return (Mask<T>)(a >= b);
}
template <typename T>
VS_INLINE Mask<T> gt(Vec<T> a, Vec<T> b) {
    return (Mask<T>)(a > b);
}
template <typename T>
VS_INLINE Mask<T> lt(Vec<T> a, Vec<T> b) {
    return (Mask<T>)(a < b);
}
template <typename T>
VS_INLINE Mask<T> le(Vec<T> a, Vec<T> b) {
    return (Mask<T>)(a <= b);
}

// The value where the mask is set, else zero, even where the value is NaN.
template <typename T>
VS_INLINE Vec<T> zero_unless(Mask<T> m, Vec<T> a) {
    return (Vec<T>)((Mask<T>)a & m);
}
template <typename T>
VS_INLINE Vec<T> select(Mask<T> m, Vec<T> a, Vec<T> b) {
    return (Vec<T>)(((Mask<T>)a & m) | ((Mask<T>)b & ~m));
}
// Minimum and maximum. Where the first argument is NaN, the result is the second.
template <typename T>
VS_INLINE Vec<T> vmin(Vec<T> a, Vec<T> b) {
    return a < b ? a : b;
}
template <typename T>
VS_INLINE Vec<T> vmax(Vec<T> a, Vec<T> b) {
    return a > b ? a : b;
}

// One bit per lane.
VS_INLINE unsigned movemask(VInt32 m) {
#if defined(__AVX__)
    return unsigned(_mm256_movemask_ps((__m256)m));
#elif defined(__SSE2__)
    __m128 half[2];
    __builtin_memcpy(half, &m, sizeof(m));
    return unsigned(_mm_movemask_ps(half[0]) | _mm_movemask_ps(half[1]) << 4);
#else
    const VInt32 weights = {1, 2, 4, 8, 16, 32, 64, 128};
    VInt32 w = m & weights;
    return unsigned(w[0] | w[1] | w[2] | w[3] | w[4] | w[5] | w[6] | w[7]);
#endif
}
VS_INLINE unsigned movemask(VInt64 m) {
    unsigned out = 0;
    for (int i = 0; i < LANES; i++) out |= unsigned(m[i] & 1) << i;
    return out;
}
VS_INLINE bool any(VInt32 m) {
#if defined(__SSE2__)
    return movemask(m) != 0;
#else
    typedef int64_t FourInt64 __attribute__((vector_size(32)));
    FourInt64 halves = (FourInt64)m;
    return (halves[0] | halves[1] | halves[2] | halves[3]) != 0;
#endif
}
VS_INLINE bool any(VInt64 m) { return (m[0] | m[1] | m[2] | m[3] | m[4] | m[5] | m[6] | m[7]) != 0; }

VS_INLINE VFloat vsqrt(VFloat a) {
#if defined(__AVX__)
    return (VFloat)_mm256_sqrt_ps((__m256)a);
#else
    for (int i = 0; i < LANES; i++) a[i] = __builtin_sqrtf(a[i]);
    return a;
#endif
}
VS_INLINE VDouble vsqrt(VDouble a) {
    for (int i = 0; i < LANES; i++) a[i] = __builtin_sqrt(a[i]);
    return a;
}

// 2^x for -126 < x < 127 with a relative error below 2e-7; undefined outside that range. Adding the magic number
// 1.5 * 2^23 rounds x and leaves the integer part in the low mantissa bits. The fraction goes through a minimax
// polynomial of degree 5 on [-1/2, 1/2].
VS_INLINE VFloat vexp2(VFloat x) {
    const VFloat magic = broadcast<float>(12582912.0f);
    VFloat shifted = x + magic;
    VFloat f = x - (shifted - magic);
    VFloat p = broadcast<float>(1.3276538e-3f);
    p = p * f + 9.6755400e-3f;
    p = p * f + 5.5507133e-2f;
    p = p * f + 2.4022120e-1f;
    p = p * f + 6.9314697e-1f;
    p = p * f + 1.0000001f;
    return (VFloat)((VInt32)p + ((VInt32)shifted << 23));
}
VS_INLINE VDouble vexp2(VDouble x) {
    for (int i = 0; i < LANES; i++) x[i] = __builtin_exp2(x[i]);
    return x;
}

// log2(x) for positive normal x. The error is about 1e-7 times max(1, |result|).
VS_INLINE VFloat vlog2(VFloat x) {
    VInt32 i = (VInt32)x;
    VInt32 e = (i - 0x3f3504f3) >> 23;  // puts the mantissa into [sqrt(1/2), sqrt(2))
    VFloat m = (VFloat)(i - (e << 23));
    VFloat s = (m - 1.0f) / (m + 1.0f);
    VFloat s2 = s * s;
    VFloat p = broadcast<float>(0.32059890f);  // 2 / (9 ln 2), then 2 / (7 ln 2) ...
    p = p * s2 + 0.41219859f;
    p = p * s2 + 0.57707802f;
    p = p * s2 + 0.96179669f;
    p = p * s2 + 2.8853901f;
    return __builtin_convertvector(e, VFloat) + p * s;
}
VS_INLINE VDouble vlog2(VDouble x) {
    for (int i = 0; i < LANES; i++) x[i] = __builtin_log2(x[i]);
    return x;
}

// e^x as 2^(x log2 e), compensated for the rounding of the product. 0 or infinity outside the range of the type.
VS_INLINE VFloat vexp(VFloat x) {
    const float high = 1.44269502f, low = 1.92596299e-8f;  // log2(e) as a sum of two floats
    VFloat t = x * high;
    VFloat whole = (t + 12582912.0f) - 12582912.0f;
    VFloat part = (x * high - whole) + x * low;
    VFloat y = vexp2(whole + part);
    y = select<float>(lt<float>(t, broadcast<float>(-125.0f)), broadcast<float>(0.0f), y);
    return select<float>(gt<float>(t, broadcast<float>(126.0f)), broadcast<float>(__builtin_inff()), y);
}
VS_INLINE VDouble vexp(VDouble x) {
    for (int i = 0; i < LANES; i++) x[i] = __builtin_exp(x[i]);
    return x;
}

// Transposes an 8x8 matrix whose rows are the eight vectors, in place.
template <typename V>
VS_INLINE void transpose(V r[8]) {
    V a[8];
    for (int i = 0; i < 4; i++) {
        a[2 * i] = __builtin_shufflevector(r[2 * i], r[2 * i + 1], 0, 8, 2, 10, 4, 12, 6, 14);
        a[2 * i + 1] = __builtin_shufflevector(r[2 * i], r[2 * i + 1], 1, 9, 3, 11, 5, 13, 7, 15);
    }
    V b[8];
    for (int h = 0; h < 8; h += 4)
        for (int i = 0; i < 2; i++) {
            b[h + i] = __builtin_shufflevector(a[h + i], a[h + i + 2], 0, 1, 8, 9, 4, 5, 12, 13);
            b[h + i + 2] = __builtin_shufflevector(a[h + i], a[h + i + 2], 2, 3, 10, 11, 6, 7, 14, 15);
        }
    for (int i = 0; i < 4; i++) {
        r[i] = __builtin_shufflevector(b[i], b[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        r[i + 4] = __builtin_shufflevector(b[i], b[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}

template <typename T>
VS_INLINE T sum(Vec<T> v) {
    return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

}  // namespace vs::VS_ISA
