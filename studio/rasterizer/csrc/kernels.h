// What the kernels take and give, and the table through which the one that fits the processor is called.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "buffers.h"

namespace vs {

constexpr int TILE = 32;                                    // side of a tile, pixels
constexpr int SLOT = 10;                                    // gradients a (tile, splat) pair: see `Slot` in rasterize.h
constexpr double DILATION = 0.3;                            // the definition's constants: studio/rasterizer/types.py
constexpr double ALPHA_MIN_LOG2 = -7.99435343685885793770;  // log2(1/255)
constexpr double TRANSMITTANCE_MIN = 1.00001e-4;

struct Camera {
    double rotation[9], translation[3], center[3];
    double fx, fy, cx, cy;
    double limits[4];  // x/z lowest, highest, y/z lowest, highest
    int width, height;
    double near, alpha_max;
};

template <typename T>
struct Splats {
    std::int64_t count;
    int coefficients;  // 1, 4, 9 or 16
    const T *means, *quats, *log_scales, *logits, *sh;
    const T* offsets;  // may be null
};

// A projected splat, one cache line in float. u = a dx + b dy and v = c dy, with dx, dy from the center to the pixel;
// alpha = 2^(log2_opacity - u^2 - v^2): the Cholesky factor of the inverse covariance, scaled for base 2. At a given dy
// the splat is centered at dx = slant dy, and u changes by 1 over `width` pixels.
template <typename T>
struct alignas(16 * sizeof(T)) Projected {
    T x, y, a, b, c, log2_opacity;
    T color[3], depth;
    T slant, width;
    std::int16_t left, top, right, bottom;  // pixels that may reach 1/255, inclusive; left > right: none
    std::uint32_t slot;                     // first of the splat's slots, one a tile of its box, row by row
    std::uint8_t visible, clamped;          // clamped: bit c set where color c was below 0
};

template <typename T>
struct Intersection {                                                                          // a splat in a tile's list
    typename std::conditional<sizeof(T) == 4, std::uint32_t, std::uint64_t>::type key;  // depth, as sortable bits
    std::uint32_t splat;
};

// What the backward pass needs of the forward pass.
template <typename T>
struct Frame {
    Camera camera;
    std::int64_t count = 0;
    int tiles_x = 0, tiles_y = 0;
    std::uint64_t pairs = 0;  // (tile, splat)
    Buffer<Projected<T>> projected;
    Buffer<Intersection<T>> intersections;      // sorted by depth within each tile
    Buffer<std::uint32_t> starts;  // (tiles + 1,) into intersections
    Buffer<std::uint32_t> order;   // tiles, the longest lists first
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
    double l1, ssim;  // results: means
};

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
