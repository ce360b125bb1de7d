// Inputs and outputs of the kernels, and the function table through which an instruction set is selected at run time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "buffers.h"

namespace vs {

constexpr int TILE = 32;  // tile size, pixels
constexpr int SLOT = 10;  // values per (tile, splat) pair in the backward pass; see `Slot` in backward.h

// As in studio/rasterizer/types.py.
constexpr double DILATION = 0.3;
constexpr double ALPHA_MIN_LOG2 = -7.99435343685885793770;  // log2(1/255)
constexpr double TRANSMITTANCE_MIN = 1.00001e-4;

struct Camera {
    double rotation[9], translation[3], center[3];
    double fx, fy, cx, cy;
    double limits[4];  // x/z min, max, y/z min, max for the linearization of the projection
    int width, height;
    double near, alpha_max;
};

template <typename T>
struct Splats {
    std::int64_t count;
    int coefficients;  // 1, 4, 9 or 16
    const T *means, *quats, *log_scales, *logits, *sh;
    const T* offsets;  // (N, 2) pixels; may be null
};

// A projected splat; one cache line in float. With dx, dy from the 2D mean to the pixel, u = a dx + b dy and v = c dy,
// alpha = 2^(log2_opacity - u^2 - v^2). (a, b, c) is the Cholesky factor of the conic (inverse 2D covariance), scaled
// for base 2. At a given dy the splat is centered at dx = slant dy, and u changes by 1 per `width` pixels.
template <typename T>
struct alignas(16 * sizeof(T)) Projected {
    T x, y, a, b, c, log2_opacity;
    T color[3], depth;
    T slant, width;
    std::int16_t left, top, right, bottom;  // inclusive box of pixels that may reach alpha 1/255; empty if left > right
    std::uint32_t slot;                     // first of the splat's slots: one per tile of its box, row by row
    std::uint8_t visible, clamped;          // clamped: bit c is set if color c was below 0
};

template <typename T>
struct Intersection {                                                                   // an entry of a tile's list
    typename std::conditional<sizeof(T) == 4, std::uint32_t, std::uint64_t>::type key;  // depth, as sortable bits
    std::uint32_t splat;
};

// What the backward pass needs from the forward pass.
template <typename T>
struct Frame {
    Camera camera;
    std::int64_t count = 0;
    int tiles_x = 0, tiles_y = 0;
    std::uint64_t pairs = 0;  // number of (tile, splat) intersections
    Buffer<Projected<T>> projected;
    Buffer<Intersection<T>> intersections;  // sorted by depth within each tile
    Buffer<std::uint32_t> starts;           // (tiles + 1,) first intersection of each tile
    Buffer<std::uint32_t> order;            // tiles, longest lists first
};

template <typename T>
struct Outputs {
    const T* background;               // (3,)
    T *image, *alpha, *depth, *radii;  // (H, W, 3), (H, W), (H, W), (N,)
};

template <typename T>
struct Gradients {
    const T *image, *alpha, *depth;        // outputs of the forward pass
    const T *d_image, *d_alpha, *d_depth;  // may be null
    T *d_means, *d_quats, *d_log_scales, *d_logits, *d_sh;
    T* d_offsets;  // may be null
};

struct LossJob {
    int width, height;
    const float *image, *target;  // (H, W, 3)
    double dssim_weight;
    float* gradient;  // may be null
    double l1, ssim;  // results: means over pixels and channels
};

// The kernels, compiled for one instruction set.
struct Kernels {
    const char* name;
    void (*forward_float)(const Splats<float>&, const Outputs<float>&, Frame<float>&, int threads);
    void (*forward_double)(const Splats<double>&, const Outputs<double>&, Frame<double>&, int threads);
    void (*backward_float)(const Splats<float>&, const Gradients<float>&, const Frame<float>&, int threads);
    void (*backward_double)(const Splats<double>&, const Gradients<double>&, const Frame<double>&, int threads);
    void (*loss)(LossJob&, int threads);
};

extern const Kernels kernels_baseline;
#if defined(VS_HAVE_X86_64_V3)
extern const Kernels kernels_x86_64_v3;
#endif

}  // namespace vs
