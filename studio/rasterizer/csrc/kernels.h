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
constexpr double ALPHA_MIN_LOG2 = -7.99435343685885793770;  // log2(1/255)
constexpr double TRANSMITTANCE_MIN = 1.00001e-4;

struct Camera {
    double rotation[9], translation[3], center[3];
    double fx, fy, cx, cy;
    double limits[4];  // x/z min, max, y/z min, max for the linearization of the projection
    int width, height;
    double near, alpha_max;
    double dilation;  // added to the diagonal of the 2D covariances, square pixels
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

struct Kernels;

// What the backward pass needs from the forward pass.
template <typename T>
struct Frame {
    Camera camera;
    const Kernels* kernels = nullptr;  // that made it; `touched` has their size of blocks
    std::int64_t count = 0;
    int tiles_x = 0, tiles_y = 0;
    std::uint64_t pairs = 0;  // number of (tile, splat) intersections
    Buffer<Projected<T>> projected;
    Buffer<Intersection<T>> intersections;  // sorted by depth within each tile
    Buffer<std::uint64_t> touched;          // blocks of its tile that each intersection touches, as bits
    Buffer<std::uint32_t> starts;           // (tiles + 1,) first intersection of each tile
    Buffer<std::uint32_t> order;            // tiles, longest lists first
};

template <typename T>
struct Outputs {
    const T* background;               // (3,), or (H, W, 3)
    int background_stride;             // 0 or 3
    T *image, *alpha, *depth, *radii;  // (H, W, 3), (H, W), (H, W), (N,)
};

template <typename T>
struct Gradients {
    const T *image, *alpha, *depth;        // outputs of the forward pass
    const T *d_image, *d_alpha, *d_depth;  // may be null
    T *d_means, *d_quats, *d_log_scales, *d_logits, *d_sh, *d_offsets;  // each may be null: not needed
};

struct LossJob {
    int width, height;
    const float *image, *target;  // (H, W, 3)
    double dssim_weight;
    float* gradient;  // may be null
    double l1, ssim;  // results: means over pixels and channels
};

struct OverJob {
    std::int64_t pixels;
    const float* image;  // (pixels, 3)
    const float* rest;   // (pixels,) how much of the color is added
    const float* color;  // (3,)
    float* out;          // (pixels, 3)
};

constexpr int MAX_FIELD_LAYERS = 8;

struct FieldShape {
    int levels, features;  // of the hash grid
    int layers, hidden;    // hidden layers of the MLP, and their width
};

template <typename T>
struct FieldJob {
    FieldShape shape;
    std::int64_t count;
    const std::int32_t* rows;                // (L, N, 8) rows of the table
    const T* corner_weights;                 // (L, N, 8)
    const std::int64_t* level_rows;          // (L + 1,) first row of each level
    const T* table;                          // (rows, F)
    const T* weights[MAX_FIELD_LAYERS + 1];  // (outputs, inputs) of each layer
    const T* biases[MAX_FIELD_LAYERS + 1];   // (outputs,)
    T scale;                                 // of the output
};

template <typename T>
struct FieldGradients {
    const T* d_out;  // (N, 3)
    T* d_table;
    T* d_weights[MAX_FIELD_LAYERS + 1];
    T* d_biases[MAX_FIELD_LAYERS + 1];
};

template <typename T>
struct CodedJob {
    std::int64_t count;
    int channels;
    const T *current, *previous;  // (N, C)
    const T *steps, *mu, *sigma;  // (C,); mu and sigma in steps
    std::uint32_t seed;           // of the rounding noise
    T bits_weight, difference_weight;
    T* gradient;               // (N, C) of the weighted sum of both; may be null
    double bits, difference;   // results: sums
    double *by_mu, *by_sigma;  // (C,) results: derivatives of the bits
};

template <typename T>
struct PlanesJob {
    std::int64_t count;
    int coefficients;
    const T *quats, *log_scales, *logits, *sh;
    const T* reference;  // (N, 4) quaternions that choose the signs
};

template <typename T>
struct PlanesGradients {
    const T *values, *d_values;  // (N, 8 + 3 K)
    T *d_quats, *d_log_scales, *d_logits, *d_sh;
};

template <typename T>
struct DropoutJob {
    std::int64_t count;
    const T* logits;
    double share;
    std::uint32_t seed;
    T *out, *derivative;  // (N,)
};

// The kernels for one type.
template <typename T>
struct TypedKernels {
    void (*forward)(const Splats<T>&, const Outputs<T>&, Frame<T>&, int threads);
    void (*backward)(const Splats<T>&, const Gradients<T>&, const Frame<T>&, int threads);
    void (*field_forward)(const FieldJob<T>&, Buffer<T>& activations, T* out, int threads);
    void (*field_backward)(const FieldJob<T>&, const Buffer<T>& activations, const FieldGradients<T>&, int threads);
    void (*coded_loss)(CodedJob<T>&, int threads);
    void (*planes_values)(const PlanesJob<T>&, T* values, int threads);
    void (*planes_gradients)(const PlanesJob<T>&, const PlanesGradients<T>&, int threads);
    void (*dropout)(const DropoutJob<T>&, int threads);
};

// The kernels, compiled for one instruction set.
struct Kernels {
    const char* name;
    void (*loss)(LossJob&, int threads);
    void (*over)(const OverJob&, int threads);
    TypedKernels<float> of_float;
    TypedKernels<double> of_double;

    template <typename T>
    const TypedKernels<T>& of() const {
        if constexpr (sizeof(T) == 4)
            return of_float;
        else
            return of_double;
    }
};

extern const Kernels kernels_baseline;
#if defined(VS_HAVE_X86_64)
extern const Kernels kernels_x86_64_v3;
extern const Kernels kernels_x86_64_v4;
#endif

}  // namespace vs
