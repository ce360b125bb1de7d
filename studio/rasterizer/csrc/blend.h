// Forward pass over one tile. Included by isa.h, once for each instruction set.

template <typename T>
struct ForwardPixel {
    Vec<T> transmittance, covered, red, green, blue, depth;
};

template <typename T>
static void blend_tile(const Camera& camera, const TileBox& box, const Projected<T>* projected, const Intersection<T>* list,
                       std::uint32_t count, const Outputs<T>& out) {
    using V = Vec<T>;
    using M = Mask<T>;
    ForwardPixel<T> pixels[BLOCKS];
    Grid<T> grid;
    Grid<T>::fill(grid);
    Blocks alive = clear_tile<T>(box, grid, pixels);
    for (ForwardPixel<T>& one : pixels) one.covered = one.red = one.green = one.blue = one.depth = V{};
    const V cut = broadcast<T>(T(ALPHA_MIN_LOG2)), alpha_max = broadcast<T>(T(camera.alpha_max)),
            least = broadcast<T>(T(TRANSMITTANCE_MIN));
    Batch<T> batch;
    for (std::uint32_t n = 0; n < count && (alive.half[0] | alive.half[1]) != 0;) {
        n = batch.fill(projected, list, n, count, box, alive);
        for (int k = 0; k < batch.size; k++) {
            const Projected<T>& p = *batch.splats[k];
            const Blocks reach = batch.reach[k];
            const Shape<T> shape = Shape<T>::of(p, box);
            const V r = broadcast<T>(p.color[0]), g = broadcast<T>(p.color[1]), b = broadcast<T>(p.color[2]), z = broadcast<T>(p.depth);
            for (int h = 0; h < 2; h++)
                for (std::uint64_t left = reach.half[h] & alive.half[h]; left != 0; left &= left - 1) {
                    const int i = __builtin_ctzll(left) + 64 * h;
                    V u, v, e = shape.exponent(grid, i, u, v);
                    ForwardPixel<T>& at = pixels[i];
                    V before = at.transmittance;
                    M hit = ge<T>(e, cut) & gt<T>(before, V{});
                    V weight = zero_unless<T>(hit, vmin<T>(vexp2(e), alpha_max)) * before;
                    V after = before - weight;
                    M stop = hit & le<T>(after, least);
                    if (__builtin_expect(any(stop), 0)) {
                        weight = zero_unless<T>(~stop, weight);
                        after = select<T>(stop, -before, after);
                        if (!any(gt<T>(after, V{}))) alive.half[h] &= ~(std::uint64_t(1) << (i % 64));
                    }
                    at.transmittance = after;
                    at.covered += weight;  // not 1 - transmittance, whose digits are gone where little is drawn
                    at.red += weight * r;
                    at.green += weight * g;
                    at.blue += weight * b;
                    at.depth += weight * z;
                }
        }
    }
    const T bg[3] = {out.background[0], out.background[1], out.background[2]};
    for (int y = 0; y < box.height; y++) {
        const std::int64_t row = std::int64_t(box.top + y) * camera.width + box.left;
        for (int x = 0; x < box.width; x++) {
            const int i = (y / BLOCK_H) * BLOCKS_X + x / BLOCK_W, lane = y % BLOCK_H * BLOCK_W + x % BLOCK_W;
            const T left = pixels[i].transmittance[lane] < 0 ? -pixels[i].transmittance[lane] : pixels[i].transmittance[lane],
                    weights = pixels[i].covered[lane];
            T* pixel = out.image + 3 * (row + x);
            pixel[0] = pixels[i].red[lane] + left * bg[0];
            pixel[1] = pixels[i].green[lane] + left * bg[1];
            pixel[2] = pixels[i].blue[lane] + left * bg[2];
            out.alpha[row + x] = left < T(0.5) ? T(1) - left : weights;  // each where it has the more digits
            out.depth[row + x] = weights > 0 ? pixels[i].depth[lane] / weights : T(0);
        }
    }
}

template <typename T>
static void empty_tile(const Camera& camera, const TileBox& box, const Outputs<T>& out) {
    for (int y = box.top; y < box.top + box.height; y++)
        for (std::int64_t i = std::int64_t(y) * camera.width + box.left, end = i + box.width; i < end; i++) {
            for (int c = 0; c < 3; c++) out.image[3 * i + c] = out.background[c];
            out.alpha[i] = out.depth[i] = 0;
        }
}
