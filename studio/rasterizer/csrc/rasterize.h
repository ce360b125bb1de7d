// Forward and backward passes of the rasterizer, for float and double. The definition is
// studio/rasterizer/reference.py.
//
// Forward:   project  project the splats, eight at a time, and count the tiles that each touches
//            bin      write (depth, splat) into the lists of those tiles
//            blend    per tile: sort the list by depth, then blend splat by splat over blocks of pixels
// Backward:  tile     per tile, front to back again: gradients of each (tile, splat) pair, each pair in its own slot
//            splat    per splat: add up its slots and propagate through the projection
// The order of lists, slots and sums does not depend on the number of threads, so the results are bitwise reproducible.
#pragma once

#include <cstddef>
#include <cstdint>

#include "attributes.h"
#include "backward.h"
#include "blend.h"
#include "buffers.h"
#include "isa_namespace.h"
#include "kernels.h"
#include "project.h"
#include "simd.h"
#include "threads.h"
#include "tiles.h"

namespace vs::VS_ISA {

VS_INLINE int chunk_count(std::int64_t splats, int threads) {
    std::int64_t chunks = threads > 1 ? 4 * std::int64_t(threads) : 1;
    if (chunks > splats / 256 + 1) chunks = splats / 256 + 1;
    return int(chunks);
}

// Chunks begin at multiples of eight, so that the same splats share a vector for any number of chunks.
VS_INLINE Range chunk_range(std::int64_t splats, int chunks, int chunk) {
    std::int64_t groups = (splats + LANES - 1) / LANES;
    std::int64_t begin = groups * chunk / chunks * LANES, end = groups * (chunk + 1) / chunks * LANES;
    return {begin, end < splats ? end : splats};
}

template <typename T>
static void forward(const Splats<T>& splats, const Outputs<T>& out, Frame<T>& frame, int threads) {
    const Camera& camera = frame.camera;
    frame.count = splats.count;
    frame.tiles_x = (camera.width + TILE - 1) / TILE;
    frame.tiles_y = (camera.height + TILE - 1) / TILE;
    const int tiles = frame.tiles_x * frame.tiles_y, chunks = chunk_count(splats.count, threads);
    frame.projected = Buffer<Projected<T>>(std::size_t(splats.count));
    frame.starts = Buffer<std::uint32_t>(std::size_t(tiles) + 1);
    frame.order = Buffer<std::uint32_t>(std::size_t(tiles));
    Buffer<std::uint32_t> counts(std::size_t(chunks) * tiles);
    Buffer<std::uint64_t> chunk_pairs(std::size_t(chunks) + 1);
    Projected<T>* projected = frame.projected.get();
    std::uint32_t *starts = frame.starts.get(), *order = frame.order.get();

    auto project_pass = [&](int chunk) {
        chunk_pairs.get()[chunk] =
            project_chunk<T>(splats, camera, chunk_range(splats.count, chunks, chunk), projected, out.radii,
                             frame.tiles_x, frame.tiles_y, counts.get() + std::size_t(chunk) * tiles);
    };
    parallel_for(chunks, threads, project_pass);

    std::uint64_t total = 0;
    for (int chunk = 0; chunk < chunks; chunk++) {
        std::uint64_t here = chunk_pairs.get()[chunk];
        chunk_pairs.get()[chunk] = total;
        total += here;
    }
    if (total > 0xfffffff0u) throw_too_many_tiles();
    frame.pairs = total;
    frame.intersections = Buffer<Intersection<T>>(std::size_t(total));
    Buffer<Intersection<T>> scratch{std::size_t(total)};
    frame.touched = Buffer<std::uint64_t>(std::size_t(total) * BlockSet<T>::WORDS);
    Intersection<T>* intersections = frame.intersections.get();

    // Where each chunk writes in the list of each tile: after the chunks before it, so that lists keep the splat order.
    std::uint32_t position = 0, per_length[34] = {0};
    for (int tile = 0; tile < tiles; tile++) {
        starts[tile] = position;
        for (int chunk = 0; chunk < chunks; chunk++) {
            std::uint32_t& count = counts.get()[std::size_t(chunk) * tiles + tile];
            std::uint32_t here = count;
            count = position;
            position += here;
        }
        std::uint32_t length = position - starts[tile];
        per_length[length == 0 ? 33 : __builtin_clz(length)]++;
    }
    starts[tiles] = position;
    for (int k = 0, sum = 0; k < 34; k++) {
        std::uint32_t here = per_length[k];
        per_length[k] = std::uint32_t(sum);
        sum += int(here);
    }
    for (int tile = 0; tile < tiles; tile++) {
        std::uint32_t length = starts[tile + 1] - starts[tile];
        order[per_length[length == 0 ? 33 : __builtin_clz(length)]++] = std::uint32_t(tile);
    }

    auto bin_pass = [&](int chunk) {
        Range range = chunk_range(splats.count, chunks, chunk);
        std::uint32_t* next = counts.get() + std::size_t(chunk) * tiles;
        std::uint32_t slot = std::uint32_t(chunk_pairs.get()[chunk]);
        for (std::int64_t i = range.begin; i < range.end; i++) {
            Projected<T>& p = projected[i];
            if (!p.visible || p.left > p.right) continue;
            p.slot = slot;
            const auto key = depth_key(p.depth);
            int x0 = p.left / TILE, x1 = p.right / TILE, y0 = p.top / TILE, y1 = p.bottom / TILE;
            for (int ty = y0; ty <= y1; ty++)
                for (int tx = x0; tx <= x1; tx++, slot++)
                    intersections[next[ty * frame.tiles_x + tx]++] = {key, std::uint32_t(i)};
        }
    };
    parallel_for(chunks, threads, bin_pass);

    auto blend_pass = [&](int task) {
        const int tile = int(order[task]);
        const std::uint32_t begin = starts[tile], count = starts[tile + 1] - begin;
        const TileBox box = tile_box(camera, frame.tiles_x, tile);
        if (count == 0) return fill_background<T>(camera, box, out);
        sort_intersections<T>(intersections + begin, scratch.get() + begin, count);
        blend_tile<T>(camera, box, projected, intersections + begin, count, out,
                      frame.touched.get() + std::size_t(begin) * BlockSet<T>::WORDS);
    };
    parallel_for(tiles, threads, blend_pass);
}

template <typename T>
static void backward(const Splats<T>& splats, const Gradients<T>& grad, const Frame<T>& frame, int threads) {
    const int tiles = frame.tiles_x * frame.tiles_y;
    Buffer<T> slots{std::size_t(frame.pairs) * SLOT};
    // Above degree 0, colors depend on the direction and so on the means.
    const bool shape_only = grad.d_logits == nullptr && grad.d_sh == nullptr && splats.coefficients == 1;
    auto tile_pass = [&](int task) {
        const int tile = int(frame.order.get()[task]);
        const std::uint32_t begin = frame.starts.get()[tile], count = frame.starts.get()[tile + 1] - begin;
        if (count == 0) return;
        const TileBox box = tile_box(frame.camera, frame.tiles_x, tile);
        const Intersection<T>* list = frame.intersections.get() + begin;
        std::uint64_t* kept = frame.touched.get() + std::size_t(begin) * BlockSet<T>::WORDS;
        if (grad.d_depth != nullptr)
            backward_tile<T, IMAGE_ALPHA_DEPTH, EVERYTHING>(frame, box, list, count, grad, slots.get(), tile, kept);
        else if (grad.d_alpha != nullptr && shape_only)
            backward_tile<T, IMAGE_ALPHA, SHAPE>(frame, box, list, count, grad, slots.get(), tile, kept);
        else if (grad.d_alpha != nullptr)
            backward_tile<T, IMAGE_ALPHA, EVERYTHING>(frame, box, list, count, grad, slots.get(), tile, kept);
        else if (shape_only)
            backward_tile<T, IMAGE, SHAPE>(frame, box, list, count, grad, slots.get(), tile, kept);
        else
            backward_tile<T, IMAGE, EVERYTHING>(frame, box, list, count, grad, slots.get(), tile, kept);
    };
    parallel_for(tiles, threads, tile_pass);

    const int chunks = chunk_count(splats.count, threads);
    auto splat_pass = [&](int chunk) {
        Range range = chunk_range(splats.count, chunks, chunk);
        for (std::int64_t first = range.begin; first < range.end; first += LANES)
            backward_lanes<T>(splats, frame, grad, slots.get(), first,
                              range.end - first < LANES ? int(range.end - first) : LANES);
    };
    parallel_for(chunks, threads, splat_pass);
}

}  // namespace vs::VS_ISA
