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

template <typename T, int BYTES>
struct VectorOf {
    typedef T V __attribute__((vector_size(BYTES)));
};
template <typename T>
using Vec = typename VectorOf<T, LANES * sizeof(T)>::V;
// What comparisons of such vectors give.
template <typename T>
using Mask = decltype(Vec<T>{} < Vec<T>{});

using VFloat = Vec<float>;
using VDouble = Vec<double>;
using VInt32 = Mask<float>;
using VInt64 = Mask<double>;

template <typename T>
VS_INLINE Vec<T> broadcast(T value) {
    return Vec<T>{} + value;
}

// Loads a vector, of eight lanes or of another width.
template <typename T, typename V = Vec<T>>
VS_INLINE V load(const T* p) {
    V v;
    __builtin_memcpy(&v, p, sizeof(v));
    return v;
}
template <typename T, typename V>
VS_INLINE void store(T* p, V v) {
    __builtin_memcpy(p, &v, sizeof(v));
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

// 2^x of a vector of any width. Float: for -126 < x < 127 with a relative error below 2e-7; undefined outside that
// range. Adding the magic number 1.5 * 2^23 rounds x and leaves the integer part in the low mantissa bits. The fraction
// goes through a minimax polynomial of degree 5 on [-1/2, 1/2].
template <typename V>
VS_INLINE V vexp2(V x) {
    if constexpr (sizeof(x[0]) == 8) {
        for (int i = 0; i < int(sizeof(V) / 8); i++) x[i] = __builtin_exp2(x[i]);
        return x;
    } else {
        using I = decltype(x < x);
        const V magic = V{} + 12582912.0f;
        V shifted = x + magic;
        V f = x - (shifted - magic);
        V p = V{} + 1.3276538e-3f;
        p = p * f + 9.6755400e-3f;
        p = p * f + 5.5507133e-2f;
        p = p * f + 2.4022120e-1f;
        p = p * f + 6.9314697e-1f;
        p = p * f + 1.0000001f;
        return (V)((I)p + ((I)shifted << 23));
    }
}

// log2(x) of a vector of any width, for positive normal x in float. The error is about 1e-7 times max(1, |result|).
template <typename V>
VS_INLINE V vlog2(V x) {
    if constexpr (sizeof(x[0]) == 8) {
        for (int i = 0; i < int(sizeof(V) / 8); i++) x[i] = __builtin_log2(x[i]);
        return x;
    } else {
        using I = decltype(x < x);
        I i = (I)x;
        I e = (i - 0x3f3504f3) >> 23;  // puts the mantissa into [sqrt(1/2), sqrt(2))
        V m = (V)(i - (e << 23));
        V s = (m - 1.0f) / (m + 1.0f);
        V s2 = s * s;
        V p = V{} + 0.32059890f;  // 2 / (9 ln 2), then 2 / (7 ln 2) ...
        p = p * s2 + 0.41219859f;
        p = p * s2 + 0.57707802f;
        p = p * s2 + 0.96179669f;
        p = p * s2 + 2.8853901f;
        return __builtin_convertvector(e, V) + p * s;
    }
}

// e^x as 2^(x log2 e), compensated for the rounding of the product. 0 or infinity outside the range of the type.
VS_INLINE VFloat vexp(VFloat x) {
    const float high = 1.44269502f, low = 1.92596299e-8f;  // log2(e) as a sum of two floats
    VFloat t = x * high;
    VFloat whole = (t + 12582912.0f) - 12582912.0f;
    VFloat part = (x * high - whole) + x * low;
    VFloat y = vexp2(whole + part);
    y = select<float>(t < -125.0f, VFloat{}, y);
    return select<float>(t > 126.0f, broadcast<float>(__builtin_inff()), y);
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

// The widest vectors of the instruction set, for loops that do not depend on the number of lanes: 64 bytes with
// AVX-512, else 32.

#if defined(__AVX512F__)
#define VS_WIDE_BYTES 64
#else
#define VS_WIDE_BYTES 32
#endif

template <typename T>
using Wide = typename VectorOf<T, VS_WIDE_BYTES>::V;
template <typename T>
constexpr int WIDTH = VS_WIDE_BYTES / int(sizeof(T));

using WFloat = Wide<float>;
using WDouble = Wide<double>;

template <typename T>
VS_INLINE Wide<T> wide_all(T x) {
    return Wide<T>{} + x;
}
// The sum of the lanes, halves first.
template <typename T>
VS_INLINE T wide_sum(Wide<T> v) {
    T lanes[WIDTH<T>];
    store(lanes, v);
    for (int half = WIDTH<T> / 2; half > 0; half /= 2)
        for (int i = 0; i < half; i++) lanes[i] += lanes[i + half];
    return lanes[0];
}

// 2^x; 0 below -120 in float.
VS_INLINE WFloat wide_exp2(WFloat x) {
    const WFloat tiny = WFloat{} - 120.0f;
    return x < tiny ? WFloat{} : vexp2(x < tiny ? tiny : x);
}
VS_INLINE WDouble wide_exp2(WDouble x) { return vexp2(x); }

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
