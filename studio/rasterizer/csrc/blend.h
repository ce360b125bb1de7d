// Forward pass over one tile: alpha blending from front to back.
#pragma once

#include <cstdint>

#include "isa_namespace.h"
#include "kernels.h"
#include "simd.h"
#include "tiles.h"

namespace vs::VS_ISA {

template <typename T>
struct ForwardPixel {
    Vec<T> transmittance, weight_sum, red, green, blue, depth;
};

// Blends a tile's intersections, sorted by depth, and writes its pixels.
template <typename T>
static void blend_tile(const Camera& camera, const TileBox& box, const Projected<T>* projected,
                       const Intersection<T>* list, std::uint32_t count, const Outputs<T>& out) {
    using V = Vec<T>;
    using M = Mask<T>;
    ForwardPixel<T> pixels[BLOCKS];
    PixelGrid<T> grid;
    PixelGrid<T>::init(grid);
    BlockSet active = init_pixels<T>(box, grid, pixels);
    for (ForwardPixel<T>& state : pixels) state.weight_sum = state.red = state.green = state.blue = state.depth = V{};
    const V alpha_min_log2 = broadcast<T>(T(ALPHA_MIN_LOG2)), alpha_max = broadcast<T>(T(camera.alpha_max)),
            transmittance_min = broadcast<T>(T(TRANSMITTANCE_MIN));
    Batch<T> batch;
    for (std::uint32_t n = 0; n < count && (active.half[0] | active.half[1]) != 0;) {
        n = batch.fill(projected, list, n, count, box, active);
        for (int k = 0; k < batch.size; k++) {
            const Projected<T>& p = *batch.splats[k];
            const BlockSet touched = batch.touched[k];
            const SplatInTile<T> shape = SplatInTile<T>::of(p, box);
            const V r = broadcast<T>(p.color[0]), g = broadcast<T>(p.color[1]), b = broadcast<T>(p.color[2]),
                    z = broadcast<T>(p.depth);
            for (int h = 0; h < 2; h++)
                for (std::uint64_t remaining = touched.half[h] & active.half[h]; remaining != 0;
                     remaining &= remaining - 1) {
                    const int i = __builtin_ctzll(remaining) + 64 * h;
                    V u, v, log2_alpha = shape.log2_alpha(grid, i, u, v);
                    ForwardPixel<T>& pixel = pixels[i];
                    V transmittance = pixel.transmittance;
                    M hit = ge<T>(log2_alpha, alpha_min_log2) & gt<T>(transmittance, V{});
                    V weight = zero_unless<T>(hit, vmin<T>(vexp2(log2_alpha), alpha_max)) * transmittance;
                    V next_transmittance = transmittance - weight;
                    M finishes = hit & le<T>(next_transmittance, transmittance_min);
                    if (__builtin_expect(any(finishes), 0)) {
                        weight = zero_unless<T>(~finishes, weight);
                        next_transmittance = select<T>(finishes, -transmittance, next_transmittance);
                        if (!any(gt<T>(next_transmittance, V{}))) active.half[h] &= ~(std::uint64_t(1) << (i % 64));
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
    const T bg[3] = {out.background[0], out.background[1], out.background[2]};
    for (int y = 0; y < box.height; y++) {
        const std::int64_t row = std::int64_t(box.top + y) * camera.width + box.left;
        for (int x = 0; x < box.width; x++) {
            const int i = (y / BLOCK_H) * BLOCKS_X + x / BLOCK_W, lane = y % BLOCK_H * BLOCK_W + x % BLOCK_W;
            const T signed_t = pixels[i].transmittance[lane], transmittance = signed_t < 0 ? -signed_t : signed_t,
                    weight_sum = pixels[i].weight_sum[lane];
            T* rgb = out.image + 3 * (row + x);
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
            for (int c = 0; c < 3; c++) out.image[3 * i + c] = out.background[c];
            out.alpha[i] = out.depth[i] = 0;
        }
}

}  // namespace vs::VS_ISA
