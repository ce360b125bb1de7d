// The vectors of the tile loops, one lane per pixel of a block: blocks of 4x2 pixels, or of 4x4 for float with AVX-512,
// whose comparisons give one bit per lane instead of a vector.
#pragma once

#include <cstdint>

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

#include "isa_namespace.h"
#include "simd.h"

namespace vs::VS_ISA {

#define VS_MEMBER static inline __attribute__((always_inline))

template <typename T>
struct PixelLanes {
    using V = Vec<T>;
    using M = Mask<T>;
    static constexpr int BLOCK_H = 2;
    VS_MEMBER V x() {
        const V lanes = {0, 1, 2, 3, 0, 1, 2, 3};
        return lanes;
    }
    VS_MEMBER V y() {
        const V lanes = {0, 0, 0, 0, 1, 1, 1, 1};
        return lanes;
    }
    VS_MEMBER V all(T value) { return broadcast<T>(value); }
    VS_MEMBER M ge(V a, V b) { return a >= b; }
    VS_MEMBER M gt(V a, V b) { return a > b; }
    VS_MEMBER M le(V a, V b) { return a <= b; }
    VS_MEMBER M lt(V a, V b) { return a < b; }
    VS_MEMBER M both(M a, M b) { return a & b; }
    VS_MEMBER bool any(M m) { return VS_ISA::any(m); }
    VS_MEMBER V keep(M m, V a) { return zero_unless<T>(m, a); }    // zero elsewhere
    VS_MEMBER V clear(M m, V a) { return zero_unless<T>(~m, a); }  // zero where the mask is set
    VS_MEMBER V select(M m, V a, V b) { return VS_ISA::select<T>(m, a, b); }
    VS_MEMBER V min(V a, V b) { return vmin<T>(a, b); }  // b where a is NaN
    VS_MEMBER V exp2(V a) { return vexp2(a); }
    VS_MEMBER Vec<T> eight(V a) { return a; }  // partial sums over pixels, in eight lanes
};

#if defined(__AVX512F__)
template <>
struct PixelLanes<float> {
    typedef float V __attribute__((vector_size(64)));
    using M = __mmask16;
    static constexpr int BLOCK_H = 4;
    VS_MEMBER V x() {
        const V lanes = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
        return lanes;
    }
    VS_MEMBER V y() {
        const V lanes = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
        return lanes;
    }
    VS_MEMBER V all(float value) { return V{} + value; }
    VS_MEMBER M ge(V a, V b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_GE_OQ); }
    VS_MEMBER M gt(V a, V b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_GT_OQ); }
    VS_MEMBER M le(V a, V b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LE_OQ); }
    VS_MEMBER M lt(V a, V b) { return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LT_OQ); }
    VS_MEMBER M both(M a, M b) { return M(a & b); }
    VS_MEMBER bool any(M m) { return m != 0; }
    VS_MEMBER V keep(M m, V a) { return (V)_mm512_maskz_mov_ps(m, (__m512)a); }
    VS_MEMBER V clear(M m, V a) { return (V)_mm512_maskz_mov_ps(M(~m), (__m512)a); }
    VS_MEMBER V select(M m, V a, V b) { return (V)_mm512_mask_mov_ps((__m512)b, m, (__m512)a); }
    VS_MEMBER V min(V a, V b) { return (V)_mm512_min_ps((__m512)a, (__m512)b); }
    VS_MEMBER V exp2(V a) { return vexp2(a); }
    VS_MEMBER VFloat eight(V a) {
        VFloat half[2];
        __builtin_memcpy(half, &a, sizeof(a));
        return half[0] + half[1];
    }
};
#endif

}  // namespace vs::VS_ISA
