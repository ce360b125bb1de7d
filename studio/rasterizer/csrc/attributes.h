// Attributes of eight splats at a time: loads and stores that transpose between rows and lanes, and spherical
// harmonics.
#pragma once

#include <cstdint>

#include "isa_namespace.h"
#include "simd.h"

namespace vs::VS_ISA {

// Loads `width` values per splat into one vector per value. Lanes past the end repeat the last splat.
template <typename T>
VS_INLINE void gather(const T* p, int width, std::int64_t first, std::int64_t count, Vec<T>* out) {
    T lanes[16][LANES];
    int valid = count - first < LANES ? int(count - first) : LANES;
    for (int i = 0; i < LANES; i++) {
        const T* row = p + (first + (i < valid ? i : valid - 1)) * width;
        for (int k = 0; k < width; k++) lanes[k][i] = row[k];
    }
    for (int k = 0; k < width; k++) out[k] = load<T>(lanes[k]);
}

template <typename T>
VS_INLINE void scatter(T* p, int width, std::int64_t first, int valid, const Vec<T>* values) {
    T lanes[16][LANES];
    for (int k = 0; k < width; k++) store<T>(lanes[k], values[k]);
    for (int i = 0; i < valid; i++)
        for (int k = 0; k < width; k++) p[(first + i) * width + k] = lanes[k][i];
}

// Like gather and scatter, for the long rows of SH coefficients: 8x8 transposes where all eight splats exist.
template <typename T>
VS_INLINE void gather_long(const T* p, int width, std::int64_t first, std::int64_t count, Vec<T>* out) {
    if (count - first < LANES) {
        T lanes[LANES];
        for (int k = 0; k < width; k++) {
            for (int i = 0; i < LANES; i++) lanes[i] = p[(first + i < count ? first + i : count - 1) * width + k];
            out[k] = load<T>(lanes);
        }
        return;
    }
    const T* base = p + first * width;
    int k = 0;
    for (; k + 8 <= width; k += 8) {
        Vec<T> r[8];
        for (int i = 0; i < 8; i++) r[i] = load<T>(base + i * width + k);
        transpose(r);
        for (int i = 0; i < 8; i++) out[k + i] = r[i];
    }
    for (; k < width; k++) {
        T lanes[LANES];
        for (int i = 0; i < LANES; i++) lanes[i] = base[i * width + k];
        out[k] = load<T>(lanes);
    }
}

// Prefetches the rows two steps ahead. SH coefficients are most of a splat's bytes and rarely in the cache.
template <typename T>
VS_INLINE void prefetch_ahead(const T* p, int width, std::int64_t first, std::int64_t count) {
    const std::int64_t ahead = first + 2 * LANES;
    if (ahead + LANES > count) return;
    const char* start = reinterpret_cast<const char*>(p + ahead * width);
    for (int byte = 0; byte < int(LANES * sizeof(T)) * width; byte += 64) __builtin_prefetch(start + byte);
}

template <typename T>
VS_INLINE void scatter_long(T* p, int width, std::int64_t first, int valid, Vec<T>* values) {
    T* base = p + first * width;
    int k = 0;
    if (valid == LANES)
        for (; k + 8 <= width; k += 8) {
            transpose(values + k);
            for (int i = 0; i < 8; i++) store<T>(base + i * width + k, values[k + i]);
        }
    for (; k < width; k++) {
        T lanes[LANES];
        store<T>(lanes, values[k]);
        for (int i = 0; i < valid; i++) base[i * width + k] = lanes[i];
    }
}

// The SH basis at unit directions and, with GRADIENT, its derivatives with respect to x, y, z as if independent.
template <typename T, bool GRADIENT>
VS_INLINE void sh_basis(int coefficients, Vec<T> x, Vec<T> y, Vec<T> z, Vec<T>* f, Vec<T>* fx, Vec<T>* fy, Vec<T>* fz) {
    using V = Vec<T>;
    const V zero{};
    f[0] = broadcast<T>(T(0.28209479177387814));
    if (GRADIENT) fx[0] = fy[0] = fz[0] = zero;
    if (coefficients < 4) return;
    const T c1 = T(0.4886025119029199);
    f[1] = -c1 * y, f[2] = c1 * z, f[3] = -c1 * x;
    if (GRADIENT) {
        fx[1] = fz[1] = fx[2] = fy[2] = fy[3] = fz[3] = zero;
        fy[1] = fx[3] = broadcast<T>(-c1);
        fz[2] = broadcast<T>(c1);
    }
    if (coefficients < 9) return;
    const T c2 = T(1.0925484305920792), c20 = T(0.31539156525252005), c22 = T(0.5462742152960396);
    V xx = x * x, yy = y * y, zz = z * z, xy = x * y, yz = y * z, xz = x * z;
    f[4] = c2 * xy, f[5] = -c2 * yz, f[6] = c20 * (T(3) * zz - T(1)), f[7] = -c2 * xz, f[8] = c22 * (xx - yy);
    if (GRADIENT) {
        fx[4] = c2 * y, fy[4] = c2 * x, fz[4] = zero;
        fx[5] = zero, fy[5] = -c2 * z, fz[5] = -c2 * y;
        fx[6] = fy[6] = zero, fz[6] = T(6) * c20 * z;
        fx[7] = -c2 * z, fy[7] = zero, fz[7] = -c2 * x;
        fx[8] = T(2) * c22 * x, fy[8] = T(-2) * c22 * y, fz[8] = zero;
    }
    if (coefficients < 16) return;
    const T c3 = T(0.5900435899266435), c3b = T(2.890611442640554), c3c = T(0.4570457994644658),
            c3d = T(0.3731763325901154), c3e = T(1.445305721320277);
    f[9] = -c3 * y * (T(3) * xx - yy);
    f[10] = c3b * xy * z;
    f[11] = -c3c * y * (T(5) * zz - T(1));
    f[12] = c3d * z * (T(5) * zz - T(3));
    f[13] = -c3c * x * (T(5) * zz - T(1));
    f[14] = c3e * z * (xx - yy);
    f[15] = -c3 * x * (xx - T(3) * yy);
    if (GRADIENT) {
        fx[9] = T(-6) * c3 * xy, fy[9] = T(-3) * c3 * (xx - yy), fz[9] = zero;
        fx[10] = c3b * yz, fy[10] = c3b * xz, fz[10] = c3b * xy;
        fx[11] = zero, fy[11] = -c3c * (T(5) * zz - T(1)), fz[11] = T(-10) * c3c * yz;
        fx[12] = fy[12] = zero, fz[12] = c3d * (T(15) * zz - T(3));
        fx[13] = -c3c * (T(5) * zz - T(1)), fy[13] = zero, fz[13] = T(-10) * c3c * xz;
        fx[14] = T(2) * c3e * xz, fy[14] = T(-2) * c3e * yz, fz[14] = c3e * (xx - yy);
        fx[15] = T(-3) * c3 * (xx - yy), fy[15] = T(6) * c3 * xy, fz[15] = zero;
    }
}

}  // namespace vs::VS_ISA
