// Forward and backward passes of the splat rasterizer, for float and double. Included by isa.h, once for each
// instruction set. The definition is studio/rasterizer/reference.py; names follow it.
//
// Forward:  A  project all splats (eight at a time), count the tiles that each touches
//           B  write (depth, splat) into the lists of those tiles
//           C  tile by tile: sort the list by depth, blend it splat by splat over blocks of 4x2 pixels
// Backward: D  tile by tile, front to back again: gradients of each (tile, splat) pair into a slot of its own
//           E  splat by splat: add its slots, go back through the projection
// Lists, slots and sums do not depend on the number of threads, so neither does a bit of the result.

template <typename F>
VS_INLINE void parallel(int tasks, int threads, F& body) {
    run_tasks(tasks, threads, [](void* context, int task) { (*static_cast<F*>(context))(task); }, &body);
}

VS_INLINE int chunk_count(std::int64_t splats, int threads) {
    std::int64_t chunks = threads > 1 ? 4 * std::int64_t(threads) : 1;
    if (chunks > splats / 256 + 1) chunks = splats / 256 + 1;
    return int(chunks);
}

// Multiples of eight, so that groups of lanes are the same whatever the number of chunks.
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

    auto pass_a = [&](int chunk) {
        chunk_pairs.get()[chunk] =
            project_chunk<T>(splats, camera, chunk_range(splats.count, chunks, chunk), projected, out.radii,
                             frame.tiles_x, frame.tiles_y, counts.get() + std::size_t(chunk) * tiles);
    };
    parallel(chunks, threads, pass_a);

    std::uint64_t total = 0;
    for (int chunk = 0; chunk < chunks; chunk++) {
        std::uint64_t here = chunk_pairs.get()[chunk];
        chunk_pairs.get()[chunk] = total;
        total += here;
    }
    if (total > 0xfffffff0u) throw_too_many();
    frame.pairs = total;
    frame.intersections = Buffer<Intersection<T>>(std::size_t(total));
    Buffer<Intersection<T>> spare{std::size_t(total)};
    Intersection<T>* intersections = frame.intersections.get();

    // Where each chunk writes in each tile's list: after the chunks before it, so that lists are in splat order.
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

    auto pass_b = [&](int chunk) {
        Range range = chunk_range(splats.count, chunks, chunk);
        std::uint32_t* place = counts.get() + std::size_t(chunk) * tiles;
        std::uint32_t slot = std::uint32_t(chunk_pairs.get()[chunk]);
        for (std::int64_t i = range.begin; i < range.end; i++) {
            Projected<T>& p = projected[i];
            if (!p.visible || p.left > p.right) continue;
            p.slot = slot;
            const auto key = depth_key(p.depth);
            int x0 = p.left / TILE, x1 = p.right / TILE, y0 = p.top / TILE, y1 = p.bottom / TILE;
            for (int ty = y0; ty <= y1; ty++)
                for (int tx = x0; tx <= x1; tx++, slot++)
                    intersections[place[ty * frame.tiles_x + tx]++] = {key, std::uint32_t(i)};
        }
    };
    parallel(chunks, threads, pass_b);

    auto pass_c = [&](int task) {
        const int tile = int(order[task]);
        const std::uint32_t begin = starts[tile], count = starts[tile + 1] - begin;
        const TileBox box = tile_box(camera, frame.tiles_x, tile);
        if (count == 0) return empty_tile<T>(camera, box, out);
        sort_intersections<T>(intersections + begin, spare.get() + begin, count);
        blend_tile<T>(camera, box, projected, intersections + begin, count, out);
    };
    parallel(tiles, threads, pass_c);
}

template <typename T>
static void backward(const Splats<T>& splats, const Gradients<T>& grad, const Frame<T>& frame, int threads) {
    const int tiles = frame.tiles_x * frame.tiles_y;
    const bool extra = grad.d_alpha != nullptr || grad.d_depth != nullptr;
    Buffer<T> slots{std::size_t(frame.pairs) * SLOT};
    auto pass_d = [&](int task) {
        const int tile = int(frame.order.get()[task]);
        const std::uint32_t begin = frame.starts.get()[tile], count = frame.starts.get()[tile + 1] - begin;
        if (count == 0) return;
        const TileBox box = tile_box(frame.camera, frame.tiles_x, tile);
        const Intersection<T>* list = frame.intersections.get() + begin;
        if (extra)
            backward_tile<T, true>(frame, box, list, count, grad, slots.get(), tile);
        else
            backward_tile<T, false>(frame, box, list, count, grad, slots.get(), tile);
    };
    parallel(tiles, threads, pass_d);

    const int chunks = chunk_count(splats.count, threads);
    auto pass_e = [&](int chunk) {
        Range range = chunk_range(splats.count, chunks, chunk);
        for (std::int64_t first = range.begin; first < range.end; first += LANES)
            backward_group<T>(splats, frame, grad, slots.get(), first,
                              range.end - first < LANES ? int(range.end - first) : LANES);
    };
    parallel(chunks, threads, pass_e);
}
