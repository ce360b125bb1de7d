// Random numbers from a counter: element i of the stream `seed` is a hash of both, so any thread can draw any element.
// studio/training/noise.py defines the same numbers in PyTorch. Dropout of splats draws them.
#pragma once

#include <cstdint>

#include "isa_namespace.h"
#include "kernels.h"
#include "simd.h"
#include "threads.h"

namespace vs::VS_ISA {

// 24 random bits, for integers and for vectors of them.
template <typename U>
VS_INLINE U random_bits(U index, std::uint32_t seed) {
    U x = index * 0x9E3779B9u + seed;
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x >> 8;
}

// Dropout of splats by their opacity. The definition is studio/training/dropout.py.
constexpr int DROPOUT_BLOCK = 4096;
constexpr double DROPPED_LOGIT = -30, LEAST_OPACITY = 1e-6, MOST_OPACITY = 0.995;  // as in dropout.py

// Writes the logits to draw, and their derivatives by the logits.
template <typename T>
static void dropout(const DropoutJob<T>& job, int threads) {
    using V = Vec<T>;
    const V low = broadcast<T>(T(LEAST_OPACITY)), high = broadcast<T>(T(MOST_OPACITY));
    const T raise = T(1 / (1 - job.share));
    const std::uint32_t limit = std::uint32_t(job.share * 16777216.0);
    auto block = [&](int task) {
        const std::int64_t begin = std::int64_t(task) * DROPOUT_BLOCK;
        for (std::int64_t n = begin; n < begin + DROPOUT_BLOCK && n < job.count; n += LANES) {
            const int valid = job.count - n < LANES ? int(job.count - n) : LANES;
            T lanes[LANES] = {}, slopes[LANES];
            for (int i = 0; i < valid; i++) lanes[i] = job.logits[n + i];
            const V opacity = T(1) / (T(1) + vexp(-load<T>(lanes)));
            const V raised = opacity * raise;
            const V drawn = vmin<T>(vmax<T>(raised, low), high), left = T(1) - drawn;
            const V slope = raise * opacity * (T(1) - opacity) / (drawn * left);
            const Mask<T> inside = (raised >= low) & (raised <= high);
            store<T>(lanes, T(0.69314718055994531) * (vlog2(drawn) - vlog2(left)));
            store<T>(slopes, zero_unless<T>(inside, slope));
            for (int i = 0; i < valid; i++) {
                const bool dropped = random_bits(std::uint32_t(n) + std::uint32_t(i), job.seed) < limit;
                job.out[n + i] = dropped ? T(DROPPED_LOGIT) : lanes[i];
                job.derivative[n + i] = dropped ? T(0) : slopes[i];
            }
        }
    };
    parallel_for(int((job.count + DROPOUT_BLOCK - 1) / DROPOUT_BLOCK), threads, block);
}

}  // namespace vs::VS_ISA
