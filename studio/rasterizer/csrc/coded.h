// The losses on the values that a stream codes: bits of the quantized residuals (paper equations 8 to 11), difference
// to the previous frame (equation 12); and the coded values themselves. The definitions are
// studio/training/coded_loss.py and studio/stream/coded_values.py.
#pragma once

#include <cstddef>
#include <cstdint>

#include "buffers.h"
#include "isa_namespace.h"
#include "kernels.h"
#include "random.h"
#include "simd.h"
#include "threads.h"

namespace vs::VS_ISA {

constexpr int CODED_BLOCK = 1024;  // splats that share one sum; a multiple of the lanes of any vector

// Bits of a residual r of a normal distribution, P = Phi((r + 1/2 - mu) / sigma) - Phi((r - 1/2 - mu) / sigma), and
// their derivatives by r and by sigma. Mirrored to the upper tail and computed relative to the nearer end of the
// interval, so that it is exact where P underflows.
template <typename T>
struct Bits {
    Wide<T> bits, by_residual, by_sigma;
};

template <typename T>
VS_INLINE Bits<T> bits_of(Wide<T> centered, Wide<T> inverse_sigma) {
    using V = Wide<T>;
    const T LOG2E = T(1.4426950408889634), ROOT_HALF = T(0.70710678118654752), ROOT_2PI = T(0.39894228040143268);
    const V zero{};
    const V size = centered < zero ? -centered : centered;
    const V low = (size - T(0.5)) * inverse_sigma, high = (size + T(0.5)) * inverse_sigma;
    const V distance = low < zero ? -low : low;
    const V tail_low = wide_erfcx(distance * ROOT_HALF), tail_high = wide_erfcx(high * ROOT_HALF);
    const V log_low = T(-0.5) * LOG2E * distance * distance, log_high = T(-0.5) * LOG2E * high * high;
    const V density_low = wide_exp2(log_low), density_high = wide_exp2(log_high);
    const V ratio = wide_exp2(log_high - log_low);
    // P, divided by 2^log_low where the interval does not contain the mean.
    V p = low < zero ? T(1) - T(0.5) * (density_low * tail_low + density_high * tail_high)
                     : T(0.5) * (tail_low - ratio * tail_high);
    const V least = wide_all<T>(T(1e-30));
    p = p < least ? least : p;
    const V scale = ROOT_2PI / p;
    const V slope_low = low < zero ? density_low * scale : scale;
    const V slope_high = low < zero ? density_high * scale : ratio * scale;
    const V by_size = LOG2E * inverse_sigma * (slope_low - slope_high);
    return {-vlog2(p) - (low < zero ? zero : log_low), centered < zero ? -by_size : by_size,
            LOG2E * inverse_sigma * (high * slope_high - low * slope_low)};
}

// Uniform in [-1/2, 1/2).
VS_INLINE WFloat rounding_noise(std::int64_t first, std::uint32_t seed, float) {
    Wide<std::uint32_t> index;
    for (int i = 0; i < WIDTH<float>; i++) index[i] = std::uint32_t(first) + std::uint32_t(i);
    return __builtin_convertvector((Wide<std::int32_t>)random_bits(index, seed), WFloat) * (1.0f / 16777216.0f) - 0.5f;
}
VS_INLINE WDouble rounding_noise(std::int64_t first, std::uint32_t seed, double) {
    WDouble noise{};
    for (int i = 0; i < WIDTH<double>; i++)
        noise[i] = double(random_bits(std::uint32_t(first) + std::uint32_t(i), seed)) / 16777216.0 - 0.5;
    return noise;
}

// Rows of channels are read as they are: WIDTH rows are as many vectors as there are channels, and each of these
// vectors has the same pattern of channels everywhere.
template <typename T>
static void coded_loss(CodedJob<T>& job, int threads) {
    using V = Wide<T>;
    constexpr int W = WIDTH<T>;
    const int channels = job.channels;
    const int blocks = int((job.count + CODED_BLOCK - 1) / CODED_BLOCK);
    enum { STEP, INVERSE_STEP, MU, INVERSE_SIGMA, PATTERNS };
    Buffer<T> pattern_values(std::size_t(PATTERNS * W) * std::size_t(channels));
    T* pattern[PATTERNS];
    for (int k = 0; k < PATTERNS; k++) pattern[k] = pattern_values.get() + std::ptrdiff_t(k) * W * channels;
    for (int i = 0; i < W * channels; i++) {
        const int c = i % channels;
        pattern[STEP][i] = job.steps[c];
        pattern[INVERSE_STEP][i] = T(1) / job.steps[c];
        pattern[MU][i] = job.mu[c];
        pattern[INVERSE_SIGMA][i] = T(1) / job.sigma[c];
    }
    // per block: bits, difference, then derivatives by mu and sigma of each channel
    const std::size_t per_block = 2 + 2 * std::size_t(channels);
    Buffer<double> sums(per_block * std::size_t(blocks));
    Buffer<T> lanes(std::size_t(4 * W) * std::size_t(channels) * std::size_t(blocks));
    const bool entropy = job.bits_weight != 0, temporal = job.difference_weight != 0;

    auto block = [&](int task) {
        T* by_mu = lanes.get() + std::size_t(4 * W) * std::size_t(channels) * std::size_t(task);
        T *by_sigma = by_mu + W * channels, *bits = by_sigma + W * channels, *differences = bits + W * channels;
        for (int i = 0; i < 4 * W * channels; i++) by_mu[i] = 0;
        const std::int64_t begin = std::int64_t(task) * CODED_BLOCK * channels, total = job.count * channels;
        std::int64_t end = begin + std::int64_t(CODED_BLOCK) * channels;
        if (end > total) end = total;
        int at = 0;  // in the pattern
        for (std::int64_t i = begin; i < end; i += W) {
            const int valid = end - i < W ? int(end - i) : W;
            T rest[2][W] = {};
            if (valid < W)
                for (int k = 0; k < valid; k++) rest[0][k] = job.current[i + k], rest[1][k] = job.previous[i + k];
            const V change = valid == W ? load<T, V>(job.current + i) - load<T, V>(job.previous + i)
                                        : load<T, V>(rest[0]) - load<T, V>(rest[1]);
            const V zero{};
            V gradient{}, counted = wide_all<T>(T(1));
            if (valid < W)
                for (int k = valid; k < W; k++) counted[k] = 0;
            if (entropy) {
                const V inverse_step = load<T, V>(pattern[INVERSE_STEP] + at);
                const Bits<T> b = bits_of<T>(
                    change * inverse_step + rounding_noise(i, job.seed, T(0)) - load<T, V>(pattern[MU] + at),
                    load<T, V>(pattern[INVERSE_SIGMA] + at));
                gradient += job.bits_weight * inverse_step * b.by_residual;
                store<T>(bits + at, load<T, V>(bits + at) + counted * b.bits);
                store<T>(by_mu + at, load<T, V>(by_mu + at) - counted * b.by_residual);
                store<T>(by_sigma + at, load<T, V>(by_sigma + at) + counted * b.by_sigma);
            }
            if (temporal) {
                const V value = change < zero ? -change : change;
                const V slope = change > zero ? wide_all<T>(T(1)) : (change < zero ? wide_all<T>(T(-1)) : zero);
                gradient += job.difference_weight * slope;
                store<T>(differences + at, load<T, V>(differences + at) + counted * value);
            }
            if (job.gradient != nullptr) {
                if (valid == W)
                    store<T>(job.gradient + i, gradient);
                else
                    for (int k = 0; k < valid; k++) job.gradient[i + k] = gradient[k];
            }
            at = at + W == W * channels ? 0 : at + W;
        }
        double* out = sums.get() + per_block * std::size_t(task);
        for (std::size_t i = 0; i < per_block; i++) out[i] = 0;
        for (int i = 0; i < W * channels; i++) {
            out[0] += double(bits[i]);
            out[1] += double(differences[i]);
            out[2 + i % channels] += double(by_mu[i]);
            out[2 + channels + i % channels] += double(by_sigma[i]);
        }
    };
    parallel_for(blocks, threads, block);

    job.bits = job.difference = 0;
    for (int c = 0; c < channels; c++) job.by_mu[c] = job.by_sigma[c] = 0;
    for (int b = 0; b < blocks; b++) {
        const double* part = sums.get() + per_block * std::size_t(b);
        job.bits += part[0];
        job.difference += part[1];
        for (int c = 0; c < channels; c++) {
            job.by_mu[c] += part[2 + c];
            job.by_sigma[c] += part[2 + channels + c];
        }
    }
}

// Coded values: the unit quaternion whose sign is nearer to `reference`, log scales, opacity, SH.
template <typename T>
static void planes_values(const PlanesJob<T>& job, T* values, int threads) {
    const int floats = 3 * job.coefficients, channels = 8 + floats;
    auto block = [&](int task) {
        const std::int64_t begin = std::int64_t(task) * CODED_BLOCK;
        for (std::int64_t n = begin; n < begin + CODED_BLOCK && n < job.count; n += LANES) {
            const int valid = job.count - n < LANES ? int(job.count - n) : LANES;
            T logits[LANES] = {}, opacities[LANES];
            for (int i = 0; i < valid; i++) logits[i] = job.logits[n + i];
            store<T>(opacities, T(1) / (T(1) + vexp(-load<T>(logits))));
            for (int i = 0; i < valid; i++) {
                const T *q = job.quats + 4 * (n + i), *r = job.reference + 4 * (n + i);
                T* to = values + (n + i) * channels;
                T length = T(__builtin_sqrt(double(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])));
                length = length < T(1e-12) ? T(1e-12) : length;
                const T dot = q[0] * r[0] + q[1] * r[1] + q[2] * r[2] + q[3] * r[3];
                const T scale = (dot < 0 ? T(-1) : T(1)) / length;
                for (int k = 0; k < 4; k++) to[k] = q[k] * scale;
                for (int k = 0; k < 3; k++) to[4 + k] = job.log_scales[3 * (n + i) + k];
                to[7] = opacities[i];
                for (int k = 0; k < floats; k++) to[8 + k] = job.sh[(n + i) * floats + k];
            }
        }
    };
    parallel_for(int((job.count + CODED_BLOCK - 1) / CODED_BLOCK), threads, block);
}

template <typename T>
static void planes_gradients(const PlanesJob<T>& job, const PlanesGradients<T>& grad, int threads) {
    const int floats = 3 * job.coefficients, channels = 8 + floats;
    auto block = [&](int task) {
        const std::int64_t begin = std::int64_t(task) * CODED_BLOCK;
        for (std::int64_t n = begin; n < begin + CODED_BLOCK && n < job.count; n++) {
            const T *q = job.quats + 4 * n, *v = grad.values + n * channels, *g = grad.d_values + n * channels;
            T length = T(__builtin_sqrt(double(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])));
            length = length < T(1e-12) ? T(1e-12) : length;
            const T scale = (q[0] * v[0] + q[1] * v[1] + q[2] * v[2] + q[3] * v[3] < 0 ? T(-1) : T(1)) / length;
            const T along = v[0] * g[0] + v[1] * g[1] + v[2] * g[2] + v[3] * g[3];
            for (int k = 0; k < 4; k++) grad.d_quats[4 * n + k] = (g[k] - v[k] * along) * scale;
            for (int k = 0; k < 3; k++) grad.d_log_scales[3 * n + k] = g[4 + k];
            grad.d_logits[n] = g[7] * v[7] * (T(1) - v[7]);
            for (int k = 0; k < floats; k++) grad.d_sh[n * floats + k] = g[8 + k];
        }
    };
    parallel_for(int((job.count + CODED_BLOCK - 1) / CODED_BLOCK), threads, block);
}

}  // namespace vs::VS_ISA
