// Forward pass over one tile: alpha blending from front to back.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa_namespace.h"
#include "kernels.h"
#include "pixel_lanes.h"
#include "simd.h"
#include "tiles.h"

namespace vs::VS_ISA {

template <typename T>
struct ForwardPixel {
    PixelVec<T> transmittance, weight_sum, red, green, blue, depth;
};

// Blends a tile's intersections, sorted by depth, and writes its pixels and the blocks that each touches.
template <typename T>
static void blend_tile(const Camera& camera, const TileBox& box, const Projected<T>* projected,
                       const Intersection<T>* list, std::uint32_t count, const Outputs<T>& out, std::uint64_t* kept) {
    using L = PixelLanes<T>;
    using V = typename L::V;
    using M = typename L::M;
    ForwardPixel<T> pixels[BLOCKS<T>];
    PixelGrid<T> grid;
    PixelGrid<T>::init(grid);
    BlockSet<T> active = init_pixels<T>(box, grid, pixels);
    for (ForwardPixel<T>& state : pixels) state.weight_sum = state.red = state.green = state.blue = state.depth = V{};
    const V alpha_min_log2 = L::all(T(ALPHA_MIN_LOG2)), alpha_max = L::all(T(camera.alpha_max)),
            transmittance_min = L::all(T(TRANSMITTANCE_MIN));
    Batch<T> batch;
    std::uint32_t n = 0;
    while (n < count && active.any()) {
        n = batch.template fill<true>(projected, list, n, count, box, active, kept);
        for (int k = 0; k < batch.size; k++) {
            const Projected<T>& p = *batch.splats[k];
            const BlockSet<T> touched = batch.touched[k];
            const SplatInTile<T> shape = SplatInTile<T>::of(p, box);
            const V r = L::all(p.color[0]), g = L::all(p.color[1]), b = L::all(p.color[2]), z = L::all(p.depth);
            for (int w = 0; w < BlockSet<T>::WORDS; w++)
                for (std::uint64_t remaining = touched.word[w] & active.word[w]; remaining != 0;
                     remaining &= remaining - 1) {
                    const int i = __builtin_ctzll(remaining) + 64 * w;
                    V u, v, log2_alpha = shape.log2_alpha(grid, i, u, v);
                    ForwardPixel<T>& pixel = pixels[i];
                    V transmittance = pixel.transmittance;
                    M hit = L::both(L::ge(log2_alpha, alpha_min_log2), L::gt(transmittance, V{}));
                    V weight = L::keep(hit, L::min(L::exp2(log2_alpha), alpha_max)) * transmittance;
                    V next_transmittance = transmittance - weight;
                    M finishes = L::both(hit, L::le(next_transmittance, transmittance_min));
                    if (__builtin_expect(L::any(finishes), 0)) {
                        weight = L::clear(finishes, weight);
                        next_transmittance = L::select(finishes, -transmittance, next_transmittance);
                        if (!L::any(L::gt(next_transmittance, V{}))) active.word[w] &= ~(std::uint64_t(1) << (i % 64));
                    }
                    pixel.transmittance = next_transmittance;
                    pixel.weight_sum += weight;  // not 1 - transmittance, which cancels where little is drawn
                    pixel.red += weight * r;
                    pixel.green += weight * g;
                    pixel.blue += weight * b;
                    pixel.depth += weight * z;
                }
        }
    }
    for (std::size_t i = std::size_t(n) * BlockSet<T>::WORDS; i < std::size_t(count) * BlockSet<T>::WORDS; i++)
        kept[i] = 0;  // behind finished pixels
    for (int y = 0; y < box.height; y++) {
        const std::int64_t row = std::int64_t(box.top + y) * camera.width + box.left;
        for (int x = 0; x < box.width; x++) {
            const int i = (y / BLOCK_H<T>)*BLOCKS_X + x / BLOCK_W, lane = y % BLOCK_H<T> * BLOCK_W + x % BLOCK_W;
            const T signed_t = pixels[i].transmittance[lane], transmittance = signed_t < 0 ? -signed_t : signed_t,
                    weight_sum = pixels[i].weight_sum[lane];
            T* rgb = out.image + 3 * (row + x);
            const T* bg = out.background + out.background_stride * (row + x);
            rgb[0] = pixels[i].red[lane] + transmittance * bg[0];
            rgb[1] = pixels[i].green[lane] + transmittance * bg[1];
            rgb[2] = pixels[i].blue[lane] + transmittance * bg[2];
            out.alpha[row + x] =
                transmittance < T(0.5) ? T(1) - transmittance : weight_sum;  // whichever is more accurate
            out.depth[row + x] = weight_sum > 0 ? pixels[i].depth[lane] / weight_sum : T(0);
        }
    }
}

// A tile that no splat touches.
template <typename T>
static void fill_background(const Camera& camera, const TileBox& box, const Outputs<T>& out) {
    for (int y = box.top; y < box.top + box.height; y++)
        for (std::int64_t i = std::int64_t(y) * camera.width + box.left, end = i + box.width; i < end; i++) {
            const T* bg = out.background + out.background_stride * i;
            for (int c = 0; c < 3; c++) out.image[3 * i + c] = bg[c];
            out.alpha[i] = out.depth[i] = 0;
        }
}

}  // namespace vs::VS_ISA
