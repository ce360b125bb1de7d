// Tiles of 32x32 pixels: which pixels of a tile a splat touches, and the sorting of a tile's intersections by depth.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa_namespace.h"
#include "kernels.h"
#include "pixel_lanes.h"
#include "simd.h"

namespace vs::VS_ISA {

// The pixels of a tile are stored in blocks of 4x2 or 4x4 pixels, one lane per pixel, blocks row by row.
constexpr int BLOCK_W = 4, BLOCKS_X = TILE / BLOCK_W;
template <typename T>
constexpr int BLOCK_H = PixelLanes<T>::BLOCK_H;
template <typename T>
constexpr int BLOCKS = BLOCKS_X * TILE / BLOCK_H<T>;
template <typename T>
using PixelVec = typename PixelLanes<T>::V;

struct TileBox {
    int left, top, width, height;  // image pixels
};
VS_INLINE TileBox tile_box(const Camera& camera, int tiles_x, int tile) {
    TileBox box;
    box.left = tile % tiles_x * TILE;
    box.top = tile / tiles_x * TILE;
    box.width = camera.width - box.left < TILE ? camera.width - box.left : TILE;
    box.height = camera.height - box.top < TILE ? camera.height - box.top : TILE;
    return box;
}

// Pixel coordinates of each column and each row of blocks, relative to the center of the tile's first pixel.
template <typename T>
struct PixelGrid {
    PixelVec<T> x[BLOCKS_X], y[TILE / BLOCK_H<T>];
    VS_INLINE void init(PixelGrid& grid) {
        for (int i = 0; i < BLOCKS_X; i++) grid.x[i] = PixelLanes<T>::x() + T(i * BLOCK_W);
        for (int i = 0; i < TILE / BLOCK_H<T>; i++) grid.y[i] = PixelLanes<T>::y() + T(i * BLOCK_H<T>);
    }
};

// A set of blocks: bit 8 * row + column.
template <typename T>
struct BlockSet {
    static constexpr int WORDS = BLOCKS<T> / 64;
    std::uint64_t word[WORDS];

    inline __attribute__((always_inline)) bool any() const {
        std::uint64_t all = 0;
        for (int w = 0; w < WORDS; w++) all |= word[w];
        return all != 0;
    }
};
static_assert(BLOCKS_X == 8, "a row of blocks is a byte of BlockSet");

// Sets the transmittance of a tile's pixels and returns the blocks that have unfinished pixels. Transmittance is
// negative where a pixel is finished or outside the image. P is the per-block pixel state: one struct per block instead
// of one array per quantity, because arrays that are a multiple of 4096 bytes apart compete for cache lines and cause
// false store-to-load dependencies.
template <typename T, typename P>
VS_INLINE BlockSet<T> init_pixels(const TileBox& box, const PixelGrid<T>& grid, P* pixels) {
    using L = PixelLanes<T>;
    BlockSet<T> active = {};
    if (box.width == TILE && box.height == TILE) {
        for (int i = 0; i < BLOCKS<T>; i++) pixels[i].transmittance = L::all(T(1));
        for (std::uint64_t& word : active.word) word = ~std::uint64_t(0);
        return active;
    }
    for (int i = 0; i < BLOCKS<T>; i++) {
        const typename L::M inside = L::both(L::lt(grid.x[i % BLOCKS_X], L::all(T(box.width))),
                                             L::lt(grid.y[i / BLOCKS_X], L::all(T(box.height))));
        pixels[i].transmittance = L::select(inside, L::all(T(1)), L::all(T(-1)));
        active.word[i / 64] |= std::uint64_t(L::any(inside)) << (i % 64);
    }
    return active;
}

// A splat relative to a tile. Both passes evaluate alpha through this, so that they get the same bits.
template <typename T>
struct SplatInTile {
    using L = PixelLanes<T>;
    using V = PixelVec<T>;
    V x, y, a, b, c, log2_opacity;

    VS_INLINE SplatInTile of(const Projected<T>& p, const TileBox& box) {
        return {L::all(p.x - T(box.left) - T(0.5)),
                L::all(p.y - T(box.top) - T(0.5)),
                L::all(p.a),
                L::all(p.b),
                L::all(p.c),
                L::all(p.log2_opacity)};
    }
    // log2(alpha) at the pixels of a block, before the clamp; also u and v
    inline __attribute__((always_inline)) V log2_alpha(const PixelGrid<T>& grid, int block, V& u, V& v) const {
        V dx = grid.x[block % BLOCKS_X] - x, dy = grid.y[block / BLOCKS_X] - y;
        v = c * dy;
        u = a * dx + b * dy;
        return log2_opacity - v * v - u * u;
    }
};

#if defined(__AVX512F__)
// Joins pairs of rows of blocks, which are bytes.
VS_INLINE std::uint64_t join_rows(std::uint64_t low, std::uint64_t high) {
    const std::uint64_t even = 0x00ff00ff00ff00ffull;
    return _pext_u64(low | low >> 8, even) | _pext_u64(high | high >> 8, even) << 32;
}
#endif

// Blocks that a splat may touch: for each row of pixels, the interval in which u^2 + v^2 is small enough, eight pairs
// of rows at a time. Conservative, except for rounding at the very edge, where alpha is 1/255.
template <typename T>
VS_INLINE BlockSet<T> touched_blocks(const Projected<T>& p, const TileBox& box) {
    using V = Vec<T>;
    using M = Mask<T>;
    typedef std::uint8_t Bytes __attribute__((vector_size(8)));
    const T x = p.x - T(box.left) - T(0.5), y = p.y - T(box.top) - T(0.5);
    const int top = p.top > box.top ? (p.top - box.top) / 2 : 0;
    int bottom = p.bottom - box.top;
    bottom = (bottom < TILE ? bottom : TILE - 1) / 2;
    const V steps = {0, 2, 4, 6, 8, 10, 12, 14};
    const V budget = broadcast<T>(p.log2_opacity - T(ALPHA_MIN_LOG2) + T(1e-4));
    std::uint64_t half[2] = {0, 0};  // of 16 pairs of rows
    for (int row = top; row <= bottom; row += 8) {
        V dy0 = steps + (T(row * 2) - y), dy1 = dy0 + T(1);
        V v0 = p.c * dy0, v1 = p.c * dy1;
        V rest0 = budget - v0 * v0, rest1 = budget - v1 * v1;
        V half0 = p.width * vsqrt(vmax<T>(rest0, V{})), half1 = p.width * vsqrt(vmax<T>(rest1, V{}));
        V mid0 = x + p.slant * dy0, mid1 = x + p.slant * dy1;
        const V far = broadcast<T>(T(1e6));
        const M valid0 = rest0 >= T(0), valid1 = rest1 >= T(0);
        V low = vmin<T>(select<T>(valid0, mid0 - half0, far), select<T>(valid1, mid1 - half1, far));
        V high = vmax<T>(select<T>(valid0, mid0 + half0, -far), select<T>(valid1, mid1 + half1, -far));
        low = vmin<T>(vmax<T>(low + T(0.998), V{}), broadcast<T>(T(TILE)));
        high = vmin<T>(vmax<T>(high + T(1.002), V{}), broadcast<T>(T(TILE)));  // one past the last pixel
        M first = __builtin_convertvector(low, M), end = __builtin_convertvector(high, M);
        M one = M{} + 1;
        M mask = ((one << ((end + 3) >> 2)) - (one << (first >> 2))) & (M)(first < end);
        Bytes bytes = __builtin_convertvector(mask, Bytes);
        std::uint64_t rows;
        __builtin_memcpy(&rows, &bytes, sizeof(rows));
        if (row == 0)
            half[0] |= rows;
        else if (row < 8)
            half[0] |= rows << (8 * row), half[1] |= rows >> (64 - 8 * row);
        else
            half[1] |= rows << (8 * (row - 8));
    }
#if defined(__AVX512F__)
    if constexpr (BLOCK_H<T> == 4) return {{join_rows(half[0], half[1])}};
#endif
    if constexpr (BLOCK_H<T> == 2) return {{half[0], half[1]}};
}

// A run of a tile's intersections with the blocks that each touches. Computing the blocks of many splats before
// blending any of them overlaps their latencies and makes the trip counts of the inner loops known early.
template <typename T>
struct Batch {
    static constexpr int CAPACITY = 64;
    const Projected<T>* splats[CAPACITY];
    BlockSet<T> touched[CAPACITY];
    int size;

    // Reads intersections from index `n`, drops those that touch no active block, and returns the next index. The
    // forward pass finds the blocks and keeps them in `kept`, WORDS values per intersection; the backward pass reads
    // them there.
    template <bool FORWARD>
    inline __attribute__((always_inline)) std::uint32_t fill(const Projected<T>* projected, const Intersection<T>* list,
                                                             std::uint32_t n, std::uint32_t count, const TileBox& box,
                                                             const BlockSet<T>& active, std::uint64_t* kept) {
        constexpr int WORDS = BlockSet<T>::WORDS;
        const std::uint32_t end = count - n < std::uint32_t(CAPACITY) ? count : n + CAPACITY;
        size = 0;
        for (; n < end; n++) {
            if (n + 8 < count) __builtin_prefetch(&projected[list[n + 8].splat]);
            const Projected<T>* p = &projected[list[n].splat];
            BlockSet<T> found;
            if constexpr (FORWARD) found = touched_blocks<T>(*p, box);
            for (int w = 0; w < WORDS; w++) {
                std::uint64_t& word = kept[std::size_t(n) * WORDS + w];
                if constexpr (FORWARD)
                    word = found.word[w];
                else
                    found.word[w] = word;
                found.word[w] &= active.word[w];
            }
            splats[size] = p;
            touched[size] = found;
            size += found.any();
        }
        return end;
    }
};

VS_INLINE std::uint32_t depth_key(float depth) {
    std::uint32_t key;
    __builtin_memcpy(&key, &depth, sizeof(key));
    return key;  // depths are positive, so their bits sort like their values
}
VS_INLINE std::uint64_t depth_key(double depth) {
    std::uint64_t key;
    __builtin_memcpy(&key, &depth, sizeof(key));
    return key;
}

// Stable sort by key: insertion sort for short lists, else radix sort of the bytes of key - min_key.
template <typename T>
static void sort_intersections(Intersection<T>* list, Intersection<T>* scratch, std::uint32_t count) {
    if (count < 2) return;
    if (count <= 32) {
        for (std::uint32_t i = 1; i < count; i++) {
            Intersection<T> e = list[i];
            std::uint32_t j = i;
            for (; j > 0 && list[j - 1].key > e.key; j--) list[j] = list[j - 1];
            list[j] = e;
        }
        return;
    }
    auto min_key = list[0].key, max_key = list[0].key;
    for (std::uint32_t i = 1; i < count; i++) {
        min_key = list[i].key < min_key ? list[i].key : min_key;
        max_key = list[i].key > max_key ? list[i].key : max_key;
    }
    const auto range = max_key - min_key;
    Intersection<T>*from = list, *to = scratch;
    for (int shift = 0; shift < int(8 * sizeof(range)) && (range >> shift) != 0; shift += 8) {
        std::uint32_t next[256] = {0};
        for (std::uint32_t i = 0; i < count; i++) next[(from[i].key - min_key) >> shift & 255]++;
        std::uint32_t total = 0;
        for (int k = 0; k < 256; k++) {
            std::uint32_t count_k = next[k];
            next[k] = total;
            total += count_k;
        }
        for (std::uint32_t i = 0; i < count; i++) to[next[(from[i].key - min_key) >> shift & 255]++] = from[i];
        Intersection<T>* swap = from;
        from = to;
        to = swap;
    }
    if (from != list) __builtin_memcpy(list, from, count * sizeof(Intersection<T>));
}

}  // namespace vs::VS_ISA
