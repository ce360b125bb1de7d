// Forward and backward passes of the splat rasterizer, for float and double. Included by isa.h, once for each
// instruction set. The definition is studio/rasterizer/reference.py; names follow it.
//
// Forward:  A  project all splats (eight at a time), count the tiles that each touches
//           B  write (depth, splat) into the lists of those tiles
//           C  tile by tile: sort the list by depth, blend it splat by splat over blocks of 4x2 pixels
// Backward: D  tile by tile, front to back again: gradients of each (tile, splat) pair into a slot of its own
//           E  splat by splat: add its slots, go back through the projection
// Lists, slots and sums do not depend on the number of threads, so neither does a bit of the result.

// Sums over the pixels of a tile that a splat's slot holds. q is dLoss/d(ln alpha).
enum Slot { S_Q, S_QU, S_QUU, S_QV, S_QUV, S_QVV, S_RED, S_GREEN, S_BLUE, S_DEPTH };

template <typename F> VS_INLINE void parallel(int tasks, int threads, F& body) {
    run_tasks(tasks, threads, [](void* context, int task) { (*static_cast<F*>(context))(task); }, &body);
}

VS_INLINE int chunk_count(std::int64_t splats, int threads) {
    std::int64_t chunks = threads > 1 ? 4 * std::int64_t(threads) : 1;
    if (chunks > splats / 256 + 1) chunks = splats / 256 + 1;
    return int(chunks);
}

struct Range {
    std::int64_t begin, end;
};
// Multiples of eight, so that groups of lanes are the same whatever the number of chunks.
VS_INLINE Range chunk_range(std::int64_t splats, int chunks, int chunk) {
    std::int64_t groups = (splats + LANES - 1) / LANES;
    std::int64_t begin = groups * chunk / chunks * LANES, end = groups * (chunk + 1) / chunks * LANES;
    return {begin, end < splats ? end : splats};
}

// ---------------------------------------------------------------------------------------------- reading and writing

// width values a splat, as one vector a value; lanes beyond the end repeat the last splat.
template <typename T> VS_INLINE void gather(const T* p, int width, std::int64_t first, std::int64_t count, Vec<T>* out) {
    T lanes[16][LANES];
    int valid = count - first < LANES ? int(count - first) : LANES;
    for (int i = 0; i < LANES; i++) {
        const T* row = p + (first + (i < valid ? i : valid - 1)) * width;
        for (int k = 0; k < width; k++) lanes[k][i] = row[k];
    }
    for (int k = 0; k < width; k++) out[k] = load<T>(lanes[k]);
}

template <typename T>
VS_INLINE void scatter(T* p, int width, std::int64_t first, int valid, const Vec<T>* values) {
    T lanes[16][LANES];
    for (int k = 0; k < width; k++) store<T>(lanes[k], values[k]);
    for (int i = 0; i < valid; i++)
        for (int k = 0; k < width; k++) p[(first + i) * width + k] = lanes[k][i];
}

// As gather and scatter, for the long rows of spherical harmonics: 8x8 transposes where eight whole splats are there.
template <typename T>
VS_INLINE void gather_long(const T* p, int width, std::int64_t first, std::int64_t count, Vec<T>* out) {
    if (count - first < LANES) {
        T lanes[LANES];
        for (int k = 0; k < width; k++) {
            for (int i = 0; i < LANES; i++) lanes[i] = p[(first + i < count ? first + i : count - 1) * width + k];
            out[k] = load<T>(lanes);
        }
        return;
    }
    const T* base = p + first * width;
    int k = 0;
    for (; k + 8 <= width; k += 8) {
        Vec<T> r[8];
        for (int i = 0; i < 8; i++) r[i] = load<T>(base + i * width + k);
        transpose(r);
        for (int i = 0; i < 8; i++) out[k + i] = r[i];
    }
    for (; k < width; k++) {
        T lanes[LANES];
        for (int i = 0; i < LANES; i++) lanes[i] = base[i * width + k];
        out[k] = load<T>(lanes);
    }
}

template <typename T>
VS_INLINE void scatter_long(T* p, int width, std::int64_t first, int valid, Vec<T>* values) {
    T* base = p + first * width;
    int k = 0;
    if (valid == LANES)
        for (; k + 8 <= width; k += 8) {
            transpose(values + k);
            for (int i = 0; i < 8; i++) store<T>(base + i * width + k, values[k + i]);
        }
    for (; k < width; k++) {
        T lanes[LANES];
        store<T>(lanes, values[k]);
        for (int i = 0; i < valid; i++) base[i * width + k] = lanes[i];
    }
}

// ----------------------------------------------------------------------------------------------- spherical harmonics

// The basis at unit directions, and where wanted its derivatives (treating x, y, z as independent).
template <typename T, bool GRADIENT>
VS_INLINE void sh_basis(int coefficients, Vec<T> x, Vec<T> y, Vec<T> z, Vec<T>* f, Vec<T>* fx, Vec<T>* fy, Vec<T>* fz) {
    using V = Vec<T>;
    const V zero{};
    f[0] = all<T>(T(0.28209479177387814));
    if (GRADIENT) fx[0] = fy[0] = fz[0] = zero;
    if (coefficients < 4) return;
    const T c1 = T(0.4886025119029199);
    f[1] = -c1 * y, f[2] = c1 * z, f[3] = -c1 * x;
    if (GRADIENT) {
        fx[1] = fz[1] = fx[2] = fy[2] = fy[3] = fz[3] = zero;
        fy[1] = fx[3] = all<T>(-c1);
        fz[2] = all<T>(c1);
    }
    if (coefficients < 9) return;
    const T c2 = T(1.0925484305920792), c20 = T(0.31539156525252005), c22 = T(0.5462742152960396);
    V xx = x * x, yy = y * y, zz = z * z, xy = x * y, yz = y * z, xz = x * z;
    f[4] = c2 * xy, f[5] = -c2 * yz, f[6] = c20 * (T(3) * zz - T(1)), f[7] = -c2 * xz, f[8] = c22 * (xx - yy);
    if (GRADIENT) {
        fx[4] = c2 * y, fy[4] = c2 * x, fz[4] = zero;
        fx[5] = zero, fy[5] = -c2 * z, fz[5] = -c2 * y;
        fx[6] = fy[6] = zero, fz[6] = T(6) * c20 * z;
        fx[7] = -c2 * z, fy[7] = zero, fz[7] = -c2 * x;
        fx[8] = T(2) * c22 * x, fy[8] = T(-2) * c22 * y, fz[8] = zero;
    }
    if (coefficients < 16) return;
    const T c3 = T(0.5900435899266435), c3b = T(2.890611442640554), c3c = T(0.4570457994644658),
            c3d = T(0.3731763325901154), c3e = T(1.445305721320277);
    f[9] = -c3 * y * (T(3) * xx - yy);
    f[10] = c3b * xy * z;
    f[11] = -c3c * y * (T(5) * zz - T(1));
    f[12] = c3d * z * (T(5) * zz - T(3));
    f[13] = -c3c * x * (T(5) * zz - T(1));
    f[14] = c3e * z * (xx - yy);
    f[15] = -c3 * x * (xx - T(3) * yy);
    if (GRADIENT) {
        fx[9] = T(-6) * c3 * xy, fy[9] = T(-3) * c3 * (xx - yy), fz[9] = zero;
        fx[10] = c3b * yz, fy[10] = c3b * xz, fz[10] = c3b * xy;
        fx[11] = zero, fy[11] = -c3c * (T(5) * zz - T(1)), fz[11] = T(-10) * c3c * yz;
        fx[12] = fy[12] = zero, fz[12] = c3d * (T(15) * zz - T(3));
        fx[13] = -c3c * (T(5) * zz - T(1)), fy[13] = zero, fz[13] = T(-10) * c3c * xz;
        fx[14] = T(2) * c3e * xz, fy[14] = T(-2) * c3e * yz, fz[14] = c3e * (xx - yy);
        fx[15] = T(-3) * c3 * (xx - yy), fy[15] = T(6) * c3 * xy, fz[15] = zero;
    }
}

// -------------------------------------------------------------------------------------------------------- projection

// Eight splats on their way to the screen: what the forward pass uses and the backward pass computes again.
template <typename T> struct Group {
    using V = Vec<T>;
    V mean[3], x_z, y_z, x_lim, y_lim, depth, inverse_depth;
    V quat[4], quat_length;            // quat has length 1
    V rotation[9], scale[3];
    V plane_u[3], plane_v[3];          // rows of jacobian * world-to-camera
    V m_u[3], m_v[3], m_cross[3];      // those times rotation, and their cross product
    V u[3], v[3];                      // those times scale: the rows of the covariance's factor
    V xx, xy, yy, det;                 // dilated covariance and its determinant
    V log2_opacity, one_minus_opacity;
    V direction[3], distance;
};

template <typename T>
VS_INLINE void project_group(const Splats<T>& splats, const Camera& camera, std::int64_t first, Group<T>& g) {
    using V = Vec<T>;
    V logit, log_scale[3];
    gather<T>(splats.means, 3, first, splats.count, g.mean);
    gather<T>(splats.quats, 4, first, splats.count, g.quat);
    gather<T>(splats.log_scales, 3, first, splats.count, log_scale);
    gather<T>(splats.logits, 1, first, splats.count, &logit);
    T w[9], t[3];
    for (int i = 0; i < 9; i++) w[i] = T(camera.rotation[i]);
    for (int i = 0; i < 3; i++) t[i] = T(camera.translation[i]);
    V x = w[0] * g.mean[0] + w[1] * g.mean[1] + w[2] * g.mean[2] + t[0];
    V y = w[3] * g.mean[0] + w[4] * g.mean[1] + w[5] * g.mean[2] + t[1];
    g.depth = w[6] * g.mean[0] + w[7] * g.mean[1] + w[8] * g.mean[2] + t[2];
    g.inverse_depth = T(1) / g.depth;
    g.x_z = x * g.inverse_depth;
    g.y_z = y * g.inverse_depth;
    g.x_lim = vmin<T>(vmax<T>(g.x_z, all<T>(T(camera.limits[0]))), all<T>(T(camera.limits[1])));
    g.y_lim = vmin<T>(vmax<T>(g.y_z, all<T>(T(camera.limits[2]))), all<T>(T(camera.limits[3])));

    V* q = g.quat;
    g.quat_length = vsqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    V inverse_length = T(1) / g.quat_length;
    for (int i = 0; i < 4; i++) q[i] *= inverse_length;
    V* r = g.rotation;
    r[0] = T(1) - T(2) * (q[2] * q[2] + q[3] * q[3]);
    r[1] = T(2) * (q[1] * q[2] - q[0] * q[3]);
    r[2] = T(2) * (q[1] * q[3] + q[0] * q[2]);
    r[3] = T(2) * (q[1] * q[2] + q[0] * q[3]);
    r[4] = T(1) - T(2) * (q[1] * q[1] + q[3] * q[3]);
    r[5] = T(2) * (q[2] * q[3] - q[0] * q[1]);
    r[6] = T(2) * (q[1] * q[3] - q[0] * q[2]);
    r[7] = T(2) * (q[2] * q[3] + q[0] * q[1]);
    r[8] = T(1) - T(2) * (q[1] * q[1] + q[2] * q[2]);

    T fx = T(camera.fx), fy = T(camera.fy);
    V fx_z = fx * g.inverse_depth, fy_z = fy * g.inverse_depth;
    for (int k = 0; k < 3; k++) {
        g.plane_u[k] = fx_z * (w[k] - g.x_lim * w[6 + k]);
        g.plane_v[k] = fy_z * (w[3 + k] - g.y_lim * w[6 + k]);
    }
    for (int k = 0; k < 3; k++) {
        g.scale[k] = vexp(log_scale[k]);
        g.m_u[k] = g.plane_u[0] * r[k] + g.plane_u[1] * r[3 + k] + g.plane_u[2] * r[6 + k];
        g.m_v[k] = g.plane_v[0] * r[k] + g.plane_v[1] * r[3 + k] + g.plane_v[2] * r[6 + k];
        g.u[k] = g.m_u[k] * g.scale[k];
        g.v[k] = g.m_v[k] * g.scale[k];
    }
    const T d = T(DILATION);
    V uu = g.u[0] * g.u[0] + g.u[1] * g.u[1] + g.u[2] * g.u[2];
    V vv = g.v[0] * g.v[0] + g.v[1] * g.v[1] + g.v[2] * g.v[2];
    g.xy = g.u[0] * g.v[0] + g.u[1] * g.v[1] + g.u[2] * g.v[2];
    g.xx = uu + d;
    g.yy = vv + d;
    // |u|^2 |v|^2 - (u.v)^2 = |u x v|^2, and u x v is the viewing ray in the splat's axes, scaled: for needles this keeps
    // the digits that the difference loses.
    V ray[3], area = fx_z * fy_z, cross = V{};
    for (int k = 0; k < 3; k++) ray[k] = g.x_lim * w[k] + g.y_lim * w[3 + k] + w[6 + k];
    for (int k = 0; k < 3; k++) {
        g.m_cross[k] = area * (ray[0] * r[k] + ray[1] * r[3 + k] + ray[2] * r[6 + k]);
        V part = g.m_cross[k] * g.scale[(k + 1) % 3] * g.scale[(k + 2) % 3];
        cross += part * part;
    }
    g.det = cross + d * (uu + vv) + d * d;

    V t_opacity = vexp(-logit);
    g.log2_opacity = -vlog2(T(1) + t_opacity);
    g.one_minus_opacity = t_opacity / (T(1) + t_opacity);

    V away[3];
    for (int k = 0; k < 3; k++) away[k] = g.mean[k] - T(camera.center[k]);
    g.distance = vsqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2]);
    V inverse_distance = T(1) / vmax<T>(g.distance, all<T>(T(1e-12)));
    for (int k = 0; k < 3; k++) g.direction[k] = away[k] * inverse_distance;
}

// Pass A for splats [begin, end): fill `projected` and `radii`, add to `tile_counts`; returns the number of pairs.
template <typename T>
static std::uint64_t project_chunk(const Splats<T>& splats, const Camera& camera, Range range, Projected<T>* projected,
                                   T* radii, int tiles_x, int tiles_y, std::uint32_t* tile_counts) {
    using V = Vec<T>;
    using M = Mask<T>;
    const int floats = 3 * splats.coefficients;
    const T width = T(camera.width), height = T(camera.height);
    const T huge = sizeof(T) == 4 ? T(1e30) : T(1e250);
    std::uint64_t pairs = 0;
    for (int i = 0; i < tiles_x * tiles_y; i++) tile_counts[i] = 0;
    for (std::int64_t first = range.begin; first < range.end; first += LANES) {
        const int valid = range.end - first < LANES ? int(range.end - first) : LANES;
        Group<T> g;
        project_group<T>(splats, camera, first, g);
        V mx = T(camera.fx) * g.x_z + T(camera.cx), my = T(camera.fy) * g.y_z + T(camera.cy);
        if (splats.offsets != nullptr) {
            V offset[2];
            gather<T>(splats.offsets, 2, first, splats.count, offset);
            mx += offset[0];
            my += offset[1];
        }
        // 2 ln 2 turns the exponent of base 2 into half a squared distance in standard deviations.
        V reach = vsqrt(vmax<T>(T(1.3862943611198906) * (g.log2_opacity - T(ALPHA_MIN_LOG2)), V{}));
        V half_x = reach * vsqrt(g.xx), half_y = reach * vsqrt(g.yy);
        // Comparisons with NaN are false: such splats are not drawn.
        M shown = ge<T>(g.depth, all<T>(T(camera.near))) & ge<T>(g.log2_opacity, all<T>(T(ALPHA_MIN_LOG2)));
        shown &= gt<T>(g.quat_length, V{}) & lt<T>(g.quat_length, all<T>(huge));
        shown &= gt<T>(g.det, V{}) & lt<T>(g.det, all<T>(huge)) & lt<T>(g.depth, all<T>(huge));
        shown &= gt<T>(mx + half_x, V{}) & lt<T>(mx - half_x, all<T>(width));
        shown &= gt<T>(my + half_y, V{}) & lt<T>(my - half_y, all<T>(height));
        shown &= lt<T>(half_x, all<T>(huge)) & lt<T>(half_y, all<T>(huge));
        if (!any(shown)) {
            for (int i = 0; i < valid; i++) {
                projected[first + i].visible = 0;
                radii[first + i] = 0;
            }
            continue;
        }

        V basis[16], sh[48], color[3];
        sh_basis<T, false>(splats.coefficients, g.direction[0], g.direction[1], g.direction[2], basis, nullptr, nullptr,
                           nullptr);
        gather_long<T>(splats.sh, floats, first, splats.count, sh);
        for (int c = 0; c < 3; c++) {
            color[c] = all<T>(T(0.5));
            for (int k = 0; k < splats.coefficients; k++) color[c] += basis[k] * sh[3 * k + c];
            shown &= lt<T>(color[c], all<T>(huge)) & gt<T>(color[c], all<T>(-huge));
        }

        // u = a dx + b dy, v = c dy with u^2 + v^2 = (log2(e) / 2) d^T cov^-1 d
        const T s = T(0.84932180028801904272);
        V ratio = T(1) / vsqrt(g.yy * g.det);
        V a = s * g.yy * ratio, b = -s * g.xy * ratio, c = s / vsqrt(g.yy);

        // Pixels whose centres lie in the box; a little more than exact, since the pixels are tested one by one.
        V slack_x = T(1e-3) + half_x * T(1e-5), slack_y = T(1e-3) + half_y * T(1e-5);
        V low_x = vmax<T>(mx - half_x - T(0.5) - slack_x, all<T>(T(-1))), high_x = vmin<T>(mx + half_x - T(0.5) + slack_x, all<T>(width - T(1)));
        V low_y = vmax<T>(my - half_y - T(0.5) - slack_y, all<T>(T(-1))), high_y = vmin<T>(my + half_y - T(0.5) + slack_y, all<T>(height - T(1)));

        const unsigned shown_bits = bits(shown);
        T lanes[14][LANES];
        const V fields[14] = {mx, my, a, b, c, g.log2_opacity, color[0], color[1], color[2], g.depth, low_x, high_x, low_y, high_y};
        for (int k = 0; k < 14; k++) store<T>(lanes[k], fields[k]);
        T half[LANES];
        store<T>(half, vmax<T>(half_x, half_y));
        for (int i = 0; i < valid; i++) {
            Projected<T>& p = projected[first + i];
            p.visible = shown_bits >> i & 1;
            if (!p.visible) {
                radii[first + i] = 0;
                continue;
            }
            radii[first + i] = half[i];
            p.x = lanes[0][i], p.y = lanes[1][i], p.a = lanes[2][i], p.b = lanes[3][i], p.c = lanes[4][i];
            p.log2_opacity = lanes[5][i];
            p.clamped = 0;
            for (int k = 0; k < 3; k++) {
                p.color[k] = lanes[6 + k][i] >= 0 ? lanes[6 + k][i] : T(0);
                p.clamped |= std::uint8_t(lanes[6 + k][i] < 0) << k;
            }
            p.depth = lanes[9][i];
            // Bounds lie in [-1, size - 1]: +2 makes truncation a floor.
            int left = int(lanes[10][i] + 2) - 2, top = int(lanes[12][i] + 2) - 2;
            left += T(left) < lanes[10][i];
            top += T(top) < lanes[12][i];
            if (left < 0) left = 0;
            if (top < 0) top = 0;
            int right = int(lanes[11][i] + 2) - 2, bottom = int(lanes[13][i] + 2) - 2;
            p.left = std::int16_t(left), p.top = std::int16_t(top);
            p.right = std::int16_t(right), p.bottom = std::int16_t(bottom);
            if (left > right || top > bottom) {
                p.left = 1, p.right = 0;
                continue;
            }
            int x0 = left / TILE, x1 = right / TILE, y0 = top / TILE, y1 = bottom / TILE;
            pairs += std::uint64_t(x1 - x0 + 1) * std::uint64_t(y1 - y0 + 1);
            for (int ty = y0; ty <= y1; ty++)
                for (int tx = x0; tx <= x1; tx++) tile_counts[ty * tiles_x + tx]++;
        }
    }
    return pairs;
}

VS_INLINE std::uint32_t depth_key(float depth) {
    std::uint32_t key;
    __builtin_memcpy(&key, &depth, sizeof(key));
    return key;                          // depths are positive: their bits sort as they do
}
VS_INLINE std::uint64_t depth_key(double depth) {
    std::uint64_t key;
    __builtin_memcpy(&key, &depth, sizeof(key));
    return key;
}

// Stable sort by key: insertion for short lists, else by bytes of the key's distance from the least.
template <typename T> static void sort_entries(Entry<T>* list, Entry<T>* spare, std::uint32_t count) {
    if (count < 2) return;
    if (count <= 32) {
        for (std::uint32_t i = 1; i < count; i++) {
            Entry<T> e = list[i];
            std::uint32_t j = i;
            for (; j > 0 && list[j - 1].key > e.key; j--) list[j] = list[j - 1];
            list[j] = e;
        }
        return;
    }
    auto least = list[0].key, most = list[0].key;
    for (std::uint32_t i = 1; i < count; i++) {
        least = list[i].key < least ? list[i].key : least;
        most = list[i].key > most ? list[i].key : most;
    }
    const auto span = most - least;
    Entry<T>*from = list, *to = spare;
    for (int shift = 0; shift < int(8 * sizeof(span)) && (span >> shift) != 0; shift += 8) {
        std::uint32_t place[256] = {0};
        for (std::uint32_t i = 0; i < count; i++) place[(from[i].key - least) >> shift & 255]++;
        std::uint32_t total = 0;
        for (int k = 0; k < 256; k++) {
            std::uint32_t here = place[k];
            place[k] = total;
            total += here;
        }
        for (std::uint32_t i = 0; i < count; i++) to[place[(from[i].key - least) >> shift & 255]++] = from[i];
        Entry<T>* swap = from;
        from = to;
        to = swap;
    }
    if (from != list) __builtin_memcpy(list, from, count * sizeof(Entry<T>));
}

// ---------------------------------------------------------------------------------------------------------- blending

// A tile's pixels lie as blocks of 4x2, eight lanes a block, blocks row by row.
constexpr int BLOCK_W = 4, BLOCK_H = 2, BLOCKS_X = TILE / BLOCK_W, BLOCKS_Y = TILE / BLOCK_H, BLOCKS = BLOCKS_X * BLOCKS_Y;

struct TileBox {
    int left, top, width, height;        // pixels of the image
};
VS_INLINE TileBox tile_box(const Camera& camera, int tiles_x, int tile) {
    TileBox box;
    box.left = tile % tiles_x * TILE;
    box.top = tile / tiles_x * TILE;
    box.width = camera.width - box.left < TILE ? camera.width - box.left : TILE;
    box.height = camera.height - box.top < TILE ? camera.height - box.top : TILE;
    return box;
}

template <typename T> struct LaneOffsets {
    const Vec<T> x = {0, 1, 2, 3, 0, 1, 2, 3}, y = {0, 0, 0, 0, 1, 1, 1, 1};
};

// The part of a tile that a splat covers, and the exponent along it. Both passes walk it the same way, so that they
// see the same bits.
template <typename T> struct Walk {
    using V = Vec<T>;
    int bx0, bx1, by0, by1;
    V u_lanes;                           // a * lane x + b * lane y
    V lane_y;
    T a, b, c, dx, dy, log2_opacity;

    VS_INLINE Walk start(const Projected<T>& p, const TileBox& box) {
        Walk w;
        const LaneOffsets<T> lane;
        int left = p.left > box.left ? p.left - box.left : 0, top = p.top > box.top ? p.top - box.top : 0;
        int right = p.right - box.left, bottom = p.bottom - box.top;
        if (right >= box.width) right = box.width - 1;
        if (bottom >= box.height) bottom = box.height - 1;
        w.bx0 = left / BLOCK_W, w.bx1 = right / BLOCK_W, w.by0 = top / BLOCK_H, w.by1 = bottom / BLOCK_H;
        w.a = p.a, w.b = p.b, w.c = p.c, w.log2_opacity = p.log2_opacity;
        w.dx = T(box.left + w.bx0 * BLOCK_W) + T(0.5) - p.x;
        w.dy = T(box.top) + T(0.5) - p.y;
        w.u_lanes = p.a * lane.x + p.b * lane.y;
        w.lane_y = lane.y;
        return w;
    }
    inline __attribute__((always_inline)) void row(int by, V& v, V& exponent, V& u) const {
        T y = dy + T(by * BLOCK_H);
        v = c * (lane_y + y);
        exponent = log2_opacity - v * v;
        u = u_lanes + (a * dx + b * y);
    }
};

// Transmittance of the pixels: negative (or -1) where a pixel is finished or outside the image.
template <typename T> VS_INLINE int clear_tile(const TileBox& box, Vec<T>* through) {
    const LaneOffsets<T> lane;
    if (box.width == TILE && box.height == TILE) {
        for (int i = 0; i < BLOCKS; i++) through[i] = all<T>(T(1));
        return TILE * TILE;
    }
    for (int by = 0; by < BLOCKS_Y; by++)
        for (int bx = 0; bx < BLOCKS_X; bx++) {
            Mask<T> inside = lt<T>(lane.x + T(bx * BLOCK_W), all<T>(T(box.width))) & lt<T>(lane.y + T(by * BLOCK_H), all<T>(T(box.height)));
            through[by * BLOCKS_X + bx] = select<T>(inside, all<T>(T(1)), all<T>(T(-1)));
        }
    return box.width * box.height;
}

template <typename T>
static void blend_tile(const Camera& camera, const TileBox& box, const Projected<T>* projected, const Entry<T>* list,
                       std::uint32_t count, const Outputs<T>& out) {
    using V = Vec<T>;
    using M = Mask<T>;
    V through[BLOCKS], covered[BLOCKS], red[BLOCKS], green[BLOCKS], blue[BLOCKS], depth[BLOCKS];
    int alive = clear_tile<T>(box, through);
    for (int i = 0; i < BLOCKS; i++) covered[i] = red[i] = green[i] = blue[i] = depth[i] = V{};
    const V cut = all<T>(T(ALPHA_MIN_LOG2)), alpha_max = all<T>(T(camera.alpha_max)), least = all<T>(T(TRANSMITTANCE_MIN));
    for (std::uint32_t n = 0; n < count && alive > 0; n++) {
        if (n + 6 < count) __builtin_prefetch(&projected[list[n + 6].splat]);
        const Projected<T>& p = projected[list[n].splat];
        const Walk<T> walk = Walk<T>::start(p, box);
        const V step = all<T>(p.a * BLOCK_W);
        const V r = all<T>(p.color[0]), g = all<T>(p.color[1]), b = all<T>(p.color[2]), z = all<T>(p.depth);
        for (int by = walk.by0; by <= walk.by1; by++) {
            V v, exponent, u;
            walk.row(by, v, exponent, u);
            for (int i = by * BLOCKS_X + walk.bx0; i <= by * BLOCKS_X + walk.bx1; i++, u += step) {
                V e = exponent - u * u;
                V before = through[i];
                M hit = ge<T>(e, cut) & gt<T>(before, V{});
                if (!any(hit)) continue;
                V weight = keep<T>(hit, vmin<T>(vexp2(e), alpha_max)) * before;
                V after = before - weight;
                M stop = hit & le<T>(after, least);
                if (any(stop)) {
                    weight = keep<T>(~stop, weight);
                    after = select<T>(stop, -before, after);
                    alive -= __builtin_popcount(bits(stop));
                }
                through[i] = after;
                covered[i] += weight;            // not 1 - through, whose digits are gone where little is drawn
                red[i] += weight * r;
                green[i] += weight * g;
                blue[i] += weight * b;
                depth[i] += weight * z;
            }
        }
    }
    const T bg[3] = {out.background[0], out.background[1], out.background[2]};
    for (int y = 0; y < box.height; y++) {
        const std::int64_t row = std::int64_t(box.top + y) * camera.width + box.left;
        for (int x = 0; x < box.width; x++) {
            const int i = (y / BLOCK_H) * BLOCKS_X + x / BLOCK_W, lane = y % BLOCK_H * BLOCK_W + x % BLOCK_W;
            const T left = through[i][lane] < 0 ? -through[i][lane] : through[i][lane], weights = covered[i][lane];
            T* pixel = out.image + 3 * (row + x);
            pixel[0] = red[i][lane] + left * bg[0];
            pixel[1] = green[i][lane] + left * bg[1];
            pixel[2] = blue[i][lane] + left * bg[2];
            out.alpha[row + x] = left < T(0.5) ? T(1) - left : weights;  // each where it has the more digits
            out.depth[row + x] = weights > 0 ? depth[i][lane] / weights : T(0);
        }
    }
}

template <typename T> static void empty_tile(const Camera& camera, const TileBox& box, const Outputs<T>& out) {
    for (int y = box.top; y < box.top + box.height; y++)
        for (std::int64_t i = std::int64_t(y) * camera.width + box.left, end = i + box.width; i < end; i++) {
            for (int c = 0; c < 3; c++) out.image[3 * i + c] = out.background[c];
            out.alpha[i] = out.depth[i] = 0;
        }
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
            project_chunk<T>(splats, camera, chunk_range(splats.count, chunks, chunk), projected, out.radii, frame.tiles_x,
                             frame.tiles_y, counts.get() + std::size_t(chunk) * tiles);
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
    frame.entries = Buffer<Entry<T>>(std::size_t(total));
    Buffer<Entry<T>> spare{std::size_t(total)};
    Entry<T>* entries = frame.entries.get();

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
                for (int tx = x0; tx <= x1; tx++, slot++) entries[place[ty * frame.tiles_x + tx]++] = {key, std::uint32_t(i)};
        }
    };
    parallel(chunks, threads, pass_b);

    auto pass_c = [&](int task) {
        const int tile = int(order[task]);
        const std::uint32_t begin = starts[tile], count = starts[tile + 1] - begin;
        const TileBox box = tile_box(camera, frame.tiles_x, tile);
        if (count == 0) return empty_tile<T>(camera, box, out);
        sort_entries<T>(entries + begin, spare.get() + begin, count);
        blend_tile<T>(camera, box, projected, entries + begin, count, out);
    };
    parallel(tiles, threads, pass_c);
}

// ---------------------------------------------------------------------------------------------------------- backward

// Pass D for one tile. With S the sum of what lies behind a splat at a pixel (colour times gradient), blended,
// dLoss/dalpha = T (color . g) - S / (1 - alpha); S starts as the whole pixel and shrinks front to back.
template <typename T, bool EXTRA>
static void backward_tile(const Frame<T>& frame, const TileBox& box, const Entry<T>* list, std::uint32_t count,
                          const Gradients<T>& grad, T* slots, int tile) {
    using V = Vec<T>;
    using M = Mask<T>;
    const Camera& camera = frame.camera;
    const Projected<T>* projected = frame.projected.get();
    V through[BLOCKS], behind[BLOCKS], g_red[BLOCKS], g_green[BLOCKS], g_blue[BLOCKS];
    V g_alpha[EXTRA ? BLOCKS : 1], g_depth[EXTRA ? BLOCKS : 1], mean_depth[EXTRA ? BLOCKS : 1];
    int alive = clear_tile<T>(box, through);
    if (box.width < TILE || box.height < TILE)
        for (int i = 0; i < BLOCKS; i++) {
            behind[i] = g_red[i] = g_green[i] = g_blue[i] = V{};
            if (EXTRA) g_alpha[i] = g_depth[i] = mean_depth[i] = V{};
        }
    for (int y = 0; y < box.height; y++) {
        const std::int64_t row = std::int64_t(box.top + y) * camera.width + box.left;
        for (int x = 0; x < box.width; x++) {
            const int i = (y / BLOCK_H) * BLOCKS_X + x / BLOCK_W, lane = y % BLOCK_H * BLOCK_W + x % BLOCK_W;
            const std::int64_t at = row + x;
            T gr = 0, gg = 0, gb = 0;
            if (grad.d_image != nullptr) gr = grad.d_image[3 * at], gg = grad.d_image[3 * at + 1], gb = grad.d_image[3 * at + 2];
            g_red[i][lane] = gr, g_green[i][lane] = gg, g_blue[i][lane] = gb;
            T rest = grad.image[3 * at] * gr + grad.image[3 * at + 1] * gg + grad.image[3 * at + 2] * gb;
            if (EXTRA) {
                // depth = sum(w z) / sum(w): the weight w of a splat at z is worth (z - depth) / sum(w)
                const T alpha = grad.alpha[at], ga = grad.d_alpha != nullptr ? grad.d_alpha[at] : T(0);
                g_alpha[i][lane] = ga;
                g_depth[i][lane] = grad.d_depth != nullptr && alpha > 0 ? grad.d_depth[at] / alpha : T(0);
                mean_depth[i][lane] = grad.depth[at];
                rest += alpha * ga;
            }
            behind[i][lane] = rest;
        }
    }
    const V cut = all<T>(T(ALPHA_MIN_LOG2)), alpha_max = all<T>(T(camera.alpha_max)), least = all<T>(T(TRANSMITTANCE_MIN));
    const int tile_x = tile % frame.tiles_x, tile_y = tile / frame.tiles_x;
    for (std::uint32_t n = 0; n < count; n++) {
        if (n + 6 < count) __builtin_prefetch(&projected[list[n + 6].splat]);
        const Projected<T>& p = projected[list[n].splat];
        const int x0 = p.left / TILE, x1 = p.right / TILE, y0 = p.top / TILE;
        T* slot = slots + SLOT * (std::size_t(p.slot) + std::size_t((tile_y - y0) * (x1 - x0 + 1) + tile_x - x0));
        if (alive == 0) {
            for (int k = 0; k < SLOT; k++) slot[k] = 0;
            continue;
        }
        const Walk<T> walk = Walk<T>::start(p, box);
        const V step = all<T>(p.a * BLOCK_W);
        const V r = all<T>(p.color[0]), g = all<T>(p.color[1]), b = all<T>(p.color[2]), z = all<T>(p.depth);
        V s_q{}, s_qu{}, s_quu{}, s_qv{}, s_quv{}, s_qvv{}, s_red{}, s_green{}, s_blue{}, s_depth{};
        for (int by = walk.by0; by <= walk.by1; by++) {
            V v, exponent, u;
            walk.row(by, v, exponent, u);
            V row_q{}, row_qu{};
            for (int i = by * BLOCKS_X + walk.bx0; i <= by * BLOCKS_X + walk.bx1; i++, u += step) {
                V e = exponent - u * u;
                V before = through[i];
                M hit = ge<T>(e, cut) & gt<T>(before, V{});
                if (!any(hit)) continue;
                V raw = vexp2(e);
                V alpha = keep<T>(hit, vmin<T>(raw, alpha_max));
                V weight = alpha * before;
                V after = before - weight;
                M stop = hit & le<T>(after, least);
                if (any(stop)) {
                    weight = keep<T>(~stop, weight);
                    alpha = keep<T>(~stop, alpha);
                    after = select<T>(stop, -before, after);
                    alive -= __builtin_popcount(bits(stop));
                }
                through[i] = after;
                const V gr = g_red[i], gg = g_green[i], gb = g_blue[i];
                V product = r * gr + g * gg + b * gb;
                if (EXTRA) product += g_alpha[i] + (z - mean_depth[i]) * g_depth[i];
                V here = weight * product;
                V rest = behind[i] - here;
                behind[i] = rest;
                V q = here - rest * alpha / (T(1) - alpha);
                // Where alpha is at its upper clamp, it does not follow the splat.
                q = keep<T>(le<T>(raw, alpha_max) & hit, q);
                V qu = q * u;
                row_q += q;
                row_qu += qu;
                s_quu += qu * u;
                s_red += weight * gr;
                s_green += weight * gg;
                s_blue += weight * gb;
                if (EXTRA) s_depth += weight * g_depth[i];
            }
            s_q += row_q;
            s_qu += row_qu;
            s_qv += row_q * v;
            s_quv += row_qu * v;
            s_qvv += row_q * v * v;
        }
        V sums[8] = {s_q, s_qu, s_quu, s_qv, s_quv, s_qvv, s_red, s_green};
        transpose(sums);
        store<T>(slot, ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7])));
        slot[S_BLUE] = sum<T>(s_blue);
        slot[S_DEPTH] = EXTRA ? sum<T>(s_depth) : T(0);
    }
}

// Pass E for eight splats: from the sums over pixels to the attributes.
template <typename T>
VS_INLINE void backward_group(const Splats<T>& splats, const Frame<T>& frame, const Gradients<T>& grad, const T* slots,
                              std::int64_t first, int valid) {
    using V = Vec<T>;
    const Camera& camera = frame.camera;
    const Projected<T>* projected = frame.projected.get();
    const int floats = 3 * splats.coefficients;
    T lanes[SLOT][LANES] = {}, factor[3][LANES] = {}, open[3][LANES] = {};
    bool some = false;
    for (int i = 0; i < valid; i++) {
        const Projected<T>& p = projected[first + i];
        if (!p.visible || p.left > p.right) continue;
        some = true;
        factor[0][i] = p.a, factor[1][i] = p.b, factor[2][i] = p.c;
        for (int k = 0; k < 3; k++) open[k][i] = p.clamped >> k & 1 ? T(0) : T(1);
        const std::size_t tiles = std::size_t(p.right / TILE - p.left / TILE + 1) * std::size_t(p.bottom / TILE - p.top / TILE + 1);
        const T* slot = slots + SLOT * std::size_t(p.slot);
        T total[SLOT];
        for (int k = 0; k < SLOT; k++) total[k] = slot[k];
        for (std::size_t n = 1; n < tiles; n++)
            for (int k = 0; k < SLOT; k++) total[k] += slot[n * SLOT + k];
        for (int k = 0; k < SLOT; k++) lanes[k][i] = total[k];
    }
    if (!some) {
        for (int i = 0; i < 3 * valid; i++) grad.d_means[3 * first + i] = grad.d_log_scales[3 * first + i] = 0;
        for (int i = 0; i < 4 * valid; i++) grad.d_quats[4 * first + i] = 0;
        for (int i = 0; i < valid; i++) grad.d_logits[first + i] = 0;
        for (int i = 0; i < floats * valid; i++) grad.d_sh[floats * first + i] = 0;
        if (grad.d_offsets != nullptr)
            for (int i = 0; i < 2 * valid; i++) grad.d_offsets[2 * first + i] = 0;
        return;
    }
    Group<T> g;
    project_group<T>(splats, camera, first, g);
    const Mask<T> drawn = gt<T>(load<T>(factor[2]), V{});
    const V a = load<T>(factor[0]), b = load<T>(factor[1]), c = load<T>(factor[2]);
    const V q = load<T>(lanes[S_Q]), qu = load<T>(lanes[S_QU]), quu = load<T>(lanes[S_QUU]), qv = load<T>(lanes[S_QV]),
            quv = load<T>(lanes[S_QUV]), qvv = load<T>(lanes[S_QVV]);

    // With L the Cholesky factor of the inverse covariance (a, b, c without their scale), the gradient of the mean is
    // L^T (qu, qv), and that of the covariance's factor F (rows u and v) is L^T Q (L F), with Q = (quu quv; quv qvv).
    const T root = T(1.1774100225154747), k = root * root;   // k = 2 ln 2 undoes the scale for base 2
    const V l_a = root * a, l_b = root * b, l_c = root * c;
    const V d_x = root * l_a * qu, d_y = root * (l_b * qu + l_c * qv);
    V d_logit = keep<T>(drawn, g.one_minus_opacity * q);

    // colour
    V d_color[3], basis[16], bx[16], by[16], bz[16], sh[48];
    for (int ch = 0; ch < 3; ch++) d_color[ch] = load<T>(lanes[S_RED + ch]) * load<T>(open[ch]);
    sh_basis<T, true>(splats.coefficients, g.direction[0], g.direction[1], g.direction[2], basis, bx, by, bz);
    V d_dir[3] = {V{}, V{}, V{}};
    if (splats.coefficients > 1) {
        gather_long<T>(splats.sh, floats, first, splats.count, sh);
        for (int j = 1; j < splats.coefficients; j++) {
            V d_basis = sh[3 * j] * d_color[0] + sh[3 * j + 1] * d_color[1] + sh[3 * j + 2] * d_color[2];
            d_dir[0] += bx[j] * d_basis;
            d_dir[1] += by[j] * d_basis;
            d_dir[2] += bz[j] * d_basis;
        }
    }
    for (int j = 0; j < splats.coefficients; j++) {
        V f = keep<T>(drawn, basis[j]);
        for (int ch = 0; ch < 3; ch++) sh[3 * j + ch] = f * d_color[ch];
    }
    scatter_long<T>(grad.d_sh, floats, first, valid, sh);

    // Columns of L F, divided by the scales: (e, f). Each is formed from the cross product of F's rows, since
    // l_a u + l_b v cancels out for needles.
    V e[3], f[3];
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        V bent = g.v[j] * g.scale[j] * g.m_cross[l] - g.v[l] * g.scale[l] * g.m_cross[j];
        e[i] = l_a / g.yy * (bent + T(DILATION) * g.m_u[i]);
        f[i] = l_c * g.m_v[i];
    }
    V e_q[3], f_q[3];                    // Q (e, f)
    for (int i = 0; i < 3; i++) {
        e_q[i] = k * (quu * e[i] + quv * f[i]);
        f_q[i] = k * (quv * e[i] + qvv * f[i]);
    }
    V square[3], d_log_scale[3];
    for (int i = 0; i < 3; i++) {
        square[i] = g.scale[i] * g.scale[i];
        d_log_scale[i] = keep<T>(drawn, square[i] * (e_q[i] * e[i] + f_q[i] * f[i]));
    }
    // A turn about the splat's own axis l mixes the columns i and j.
    V turn[3];
    for (int l = 0; l < 3; l++) {
        const int i = (l + 1) % 3, j = (l + 2) % 3;
        turn[l] = T(2) * (e_q[i] * e[j] + f_q[i] * f[j]) * (square[i] - square[j]) / g.quat_length;
    }
    const V* n = g.quat;
    V d_quat[4] = {-n[1] * turn[0] - n[2] * turn[1] - n[3] * turn[2], n[0] * turn[0] - n[3] * turn[1] + n[2] * turn[2],
                   n[3] * turn[0] + n[0] * turn[1] - n[1] * turn[2], -n[2] * turn[0] + n[1] * turn[1] + n[0] * turn[2]};
    for (int j = 0; j < 4; j++) d_quat[j] = keep<T>(drawn, d_quat[j]);

    // plane_u = fx / z (w0 - x_lim w2), plane_v = fy / z (w1 - y_lim w2)
    T w[9];
    for (int i = 0; i < 9; i++) w[i] = T(camera.rotation[i]);
    const T fx = T(camera.fx), fy = T(camera.fy);
    V pu_w2{}, pv_w2{};
    for (int i = 0; i < 3; i++) {
        V along = square[i] * (w[6] * g.rotation[i] + w[7] * g.rotation[3 + i] + w[8] * g.rotation[6 + i]);
        pu_w2 += along * (l_a * e_q[i]);
        pv_w2 += along * (l_b * e_q[i] + l_c * f_q[i]);
    }
    // 1 / z scales all of F, as the three scales together do
    V d_inverse = (d_log_scale[0] + d_log_scale[1] + d_log_scale[2]) * g.depth;
    Mask<T> free_x = ge<T>(g.x_z, all<T>(T(camera.limits[0]))) & le<T>(g.x_z, all<T>(T(camera.limits[1])));
    Mask<T> free_y = ge<T>(g.y_z, all<T>(T(camera.limits[2]))) & le<T>(g.y_z, all<T>(T(camera.limits[3])));
    V d_x_z = fx * d_x - keep<T>(free_x, fx * g.inverse_depth * pu_w2);
    V d_y_z = fy * d_y - keep<T>(free_y, fy * g.inverse_depth * pv_w2);
    V local_x = d_x_z * g.inverse_depth, local_y = d_y_z * g.inverse_depth;
    // x_z = x / z
    V local_z = load<T>(lanes[S_DEPTH]) - g.inverse_depth * (g.inverse_depth * d_inverse + g.x_z * d_x_z + g.y_z * d_y_z);

    V inward = g.direction[0] * d_dir[0] + g.direction[1] * d_dir[1] + g.direction[2] * d_dir[2];
    V inverse_distance = T(1) / vmax<T>(g.distance, all<T>(T(1e-12))), d_mean[3];
    for (int j = 0; j < 3; j++)
        d_mean[j] = keep<T>(drawn, w[j] * local_x + w[3 + j] * local_y + w[6 + j] * local_z +
                                       (d_dir[j] - g.direction[j] * inward) * inverse_distance);

    scatter<T>(grad.d_means, 3, first, valid, d_mean);
    scatter<T>(grad.d_quats, 4, first, valid, d_quat);
    scatter<T>(grad.d_log_scales, 3, first, valid, d_log_scale);
    scatter<T>(grad.d_logits, 1, first, valid, &d_logit);
    if (grad.d_offsets != nullptr) {
        V d_offset[2] = {keep<T>(drawn, d_x), keep<T>(drawn, d_y)};
        scatter<T>(grad.d_offsets, 2, first, valid, d_offset);
    }
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
        const Entry<T>* list = frame.entries.get() + begin;
        if (extra) backward_tile<T, true>(frame, box, list, count, grad, slots.get(), tile);
        else backward_tile<T, false>(frame, box, list, count, grad, slots.get(), tile);
    };
    parallel(tiles, threads, pass_d);

    const int chunks = chunk_count(splats.count, threads);
    auto pass_e = [&](int chunk) {
        Range range = chunk_range(splats.count, chunks, chunk);
        for (std::int64_t first = range.begin; first < range.end; first += LANES)
            backward_group<T>(splats, frame, grad, slots.get(), first, range.end - first < LANES ? int(range.end - first) : LANES);
    };
    parallel(chunks, threads, pass_e);
}
